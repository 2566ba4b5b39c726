"""The command that drives a scenario with many values of some keys, and its table."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.failure import clear_errors, require
from scenarios.cli.guide import completion
from scenarios.cli.many.options import chosen_fleet, engine_options, overrides_option

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from scenarios.studies.many.sweeps.table import FigureSpread, LimitShare, SweepTable

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
    metavar="WORD",
    help="lane, collision, near_miss, path_lost, error_m=NUMBER or gap_m=NUMBER: the share of runs"
    " that break it. May be repeated.",
)
@overrides_option
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("sweep"),
    show_default=True,
    help="Folder for the tables, the pictures, and the journal of what is done.",
)
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
        fleet = chosen_fleet(workers, scheduler)
        say = partial(click.echo, err=True)
        table, written = carry_out_sweep(
            plan, out, fleet, say, parquet=parquet, pictures=not no_pictures
        )
        print_sweep(table, Console())
        click.echo(f"written: {', '.join(map(str, written))}")
        if table.errors:
            first = next(run for cell in table.cells for run in cell.runs if run.error)
            click.echo(f"{table.errors} of {plan.runs} runs raised an error", err=True)
            click.echo(f"{first.command}: {first.error}", err=True)
            raise SystemExit(EXIT_FAILED)


def print_sweep(table: "SweepTable", console: "Console") -> None:
    """Print a row for each cell: a table for each figure, a limit beside it."""
    from scenarios.cli.whole import print_whole

    for number in range(max(len(table.plan.figures), len(table.plan.limits))):
        print_whole(_table(table, number), console)
    if len(table.cells) > MOST_ROWS:
        console.print(f"and {len(table.cells) - MOST_ROWS} more rows in the file")
    worst = table.worst
    console.print(f"the worst of all again: {worst.command}", highlight=False, soft_wrap=True)


def _table(table: "SweepTable", number: int) -> "Table":
    """Make the table of the figure and the limit with this number, as far as there are so many."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    figures, limits = table.plan.figures[number:][:1], table.plan.limits[number:][:1]
    shown = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title_justify="left")
    names = (*(figure.name for figure in figures), *map(str, limits))
    shown.title = f"{', '.join(names)}; {table.plan.seeds} runs a row"
    headings = [axis.key.replace(".", ".\n") for axis in table.plan.axes]
    headings += ["errors"] if table.errors else []
    for figure in figures:
        headings += ["median", "5 %", "95 %", "least" if figure.is_worst_when_least else "largest"]
    headings += ["limit\nbroken\n%", "95 %\ninterval"] if limits else []
    headings += [] if number else ["worst\nseed"]
    for heading in headings:
        shown.add_column(heading, justify="right", no_wrap=True, max_width=WIDEST)
    for cell in table.cells[:MOST_ROWS]:
        row = list(cell.values)
        row += [str(cell.errors)] if table.errors else []
        for figure, spread in zip(figures, cell.figures[number:], strict=False):
            row += _spread_texts(spread, least=figure.is_worst_when_least)
        for share in cell.limits[number:][:1]:
            row += _share_texts(share)
        shown.add_row(*row, *(() if number else (str(cell.worst.seed),)))
    return shown


def _spread_texts(spread: "FigureSpread", *, least: bool) -> list[str]:
    worst = spread.least if least else spread.largest
    values = (spread.median, spread.p5, spread.p95, worst)
    return ["-" if value is None else _shown(value) for value in values]


def _shown(value: float) -> str:
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"


def _share_texts(share: "LimitShare") -> list[str]:
    if share.ratio is None:
        return ["-", "-"]
    return [f"{100.0 * share.ratio:.0f}", f"{100.0 * share.low:.0f} to {100.0 * share.high:.0f}"]
