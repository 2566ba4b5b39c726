"""`convoy sweep`, and its table."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.columns import Column, print_whole, table_of
from scenarios.cli.common_options import folder_option, output_option, override_options
from scenarios.cli.error_lines import clear_errors, print_error
from scenarios.cli.guide import completion
from scenarios.cli.many.study_options import (
    LIMIT_WORDS,
    engine_options,
    selected_workers,
)
from scenarios.definition.errors import require

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from scenarios.studies.many.sweeps.cell_table import SweepCell, SweepTable

MOST_ROWS = 60
"""Rows that are printed; the file has all of them."""
WIDEST = 16
"""Characters of a printed value, which may be a whole table."""


@click.command(
    epilog="""\b
Examples:
  convoy sweep lossy_lane_change --vary links.loss_ratio=0:0.9:0.1 --limit lane
  convoy sweep lane_change --vary links.loss_ratio=0.5:0.9:0.1 --vary convoy.gap_m=3,10 -o f.pdf
  convoy sweep lane_change --vary links.preset=clear,lossy --metric v4.distance_m
  convoy sweep burst_worst --vary change.0.at_s=3:10:0.5 --seeds 5
  convoy sweep my.toml --seeds 200 --limit collision --limit error_m=0.5 --out night
  convoy sweep lane_change --vary gnss.rate_hz=5,10 --scheduler tcp://127.0.0.1:8786

\b
KEY=START:STOP:STEP includes both ends. KEY=a,b,c is a list of any values.
change.0 is the first [[change]] of the scenario.
A seed draws the same random numbers in every combination. An interrupted
sweep resumes when the same command is run again.

\b
A metric is a number in summary.json (see `convoy reference fields`):
  cross_track_error_m_max     largest value of all followers (smallest for
                              *_min)
  v3.cross_track_error_m_max  of one vehicle
  links.age_ms_max            of the worst link; v1:v3.age_ms_max of one link
  reaction.blind_m            a field within a field
  v4.string.spacing_growth_l2 mean gain per vehicle, see string-stability
  events.lane_departure       the number of events of one kind
"""
)
@click.argument("scenario", shell_complete=completion.scenarios)
@click.option(
    "--vary",
    multiple=True,
    metavar="KEY=START:STOP:STEP|a,b,c",
    help="Values of a key. Repeatable: all combinations are simulated.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 100_000),
    default=20,
    show_default=True,
    metavar="N",
    help="Simulate each combination with the seeds 1 to N.",
)
@click.option(
    "--metric",
    "metrics",
    multiple=True,
    metavar="NAME",
    help="Field of the summary to tabulate. Repeatable. Default: cross_track_error_m_max.",
)
@click.option(
    "--limit",
    "limits",
    multiple=True,
    metavar="LIMIT",
    help=f"Count the runs that break this limit: {LIMIT_WORDS}. Repeatable.",
)
@override_options
@folder_option("sweep", "Folder for tables and the file from which a sweep resumes.")
@engine_options
@output_option(
    "Draw metrics and limits into this new file, .png, .svg or .pdf: over one key, or over one with"
    " numbers and a line for each value of another one. Two keys with numbers give a heat map."
)
@click.option("--parquet", is_flag=True, help="Write the tables as Parquet too.")
def sweep(
    *,
    scenario: str,
    vary: tuple[str, ...],
    seeds: int,
    metrics: tuple[str, ...],
    limits: tuple[str, ...],
    overrides: tuple[str, ...],
    out: Path,
    workers: int | None,
    scheduler: str,
    parquet: bool,
    output: Path | None,
) -> None:
    """Run a scenario over values and seeds.

    Simulates SCENARIO for each combination of values and each seed. Writes tables with confidence
    intervals, and draws a picture on request.
    """
    with clear_errors():
        if output is not None:
            require("--output", "studies", "matplotlib", "scipy")
        if parquet:
            require("--parquet", "tables", "pyarrow")
    from rich.console import Console

    from scenarios.runs.stop import EXIT_FAILED
    from scenarios.studies.many.sweeps.plan import planned
    from scenarios.studies.many.sweeps.sweep import run_sweep

    with clear_errors():
        plan = planned(
            scenario, vary=vary, seeds=seeds, sets=overrides, metrics=metrics, limits=limits
        )
        fleet = selected_workers(workers, scheduler)
        report = partial(click.echo, err=True)
        table, written = run_sweep(
            plan,
            out,
            fleet,
            report,
            parquet=parquet,
            picture=output,
        )
        print_sweep(table, Console())
        click.echo(f"written: {', '.join(map(str, written))}")
        if table.errors:
            first = next(run for cell in table.cells for run in cell.runs if run.error)
            print_error(f"{table.errors} of {plan.runs} runs raised an error")
            print_error(f"{first.command}: {first.error}")
            raise SystemExit(EXIT_FAILED)


def print_sweep(table: "SweepTable", console: "Console") -> None:
    for number in range(max(len(table.plan.figures), len(table.plan.limits))):
        print_whole(_table(table, number), console)
    if len(table.cells) > MOST_ROWS:
        console.print(f"{len(table.cells) - MOST_ROWS} more rows are in the file")
    worst = table.worst
    console.print(f"repeat the worst run: {worst.command}", highlight=False, soft_wrap=True)


def _table(table: "SweepTable", number: int) -> "Table":
    """Table of the figure and the limit with this number, if they exist."""
    figures, limits = table.plan.figures[number:][:1], table.plan.limits[number:][:1]
    columns = [_key_column(axis.key, place) for place, axis in enumerate(table.plan.axes)]
    columns += [Column("errors", lambda cell: cell.errors)] if table.errors else []
    for figure in figures:
        columns += _spread_columns(number, least=figure.is_worst_when_least)
    columns += _share_columns(number) if limits else []
    columns += [] if number else [Column("worst\nseed", lambda cell: cell.worst.seed)]
    columns = [replace(column, max_width=WIDEST) for column in columns]
    names = ", ".join((*(figure.name for figure in figures), *map(str, limits)))
    title = f"{names}; {table.plan.seeds} runs per row"
    return table_of(columns, table.cells[:MOST_ROWS], title=title, title_justify="left")


def _key_column(key: str, place: int) -> "Column[SweepCell]":
    return Column(key.replace(".", ".\n"), lambda cell: cell.values[place])


def _spread_columns(number: int, *, least: bool) -> "list[Column[SweepCell]]":
    """Columns of the figure with this number; its worst value comes last."""

    def spread(heading: str, attribute: str) -> "Column[SweepCell]":
        return Column(heading, lambda cell: _shown(getattr(cell.figures[number], attribute)))

    def interval(cell: "SweepCell") -> str | None:
        of_mean = cell.figures[number]
        if of_mean.mean_low is None:
            return None
        return f"{_shown(of_mean.mean_low)} to {_shown(of_mean.mean_high)}"

    worst = spread("min", "minimum") if least else spread("max", "maximum")
    return [
        spread("mean", "mean"),
        Column("95 % interval\nof the mean", interval),
        spread("median", "median"),
        spread("5 %", "p5"),
        spread("95 %", "p95"),
        worst,
    ]


def _share_columns(number: int) -> "list[Column[SweepCell]]":
    """Share of runs that broke the limit with this number, and its interval."""

    def interval(cell: "SweepCell") -> str | None:
        share = cell.limits[number]
        if share.ratio is None:
            return None
        return f"{100.0 * share.low:.0f} to {100.0 * share.high:.0f}"

    return [
        Column("limit\nbroken\n%", lambda cell: cell.limits[number].ratio, ".0f", 100.0),
        Column("95 %\ninterval", interval),
    ]


def _shown(value: float | None) -> str | None:
    if value is None:
        return None
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"
