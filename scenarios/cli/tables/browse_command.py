"""`convoy browse`: all runs in a folder, as a table."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

import click

from scenarios.cli.columns import Column, print_whole, table_of
from scenarios.cli.common_options import json_option, rerun_option
from scenarios.cli.error_lines import clear_errors, print_error
from scenarios.cli.log_commands import review
from scenarios.runs.stop import EXIT_BAD_INPUT, stop_on_signals
from transport.clock import poll

if TYPE_CHECKING:
    from rich.console import Console

    from scenarios.studies.run_list import ListedRun

PROGRESS_S = 2.0
WIDEST = 40
"""Characters of printed overrides."""


@click.command(
    epilog="""\b
Examples:
  convoy browse                                  the runs in the folder runs
  convoy browse runs --where outcome=failed --sort=-worst_error_m
  convoy browse runs --where "overrides~loss" --where "worst_error_m>0.5"
  convoy browse runs --sort=-worst_error_m --open 1
  convoy browse runs --html runs.html
  convoy browse runs --catalog --serve     in Rerun, in a browser

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
@click.option(
    "--open",
    "opened",
    type=click.IntRange(1),
    metavar="N",
    help="Show run number N of the table in Rerun.",
)
@click.option(
    "--catalog",
    "in_catalog",
    is_flag=True,
    help="Show all runs of the table in Rerun's catalog. Needs the extra catalog.",
)
@rerun_option("spawn", "Show the runs of --open and --catalog in Rerun", "Default.")
@click.option(
    "--html",
    "page",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write the table as a page that sorts and filters itself.",
)
@json_option("Print the table as JSON.")
@click.pass_context
def browse(
    context: click.Context,
    *,
    folder: Path,
    conditions: tuple[str, ...],
    sort: str,
    opened: int | None,
    in_catalog: bool,
    rerun: str,
    page: Path | None,
    as_json: bool,
) -> None:
    """List the runs in a folder.

    FOLDER is searched for logs, in its folders too. Missing, incomplete and unreadable logs are
    listed with the reason; `convoy info` also finds damage within a complete log.
    """
    import json

    from rich.console import Console

    from scenarios.results.files import write_whole
    from scenarios.studies.run_list import as_rows, runs_in, selected
    from scenarios.studies.run_list_page import run_list_page

    with clear_errors():
        selected((), conditions, sort)  # refuse options before the logs are read
        runs = selected(runs_in(folder, _progress_lines()), conditions, sort)
        if as_json:
            click.echo(json.dumps(as_rows(runs), indent=2))
        elif page is None and opened is None and not in_catalog:
            print_runs(runs, Console())
        if page is not None:
            write_whole(page, run_list_page(folder, runs).encode(), new=True)
            click.echo(f"written: {page}", err=as_json)
        if in_catalog:
            _show_catalog(runs, rerun)
    if opened is not None:
        if opened > len(runs):
            print_error(f"--open: given {opened}, allowed 1 to {len(runs)}")
            raise SystemExit(EXIT_BAD_INPUT)
        context.invoke(review, log=Path(runs[opened - 1].log), rerun=rerun)


def _show_catalog(runs: "Sequence[ListedRun]", rerun: str) -> None:
    """Show runs in Rerun's catalog until Ctrl-C."""
    from scenarios.studies.run_catalog import show_catalog
    from transport.picture.option import parse_rerun_option

    option = parse_rerun_option(rerun)
    stop = stop_on_signals()
    stop.begun = True  # files are deleted at the end

    def wait(url: str, shown_in: str) -> None:
        click.echo(f"catalog: {url}\nopen {shown_in}\nstop with Ctrl-C")
        poll(lambda: stop.requested, every_s=0.1)

    show_catalog(runs, option, wait, partial(click.echo, err=True), lambda: stop.requested)
    raise SystemExit(stop.exit_code)


def _progress_lines() -> Callable[[int, int], None]:
    """Return a function that prints the number of runs that were read, every few seconds."""
    printed_at = monotonic()

    def report(done: int, total: int) -> None:
        nonlocal printed_at
        if monotonic() - printed_at >= PROGRESS_S:
            printed_at = monotonic()
            click.echo(f"{done} of {total} runs are read", err=True)

    return report


def print_runs(runs: "Sequence[ListedRun]", console: "Console") -> None:
    """Print a table of runs, numbered for `--open`."""
    rows = list(enumerate(runs, 1))
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
        Column("log", lambda row: _state(row[1]), left=True),
    ]
    print_whole(table_of(columns, rows, style=lambda row: _style(row[1])), console)
    for number, run in rows:
        lines = [run.line] if run.outcome in {"failed", "unreadable"} else []
        if run.faults and run.faults not in lines:
            lines.append(f"log: {run.faults}")
        for line in lines:
            console.print(f"{number}: {line}", highlight=False, soft_wrap=True, markup=False)


def _state(run: "ListedRun") -> str:
    if run.faults:
        return "faulty"
    return "piece" if run.line.startswith("PIECE ") else "ok"


def _style(run: "ListedRun") -> str | None:
    return "red" if run.faults or run.outcome in {"failed", "unreadable"} else None


def _shortened(text: str) -> str:
    return text if len(text) <= WIDEST else f"{text[: WIDEST - 1]}…"
