"""Options that the commands of many runs share."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import click

from scenarios.cli.error_lines import require
from scenarios.cli.guide import completion
from scenarios.definition.schema.limit_rows import words_with_examples

if TYPE_CHECKING:
    from scenarios.studies.engine.fleet import OpenFleet
    from scenarios.studies.many.variant import Variant

Command = TypeVar("Command", bound=Callable[..., Any])

LIMIT_WORDS = f"{words_with_examples()}; of one vehicle: v2.error_m=0.5"


def overrides_option(command: Command) -> Command:
    return click.option(
        "--set",
        "overrides",
        multiple=True,
        metavar="KEY=VALUE",
        shell_complete=completion.settings,
        help="Override a scenario value of all runs. May be repeated.",
    )(command)


def limit_option(command: Command) -> Command:
    return click.option(
        "--limit",
        "limit_text",
        default="lane",
        show_default=True,
        metavar="LIMIT",
        shell_complete=completion.limits,
        help=f"Limit that runs break or keep: {LIMIT_WORDS}.",
    )(command)


def engine_options(command: Command) -> Command:
    scheduler = click.option(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        default="",
        help="Let the workers of a running dask scheduler do it.",
    )
    workers = click.option(
        "--workers",
        type=click.IntRange(0, 1024),
        metavar="N",
        help="Processes: one for each core by default, 0 for none but this one.",
    )
    return workers(scheduler(command))


def selected_fleet(workers: int | None, scheduler: str) -> "OpenFleet":
    from scenarios.studies.engine.fleet import fleet_of

    if scheduler:
        require("--scheduler", "dask", "distributed")
    return partial(fleet_of, workers, scheduler)


def variant_of(name: str, overrides: tuple[str, ...]) -> "Variant":
    """Return the run that is to be varied; raises ScenarioError if it is refused."""
    from scenarios.definition.scenario import load_scenario
    from scenarios.studies.many.variant import Variant

    variant = Variant(text=load_scenario(name).text, name=name, overrides=overrides)
    _ = variant.scenario
    return variant
