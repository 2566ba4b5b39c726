"""`convoy bisect`, and its table."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.columns import Column, print_whole, table_of
from scenarios.cli.common_options import (
    FiniteRange,
    Ratio,
    folder_option,
    override_options,
    picture_format_option,
)
from scenarios.cli.error_lines import clear_errors
from scenarios.cli.guide import completion
from scenarios.cli.many.study_options import engine_options, limit_option, selected_workers
from scenarios.definition.errors import require

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from scenarios.studies.many.boundary.boundary_search import (
        BoundaryQuery,
        BoundaryResult,
        SharePoint,
    )


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
@click.argument("scenario", shell_complete=completion.scenarios)
@click.argument("key")
@limit_option
@click.option("--range", "span", default="0:1", show_default=True, metavar="LOW:HIGH",
              help="Interval of values to search.")  # fmt: skip
@click.option("--share", type=Ratio(), default=0.5, show_default=True, metavar="RATIO",
              help="Share of runs that break the limit at the boundary, 0 to 1.")  # fmt: skip
@click.option("--precision", type=FiniteRange(0.0, min_open=True), metavar="NUMBER",
              help="Stop at this half-width of the 95 % interval, in the unit of KEY. "
              "Default: a fiftieth of the range.")  # fmt: skip
@click.option("--runs", type=click.IntRange(min=1), default=1000, show_default=True,
              metavar="N", help="Maximum number of runs.")  # fmt: skip
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
    precision: float | None,
    runs: int,
    share: float,
    overrides: tuple[str, ...],
    workers: int | None,
    scheduler: str,
    out: Path,
    picture_format: str,
) -> None:
    """Find the value at which runs break a limit.

    Simulates SCENARIO at values of KEY and estimates the value at which the share of runs that
    break the limit reaches --share, with a 95 % interval. The exit code is 1 if there is no such
    value in the range.
    """
    with clear_errors():
        require("bisect", "studies", "matplotlib")
    from rich.console import Console

    from scenarios.runs.stop import EXIT_DONE, EXIT_FAILED
    from scenarios.studies.many.boundary.boundary_files import run_bisect
    from scenarios.studies.many.boundary.boundary_search import BoundaryQuery
    from scenarios.studies.many.variant import limited_variant

    with clear_errors():
        low, high = _bounds_of(span)
        variant, limit = limited_variant(scenario, overrides, limit_text)
        query = BoundaryQuery(
            variant=variant,
            key=key,
            limit=limit,
            low=low,
            high=high,
            precision=precision,
            share=share,
            max_runs=runs,
        )
        open_workers = selected_workers(workers, scheduler)
        result, written = run_bisect(
            query, out, open_workers, click.echo, picture_format=picture_format
        )
        print_answer(query, result, Console())
        click.echo(f"written: {', '.join(map(str, written))}")
    raise SystemExit(EXIT_DONE if result.finding == "found" else EXIT_FAILED)


def _bounds_of(span: str) -> tuple[float, float]:
    from scenarios.definition.errors import ScenarioError

    low, _, high = span.partition(":")
    try:
        return float(low), float(high)
    except ValueError:
        wrong = f"--range: given {span!r}, allowed LOW:HIGH, such as 0:1"
        raise ScenarioError([wrong]) from None


def _interval(point: "SharePoint") -> str:
    from scenarios.studies.many.statistics import agresti_coull

    low, high = agresti_coull(point.broken, point.runs)
    return f"{100.0 * low:.0f} to {100.0 * high:.0f}"


def _values(point: "SharePoint") -> str:
    return f"{point.low:g}" + (f" to {point.high:g}" if point.high > point.low else "")


COLUMNS: "Sequence[Column[SharePoint]]" = (
    Column("runs", lambda point: point.runs),
    Column("broken", lambda point: point.broken),
    Column("share\n%", lambda point: point.share, ".0f", 100.0),
    Column("95 %\ninterval", _interval),
    Column("curve\n%", lambda point: point.fitted, ".0f", 100.0),
)


def print_answer(query: "BoundaryQuery", result: "BoundaryResult", console: "Console") -> None:
    from scenarios.studies.many.boundary.boundary_search import grouped

    columns = (Column(query.key, _values, left=True), *COLUMNS)
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
