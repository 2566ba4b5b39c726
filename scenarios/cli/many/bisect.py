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
from scenarios.cli.many.study_options import (
    engine_options,
    limit_option,
    selected_workers,
    valid_variant,
)
from scenarios.definition.errors import require

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from scenarios.studies.many.boundary.boundary_search import BoundaryQuery, BoundaryResult
    from scenarios.studies.many.boundary.curve import SharePoint


@click.command(
    epilog="""\b
Examples:
  convoy bisect lossy_lane_change links.loss_ratio --limit error_m=0.3 --range 0:0.9 --any
  convoy bisect lossy_lane_change links.loss_ratio --set control.degradation.reaction=extrapolate
  convoy bisect lane_change convoy.gap_m --range 1:25 --precision 0.5 --set links.loss_ratio=0.8
"""
)
@click.argument("scenario", shell_complete=completion.scenarios)
@click.argument("key")
@limit_option
@click.option("--range", "span", default="0:1", show_default=True, metavar="LOW:HIGH",
              help="Interval of values to search.")  # fmt: skip
@click.option("--precision", type=FiniteRange(0.0, min_open=True), default=0.01,
              show_default=True, metavar="NUMBER",
              help="Stop at this half-width of the bracket, in the unit of KEY.")  # fmt: skip
@click.option("--seeds", type=click.IntRange(2, 10_000), default=20, show_default=True,
              metavar="N",
              help="Simulate each value with the seeds 1 to N.")  # fmt: skip
@click.option("--share", type=Ratio(), default=0.5, show_default=True, metavar="RATIO",
              help="Share of runs that break the limit at the boundary, 0 to 1.")  # fmt: skip
@click.option("--any", "any_seed", is_flag=True,
              help="Find the smallest value at which any run breaks the limit.")  # fmt: skip
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
    precision: float,
    seeds: int,
    share: float,
    any_seed: bool,
    overrides: tuple[str, ...],
    workers: int | None,
    scheduler: str,
    out: Path,
    picture_format: str,
) -> None:
    """Find the value at which runs break a limit.

    Simulates SCENARIO at values of KEY and brackets the value at which the share of runs that break
    the limit reaches --share. A seed draws the same random numbers at every value.
    """
    with clear_errors():
        require("bisect", "studies", "matplotlib", "scipy")
    from rich.console import Console

    from scenarios.definition.run_limits import parsed_limit
    from scenarios.studies.engine.engine import study_engine
    from scenarios.studies.many.boundary.boundary_files import JSON_FILE, PICTURE, write_boundary
    from scenarios.studies.many.boundary.boundary_search import BoundaryQuery, find_boundary

    with clear_errors():
        low, high = _bounds_of(span)
        variant = valid_variant(scenario, overrides)
        query = BoundaryQuery(
            variant=variant,
            key=key,
            limit=parsed_limit(limit_text, variant.scenario.vehicle_names),
            low=low,
            high=high,
            precision=precision,
            seeds=seeds,
            share=0.0 if any_seed else share,
        )
        with study_engine(
            selected_workers(workers, scheduler),
            click.echo,
            out=out,
            files=(f"{PICTURE}.{picture_format}", JSON_FILE),
            identity=query.identity(),
        ) as engine:
            result = find_boundary(query, engine)
            written = write_boundary(query, result, out, picture_format)
        print_answer(query, result, Console())
        click.echo(f"written: {', '.join(map(str, written))}")


def _bounds_of(span: str) -> tuple[float, float]:
    from scenarios.definition.errors import ScenarioError

    low, _, high = span.partition(":")
    try:
        return float(low), float(high)
    except ValueError:
        wrong = f"--range: given {span!r}, allowed LOW:HIGH, such as 0:1"
        raise ScenarioError([wrong]) from None


COLUMNS: "Sequence[Column[SharePoint]]" = (
    Column("runs", lambda point: point.runs),
    Column("broken", lambda point: point.broken),
    Column("share\n%", lambda point: point.share, ".0f", 100.0),
    Column("interval\n%", lambda point: f"{100.0 * point.low:.0f} to {100.0 * point.high:.0f}"),
)


def print_answer(query: "BoundaryQuery", result: "BoundaryResult", console: "Console") -> None:
    ends = {result.low, result.high}
    columns = (Column(query.key, lambda point: point.value, "g"), *COLUMNS)
    table = table_of(columns, result.points, lambda point: "bold" if point.value in ends else None)
    print_whole(table, console)
    for line in answer_lines(query, result):
        console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)


def answer_lines(query: "BoundaryQuery", result: "BoundaryResult") -> list[str]:
    half = 0.5 * (result.high - result.low)
    share = f"at least {100.0 * query.share:g} % of the runs" if query.share else "some runs"
    low, high = (
        next(point.share for point in result.points if point.value == value)
        for value in (result.low, result.high)
    )
    lines = [
        f"{query.key} = {result.boundary:g} ± {half:.2g}: {'above' if low < high else 'below'}, "
        f"{share} break {query.limit} ({query.seeds} seeds, {result.runs} runs)"
    ]
    if query.share:
        lower, upper = (
            "none" if bound is None else f"{bound:g}"
            for bound in (result.confidence_low, result.confidence_high)
        )
        lines.append(f"95 % confidence bounds for any seeds: lower {lower}, upper {upper}")
    if result.crossings > 1:
        lines.append(
            f"there are {result.crossings} such boundaries in the range; this is the lowest"
        )
    if result.non_monotone_seeds:
        count = len(result.non_monotone_seeds)
        lines.append(
            f"{count} of {query.seeds} seeds are not monotone: they switch more than once "
            "between broken and kept as the value grows"
        )
    return lines + [f"{name}: {command}" for name, command in result.commands.items()]
