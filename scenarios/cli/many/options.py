"""Options that the commands of many runs share."""

import os
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import click

from scenarios.cli.guide import completion

if TYPE_CHECKING:
    from scenarios.studies.many.variant import Variant

Command = TypeVar("Command", bound=Callable[..., Any])


def overrides_option(command: Command) -> Command:
    """`--set`."""
    return click.option(
        "--set",
        "overrides",
        multiple=True,
        metavar="KEY=VALUE",
        shell_complete=completion.settings,
        help="Override a scenario value of all runs. May be repeated.",
    )(command)


def limit_option(command: Command) -> Command:
    """`--limit`."""
    return click.option(
        "--limit",
        "limit_text",
        default="lane",
        show_default=True,
        metavar="LIMIT",
        help="What runs must hold: lane, collision, near_miss, path_lost, error_m=0.5, gap_m=4.",
    )(command)


def workers_option(command: Command) -> Command:
    """`--workers`."""
    return click.option(
        "--workers",
        type=click.IntRange(min=0),
        help="Processes; by default one for each core, 0 for none but this one.",
    )(command)


def pool(workers: int | None) -> "Callable[..., Any]":
    """What does jobs: as many processes as asked for."""
    from scenarios.runs.pool import run_jobs

    count = len(os.sched_getaffinity(0)) if workers is None else workers
    return partial(run_jobs, workers=count)


def variant_of(name: str, overrides: tuple[str, ...]) -> "Variant":
    """The run of which there are many; raises ScenarioError if it is refused."""
    from scenarios.definition.scenario import load_scenario
    from scenarios.studies.many.variant import Variant

    variant = Variant(text=load_scenario(name).text, name=name, overrides=overrides)
    _ = variant.scenario
    return variant
