"""The command that drives a scenario with many values of some keys, and its table."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.columns import Column, print_whole, table_of
from scenarios.cli.common_options import folder_option
from scenarios.cli.error_lines import clear_errors, require
from scenarios.cli.guide import completion
from scenarios.cli.many.study_options import (
    LIMIT_WORDS,
    engine_options,
    overrides_option,
    selected_fleet,
)

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from scenarios.studies.many.sweeps.table import SweepTable, SweptCell

MOST_ROWS = 60
"""Cells that are printed; the file has them all."""
WIDEST = 14
"""Letters of a value that are printed; a key may take whole tables."""


@click.command(
    epilog="""\b
Examples:
  convoy sweep lossy_lane_change --vary links.loss_ratio=0:0.9:0.1 --limit lane
  convoy sweep lane_change --vary links.loss_ratio=0.5:0.9:0.1 --vary convoy.gap_m=8,15,35
  convoy sweep lane_change --vary links.preset=clear,lossy --figure v4.distance_m
  convoy sweep my.toml --seeds 200 --limit collision --limit error_m=0.5 --out night
  convoy sweep lane_change --vary gnss.rate_hz=5,10 --scheduler tcp://127.0.0.1:8786

\b
KEY=START:STOP:STEP has both ends and exact decimals, KEY=a,b,c is any list.
Seed k is the same noise in every cell. Killed and started again by the same
command, a sweep goes on where it was, and ends with the same tables.

\b
Figures are the numbers of summary.json (`convoy reference fields`):
  cross_track_error_m_max     of the worst follower: the largest, of *_min the
                              smallest
  v3.cross_track_error_m_max  of one vehicle
  links.age_ms_max            of the worst link; v1:v3.age_ms_max of one
  reaction.blind_m            a field within a field
  events.lane_departure       how many of a kind
"""
)
@click.argument("scenario", shell_complete=completion.scenarios)
@click.option(
    "--vary",
    multiple=True,
    metavar="KEY=START:STOP:STEP|a,b,c",
    help="Values of a key. May be repeated: every combination is driven.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 100_000),
    default=20,
    show_default=True,
    help="Runs of each combination, with the seeds 1 to N.",
)
@click.option(
    "--figure",
    "figures",
    multiple=True,
    metavar="NAME",
    help="Figure of the summary; cross_track_error_m_max by default. May be repeated.",
)
@click.option(
    "--limit",
    "limits",
    multiple=True,
    metavar="LIMIT",
    shell_complete=completion.limits,
    help=f"Limit whose share of broken runs is counted: {LIMIT_WORDS}. May be repeated.",
)
@overrides_option
@folder_option("sweep", "Folder for the tables, the pictures, and the journal of what is done.")
@engine_options
@click.option("--no-pictures", is_flag=True, help="Tables only; needs no matplotlib.")
@click.option("--parquet", is_flag=True, help="Write the tables as Parquet as well.")
def sweep(
    *,
    scenario: str,
    vary: tuple[str, ...],
    seeds: int,
    figures: tuple[str, ...],
    limits: tuple[str, ...],
    overrides: tuple[str, ...],
    out: Path,
    workers: int | None,
    scheduler: str,
    parquet: bool,
    no_pictures: bool,
) -> None:
    """Drive SCENARIO with many values of its keys and many seeds; tables, heat maps, intervals."""
    with clear_errors():
        if not no_pictures:
            require("sweep, without --no-pictures", "studies", "matplotlib")
        if parquet:
            require("--parquet", "tables", "pyarrow")
    from rich.console import Console

    from scenarios.runs.stop import EXIT_FAILED
    from scenarios.studies.many.sweeps.plan import planned
    from scenarios.studies.many.sweeps.sweep import carry_out_sweep

    with clear_errors():
        plan = planned(
            scenario, vary=vary, seeds=seeds, sets=overrides, figures=figures, limits=limits
        )
        fleet = selected_fleet(workers, scheduler)
        report = partial(click.echo, err=True)
        table, written = carry_out_sweep(
            plan, out, fleet, report, parquet=parquet, pictures=not no_pictures
        )
        print_sweep(table, Console())
        click.echo(f"written: {', '.join(map(str, written))}")
        if table.errors:
            first = next(run for cell in table.cells for run in cell.runs if run.error)
            click.echo(f"{table.errors} of {plan.runs} runs raised an error", err=True)
            click.echo(f"{first.command}: {first.error}", err=True)
            raise SystemExit(EXIT_FAILED)


def print_sweep(table: "SweepTable", console: "Console") -> None:
    """Print a table for each figure, with a limit and a row for each cell."""
    for number in range(max(len(table.plan.figures), len(table.plan.limits))):
        print_whole(_table(table, number), console)
    if len(table.cells) > MOST_ROWS:
        console.print(f"and {len(table.cells) - MOST_ROWS} more rows in the file")
    worst = table.worst
    console.print(f"the worst of all again: {worst.command}", highlight=False, soft_wrap=True)


def _table(table: "SweepTable", number: int) -> "Table":
    """Table of the figure and the limit with this number, as far as they exist."""
    figures, limits = table.plan.figures[number:][:1], table.plan.limits[number:][:1]
    columns = [_key_column(axis.key, place) for place, axis in enumerate(table.plan.axes)]
    columns += [Column("errors", lambda cell: cell.errors)] if table.errors else []
    for figure in figures:
        columns += _spread_columns(number, least=figure.is_worst_when_least)
    columns += _share_columns(number) if limits else []
    columns += [] if number else [Column("worst\nseed", lambda cell: cell.worst.seed)]
    columns = [replace(column, max_width=WIDEST) for column in columns]
    names = ", ".join((*(figure.name for figure in figures), *map(str, limits)))
    title = f"{names}; {table.plan.seeds} runs a row"
    return table_of(columns, table.cells[:MOST_ROWS], title=title, title_justify="left")


def _key_column(key: str, place: int) -> "Column[SweptCell]":
    return Column(key.replace(".", ".\n"), lambda cell: cell.values[place])


def _spread_columns(number: int, *, least: bool) -> "list[Column[SweptCell]]":
    """Columns of the figure with this number; its worst value comes last."""

    def spread(heading: str, attribute: str) -> "Column[SweptCell]":
        return Column(heading, lambda cell: _shown(getattr(cell.figures[number], attribute)))

    worst = spread("least", "least") if least else spread("largest", "largest")
    return [spread("median", "median"), spread("5 %", "p5"), spread("95 %", "p95"), worst]


def _share_columns(number: int) -> "list[Column[SweptCell]]":
    """Share of runs that broke the limit with this number, and its interval."""

    def interval(cell: "SweptCell") -> str | None:
        one = cell.limits[number]
        return None if one.ratio is None else f"{100.0 * one.low:.0f} to {100.0 * one.high:.0f}"

    return [
        Column("limit\nbroken\n%", lambda cell: cell.limits[number].ratio, ".0f", 100.0),
        Column("95 %\ninterval", interval),
    ]


def _shown(value: float | None) -> str | None:
    if value is None:
        return None
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"
