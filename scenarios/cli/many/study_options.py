"""Options that the commands of many runs share."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import click

from scenarios.definition.errors import require
from scenarios.definition.schema.limit_rows import WORDS, words_with_examples

if TYPE_CHECKING:
    from scenarios.studies.engine.workers import OpenWorkers

Command = TypeVar("Command", bound=Callable[..., Any])

SEARCHED = ("cross_track_error_m_max", "true_gap_m_min")
LIMIT_WORDS = (
    f"{words_with_examples()}. The prefix VEHICLE. limits it to one vehicle: v2.error_m=0.5"
)
FIGURES = {row.figure: word for word, row in WORDS.items() if row.key in SEARCHED}
"""Words of `--limit` by the summary field of figures that commands search for."""
OLD_FIGURES = {"error": "error_m", "gap": "gap_m"} | {word: word for word in FIGURES.values()}


class LimitedFigure(click.Choice[str]):
    """A summary field with a limit; returns its word."""

    def __init__(self) -> None:
        super().__init__(list(FIGURES))

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        if value in OLD_FIGURES:
            names = {word: name for name, word in FIGURES.items()}
            self.fail(f"{value} is now {names[OLD_FIGURES[value]]}", param, ctx)
        return FIGURES[super().convert(value, param, ctx)]


def figure_option(help_text: str) -> Callable[[Command], Command]:
    first, *others = FIGURES
    return click.option(
        "--figure",
        type=LimitedFigure(),
        default=first,
        show_default=True,
        metavar="NAME",
        help=f"{help_text}: {first} or {', '.join(others)}.",
    )


def limit_option(command: Command) -> Command:
    return click.option(
        "--limit",
        "limit_text",
        default="lane",
        show_default=True,
        metavar="LIMIT",
        help=f"Limit to test: {LIMIT_WORDS}.",
    )(command)


def engine_options(command: Command) -> Command:
    scheduler = click.option(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        default="",
        help="Simulate on the workers of a running dask scheduler.",
    )
    workers = click.option(
        "--workers",
        type=click.IntRange(0, 1024),
        metavar="N",
        help="Number of worker processes. Default: one per core. 0: simulate in this process.",
    )
    return workers(scheduler(command))


def selected_workers(workers: int | None, scheduler: str) -> "OpenWorkers":
    from scenarios.studies.engine.workers import open_workers

    if scheduler:
        require("--scheduler", "dask", "distributed")
    return partial(open_workers, workers, scheduler)
