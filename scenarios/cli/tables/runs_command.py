"""`convoy runs`: all runs in a folder, as a table."""

from collections.abc import Callable, Sequence
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

import click

from scenarios.cli.columns import Column, print_whole, table_of
from scenarios.cli.common_options import json_option
from scenarios.cli.error_lines import clear_errors

if TYPE_CHECKING:
    from rich.console import Console

    from scenarios.studies.run_list import ListedRun

PROGRESS_S = 2.0
WIDEST = 40
"""Characters of printed overrides."""


@click.command(
    epilog="""\b
Examples:
  convoy runs                                    the runs in the folder runs
  convoy runs --where outcome=failed --sort=-worst_error_m
  convoy runs --where "overrides~loss" --where "worst_error_m>0.5"

\b
Columns of --where and --sort: log, scenario, overrides, seed, clock, outcome,
ran_s, worst_error_m, worst_vehicle, events, line, faults. Signs: = != < <= >
>=, and ~ for texts that contain another.
"""
)
@click.argument("folder", default="runs", type=click.Path(path_type=Path))
@click.option(
    "--where",
    "conditions",
    multiple=True,
    metavar="CONDITION",
    help="Only runs that meet it, such as events>0. Repeatable.",
)
@click.option("--sort", default="", metavar="COLUMN", help="Sort by it; -COLUMN is descending.")
@json_option("Print the table as JSON.")
def runs(folder: Path, *, conditions: tuple[str, ...], sort: str, as_json: bool) -> None:
    """List the runs in a folder.

    FOLDER is searched for logs, in its folders too. Missing, incomplete and unreadable logs are
    listed with the reason; `convoy info` also finds damage within a complete log.
    """
    import json

    from rich.console import Console

    from scenarios.studies.run_list import as_rows, runs_in, selected

    with clear_errors():
        selected((), conditions, sort)  # refuse options before the logs are read
        listed = selected(runs_in(folder, _progress_lines()), conditions, sort)
        if as_json:
            click.echo(json.dumps(as_rows(listed), indent=2))
        else:
            print_runs(listed, Console())


def _progress_lines() -> Callable[[int, int], None]:
    """Return a function that prints the number of runs that were read, every few seconds."""
    printed_at = monotonic()

    def report(done: int, total: int) -> None:
        nonlocal printed_at
        if monotonic() - printed_at >= PROGRESS_S:
            printed_at = monotonic()
            click.echo(f"{done} of {total} runs are read", err=True)

    return report


def print_runs(listed: "Sequence[ListedRun]", console: "Console") -> None:
    """Print a table of runs, and below it the faults by number."""
    rows = list(enumerate(listed, 1))
    columns: list[Column[tuple[int, ListedRun]]] = [
        Column("number", lambda row: row[0]),
        Column("run", lambda row: row[1].log, left=True),
        Column("scenario", lambda row: row[1].scenario, left=True),
        Column("overrides", lambda row: _shortened(" ".join(row[1].overrides)), left=True),
        Column("seed", lambda row: row[1].seed),
        Column("outcome", lambda row: row[1].outcome, left=True),
        Column("time,\ns", lambda row: row[1].ran_s, ".1f"),
        Column("worst\nerror, cm", lambda row: row[1].worst_error_m, ".1f", 100.0),
        Column("events", lambda row: row[1].events),
        Column("log", lambda row: "faulty" if row[1].faults else "ok", left=True),
    ]
    print_whole(table_of(columns, rows, style=lambda row: _style(row[1])), console)
    for number, run in rows:
        lines = [run.line] if run.outcome in {"failed", "unreadable"} else []
        if run.faults and run.faults not in lines:
            lines.append(f"log: {run.faults}")
        for line in lines:
            console.print(f"{number}: {line}", highlight=False, soft_wrap=True, markup=False)


def _style(run: "ListedRun") -> str | None:
    return "red" if run.faults or run.outcome in {"failed", "unreadable"} else None


def _shortened(text: str) -> str:
    return text if len(text) <= WIDEST else f"{text[: WIDEST - 1]}…"
