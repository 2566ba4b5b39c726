"""Options that the commands of many runs share."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

from scenarios.cli import common_options
from scenarios.cli.common_options import (
    FiniteRange,
    Ratio,
    folder_option,
    output_option,
    override_options,
    picture_format_option,
    together,
)
from scenarios.cli.output import clear_errors, print_error, print_whole, table_of
from scenarios.definition.errors import ScenarioError, require
from scenarios.definition.schema.limit_rows import WORDS, words_with_examples
from scenarios.results.summary_columns import Column

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from scenarios.studies.many.blame import BlameResult
    from scenarios.studies.many.boundary import BoundaryQuery, BoundaryResult, SharePoint
    from scenarios.studies.many.cell_table import SweepCell, SweepTable
    from scenarios.studies.many.trials import Attribution, FigureName
    from scenarios.studies.workers import OpenWorkers

SEARCHED = ("cross_track_error_m_max", "true_gap_m_min")
LIMIT_WORDS = (
    f"{words_with_examples()}. The prefix VEHICLE. limits it to one vehicle: v2.error_m=0.5"
)
FIGURES = {row.figure: word for word, row in WORDS.items() if row.key in SEARCHED}
"""Words of `--limit` by the summary field of figures that commands search for."""

limit_option = click.option(
    "--limit",
    "limit_text",
    default="lane",
    show_default=True,
    metavar="LIMIT",
    help=f"Limit to test: {LIMIT_WORDS}.",
)
engine_options = together(
    click.option(
        "--workers",
        type=click.IntRange(0, 1024),
        metavar="N",
        help="Number of worker processes. Default: one per core. 0: simulate in this process.",
    ),
    click.option(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        default="",
        help="Simulate on the workers of a running dask scheduler.",
    ),
)


def selected_workers(workers: int | None, scheduler: str) -> "OpenWorkers":
    from scenarios.studies.workers import open_workers

    if scheduler:
        require("--scheduler", "dask", "distributed")
    return partial(open_workers, workers, scheduler)


# ---- `convoy bisect`, and its table


@click.command(
    epilog="""\b
Examples:
  convoy bisect lossy_lane_change links.loss_ratio --set control.degradation.reaction=extrapolate
  convoy bisect lossy_lane_change links.loss_ratio --limit v4.error_m=0.5 --range 0.2:0.7
  convoy bisect lane_change convoy.gap_m --range 1:25 --precision 0.5 --set links.loss_ratio=0.8

\b
Each run has its own seed. `convoy reference intervals` describes the curve that
is fitted, and how often its intervals contain a known boundary.
"""
)
@click.argument("scenario", shell_complete=common_options.scenarios)
@click.argument("key")
@limit_option
@click.option("--range", "span", default="0:1", show_default=True, metavar="LOW:HIGH",
              help="Interval of values to search.")  # fmt: skip
@click.option("--share", type=Ratio(), default=0.5, show_default=True, metavar="RATIO",
              help="Share of runs that break the limit at the boundary, 0 to 1.")  # fmt: skip
@click.option("--precision", type=FiniteRange(0.0, min_open=True), metavar="NUMBER",
              help="Stop at this half-width of the 95 % interval, in the unit of KEY. "
              "Default: a fiftieth of the range.")  # fmt: skip
@click.option("--runs", "max_runs", type=click.IntRange(min=1), default=1000,
              show_default=True, metavar="N", help="Maximum number of runs.")  # fmt: skip
@override_options
@engine_options
@folder_option("boundary", "Folder for the plot and bisect.json.")
@picture_format_option
def bisect(
    *,
    scenario: str,
    key: str,
    limit_text: str,
    span: str,
    overrides: tuple[str, ...],
    workers: int | None,
    scheduler: str,
    out: Path,
    picture_format: str,
    **search: Any,
) -> None:
    """Find the value at which runs break a limit.

    Simulates SCENARIO at values of KEY and estimates the value at which the share of runs that
    break the limit reaches --share, with a 95 % interval. The exit code is 1 if there is no such
    value in the range.
    """
    from rich.console import Console

    from scenarios.runs.stop import EXIT_DONE, EXIT_FAILED
    from scenarios.studies.many.boundary import BoundaryQuery
    from scenarios.studies.many.files import run_bisect
    from scenarios.studies.many.variant import limited_variant

    with clear_errors():
        low, high = _bounds_of(span)
        variant, limit = limited_variant(scenario, overrides, limit_text)
        query = BoundaryQuery(variant=variant, key=key, limit=limit, low=low, high=high, **search)
        open_workers = selected_workers(workers, scheduler)
        result, written = run_bisect(
            query, out, open_workers, click.echo, picture_format=picture_format
        )
        print_answer(query, result, Console())
        click.echo(f"written: {', '.join(map(str, written))}")
    raise SystemExit(EXIT_DONE if result.finding == "found" else EXIT_FAILED)


def _bounds_of(span: str) -> tuple[float, float]:
    low, _, high = span.partition(":")
    try:
        return float(low), float(high)
    except ValueError:
        wrong = f"--range: given {span!r}, allowed LOW:HIGH, such as 0:1"
        raise ScenarioError([wrong]) from None


def _interval(point: "SharePoint") -> str:
    from scenarios.studies.many.variant import agresti_coull

    low, high = agresti_coull(point.broken, point.runs)
    return f"{100.0 * low:.0f} to {100.0 * high:.0f}"


def _values(point: "SharePoint") -> str:
    return f"{point.low:g}" + (f" to {point.high:g}" if point.high > point.low else "")


POINT_COLUMNS: "Sequence[Column[SharePoint]]" = (
    Column("runs", lambda point: point.runs),
    Column("broken", lambda point: point.broken),
    Column("share\n%", lambda point: point.share, ".0f", 100.0),
    Column("95 %\ninterval", _interval),
    Column("curve\n%", lambda point: point.fitted, ".0f", 100.0),
)


def print_answer(query: "BoundaryQuery", result: "BoundaryResult", console: "Console") -> None:
    from scenarios.studies.many.boundary import grouped

    columns = (Column(query.key, _values, left=True), *POINT_COLUMNS)
    print_whole(table_of(columns, grouped(result.points)), console)
    for line in answer_lines(query, result):
        console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)


def answer_lines(query: "BoundaryQuery", result: "BoundaryResult") -> list[str]:
    share = f"{100.0 * query.share:g} % of the runs break {query.limit}"
    span = f"{query.low:g} to {query.high:g}"
    lines = {
        "held": f"{query.key}: fewer than {share}, everywhere from {span} ({result.runs} runs)",
        "broken": f"{query.key}: at least {share}, everywhere from {span} ({result.runs} runs)",
        "misfit": f"{query.key}: the share of broken runs does not follow one S-shaped curve from "
        f"{span} ({result.runs} runs): narrow --range to one rise or fall of the table",
    }
    if result.boundary is None:
        answer = [lines[result.finding]]
    else:
        low = f"below {query.low:g}" if result.low is None else f"{result.low:.4g}"
        high = f"above {query.high:g}" if result.high is None else f"{result.high:.4g}"
        answer = [
            f"{query.key} = {result.boundary:.4g}, 95 % interval {low} to {high}: "
            f"{'above' if result.rises else 'below'}, at least {share} ({result.runs} runs)"
        ]
        if result.half_width is None or result.half_width > query.half_width:
            answer.append(
                f"the interval is wider than ±{query.half_width:g} (--precision) after "
                f"{result.runs} runs: raise --runs"
            )
    return answer + [f"{name}: {command}" for name, command in result.commands.items()]


# ---- `convoy blame`, and its table


MOST_LOSSES = 12
MOST_BURSTS = 4


@click.command(
    epilog="""\b
Examples:
  convoy blame runs/20260101-120000-lossy_lane_change --out why
  convoy blame run.mcap --limit error_m=0.5 --out why
  convoy run why/smallest.toml --clock virtual       repeat the smallest set
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@limit_option
@click.option(
    "--figure",
    type=click.Choice(list(FIGURES)),
    default=next(iter(FIGURES)),
    show_default=True,
    metavar="NAME",
    help=f"Rank losses by their effect on this figure: {' or '.join(FIGURES)}.",
)
@folder_option("blame", "Folder for the plot, blame.json and smallest.toml.")
@picture_format_option
@engine_options
@click.option(
    "--runs",
    "max_runs",
    type=click.IntRange(min=10),
    default=400,
    show_default=True,
    metavar="N",
    help="Maximum number of runs. If they do not suffice for the smallest set, blame.json has"
    " is_minimal = false.",
)
def blame(
    *,
    log: Path,
    limit_text: str,
    figure: str,
    out: Path,
    workers: int | None,
    scheduler: str,
    max_runs: int,
    picture_format: str,
) -> None:
    """Find the lost messages behind an error.

    LOG is a run.mcap or its folder. The run is simulated again with bursts of lost messages
    restored, which ranks the bursts by their effect in metres. If the run broke the limit, the
    smallest set of losses that still breaks it is written as a scenario.
    """
    from rich.console import Console

    from scenarios.definition.run_limits import parsed_limit
    from scenarios.results.log_summary import log_in, scenario_of
    from scenarios.studies.engine import study_engine
    from scenarios.studies.job import require_place
    from scenarios.studies.many import blame

    with clear_errors():
        file = log_in(log)
        ranked = cast("FigureName", WORDS[FIGURES[figure]].live)
        scenario = scenario_of(file)
        limit = parsed_limit(limit_text, scenario.vehicle_names)
        files = (f"{blame.PICTURE}.{picture_format}", blame.JSON_FILE, blame.SMALLEST)
        require_place(out, files)
        fleet, plug_ins = selected_workers(workers, scheduler), scenario.plug_ins
        with study_engine(fleet, click.echo, plug_ins=plug_ins) as engine:
            result = blame.blame(file, limit, ranked, engine, max_runs=max_runs)
        written = blame.write_report(result, out, picture_format)
        print_blame(result, Console())
        if result.smallest is not None:
            click.echo(f"\nbreak {limit} again: {blame.command_of(out)}")
        click.echo(f"written: {', '.join(map(str, written))}")


def print_blame(result: "BlameResult", console: "Console") -> None:
    console.print(_opening(result), highlight=False)
    console.print(table_of(LOSS_COLUMNS, result.rows[:MOST_LOSSES]))
    if left := result.rows[MOST_LOSSES:]:
        console.print(f"{len(left)} more rows are in the JSON file")
    console.print(_ending(result), highlight=False)


def _opening(result: "BlameResult") -> str:
    recorded, clean = result.recorded, result.clean
    figure = "largest true error" if result.criteria.figure == "error" else "smallest true gap"
    messages = sum(len(burst.messages) for burst in result.bursts)
    return (
        f"{figure} {recorded.figure_m:.2f} m ({recorded.vehicle}, {recorded.worst_at / 1e9:.2f} s "
        f"after the start), without any loss {clean.figure_m:.2f} m; {messages} messages lost "
        f"up to one second later, in {len(result.bursts)} burst{'s' * (len(result.bursts) > 1)}"
    )


def _which(row: "Attribution") -> str:
    if row.kind == "group":
        return f"{len(row.group)} bursts, not examined one by one"
    lines = [burst.line for burst in row.group]
    if len(lines) > MOST_BURSTS:
        lines = [*lines[:MOST_BURSTS], f"and {len(row.group) - MOST_BURSTS} more"]
    return "\n".join(lines)


def _breaks_alone(row: "Attribution") -> str:
    return "" if row.alone is None else "no" if row.alone.broken_at is None else "yes"


LOSS_COLUMNS: "Sequence[Column[Attribution]]" = (
    Column("lost", _which, left=True, wraps=True),
    Column("sent, s", lambda row: "{:.2f}-{:.2f}".format(*row.span_s)),
    Column("messages", lambda row: row.messages),
    Column("reduction if\nrestored, m", lambda row: row.reduction_m, "z.3f"),
    Column("figure\nalone, m", lambda row: row.alone.figure_m if row.alone else "", ".3f"),
    Column("breaks limit\nalone", _breaks_alone),
)


def _ending(result: "BlameResult") -> str:
    from scenarios.studies.many.losses import bursts_of

    if result.smallest is None:
        return f"{result.not_reduced_reason} ({result.runs} runs, {result.seconds:.0f} s)"
    bursts = ", ".join(
        "{} at {:.2f} to {:.2f} s".format(burst.line, *burst.span_s)
        for burst in bursts_of(result.smallest.items)
    )
    without = (
        "without any one of these messages the limit holds"
        if result.smallest.is_minimal
        else "not fully reduced, because --runs is used up"
    )
    return (
        f"smallest set that breaks {result.criteria.limit}: {len(result.smallest.items)} messages "
        f"({bursts}); {without} ({result.runs} runs, {result.seconds:.0f} s)"
    )


# ---- `convoy sweep`, and its table


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
@click.argument("scenario", shell_complete=common_options.scenarios)
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
    output: Path | None,
) -> None:
    """Run a scenario over values and seeds.

    Simulates SCENARIO for each combination of values and each seed. Writes tables with confidence
    intervals, and draws a picture on request.
    """
    with clear_errors():
        if output is not None:
            require("--output", "studies", "scipy")
    from rich.console import Console

    from scenarios.runs.stop import EXIT_FAILED
    from scenarios.studies.many.files import run_sweep
    from scenarios.studies.many.plan import planned

    with clear_errors():
        plan = planned(
            scenario, vary=vary, seeds=seeds, sets=overrides, metrics=metrics, limits=limits
        )
        fleet = selected_workers(workers, scheduler)
        report = partial(click.echo, err=True)
        table, written = run_sweep(plan, out, fleet, report, picture=output)
        print_sweep(table, Console())
        click.echo(f"written: {', '.join(map(str, written))}")
        runs = [run for cell in table.cells for run in cell.runs]
        if failed := [run for run in runs if run.reason]:
            named = f"{failed[0].command}: {failed[0].reason}"
            report(f"{len(failed)} of {plan.runs} runs failed, the first is {named}")
        if table.errors:
            first = next(run for run in runs if run.error)
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
    seeds = table.plan.seeds
    title = f"{names}; {seeds} run{'s' * (seeds > 1)} per row"
    return table_of(columns, table.cells[:MOST_ROWS], title=title, title_justify="left")


def _key_column(key: str, place: int) -> "Column[SweepCell]":
    return Column(key.replace(".", ".\n"), lambda cell: cell.values[place])


SPREADS = (
    ("mean", "mean"),
    ("95 % interval\nof the mean", "mean_low mean_high"),
    ("median", "median"),
    ("5 %", "p5"),
    ("95 %", "p95"),
)
"""Headings of columns, and the figures of a cell in them."""


def _spread_columns(number: int, *, least: bool) -> "list[Column[SweepCell]]":
    """Columns of the figure with this number; its worst value comes last."""

    def values(names: str) -> "Callable[[SweepCell], str | None]":
        def shown(cell: "SweepCell") -> str | None:
            found = [_shown(getattr(cell.figures[number], name)) for name in names.split()]
            return None if None in found else " to ".join(map(str, found))

        return shown

    worst = ("min", "minimum") if least else ("max", "maximum")
    return [Column(heading, values(names)) for heading, names in (*SPREADS, worst)]


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
