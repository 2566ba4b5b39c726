"""`convoy risk`, and its table."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scenarios.cli.columns import Column, table_of
from scenarios.cli.common_options import FiniteRange, folder_option, override_options
from scenarios.cli.error_lines import clear_errors
from scenarios.cli.guide import completion
from scenarios.cli.many.study_options import (
    engine_options,
    limit_option,
    selected_workers,
)
from scenarios.definition.errors import require

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from scenarios.studies.many.risk import Risk, RiskQuery


@click.command(
    epilog="""\b
Examples:
  convoy risk lossy_lane_change --limit lane --runs 500
  convoy risk lane_change --limit error_m=0.3 --set links.loss_ratio=0.5 --method splitting
"""
)
@click.argument("scenario", shell_complete=completion.scenarios)
@limit_option
@click.option(
    "--method",
    type=click.Choice(["auto", "counting", "splitting"]),
    default="auto",
    show_default=True,
    help="counting: the share of runs that break the limit. splitting, for rare events: continue"
    " the runs nearest to the limit several times, with new random numbers. auto: count first, and"
    " split if few runs break it.",
)
@click.option(
    "--measure",
    type=click.Choice(["limit", "silence"]),
    default="limit",
    show_default=True,
    help="How splitting finds the runs nearest to the limit: by the limited figure (limit), or by"
    " the longest time without data (silence).",
)
@click.option("--precision", type=FiniteRange(0.0, min_open=True), default=0.5,
              show_default=True, metavar="NUMBER",
              help="Stop at this relative half-width of the interval.")  # fmt: skip
@click.option("--runs", type=click.IntRange(min=20), default=2000, show_default=True,
              metavar="N", help="Maximum number of runs.")  # fmt: skip
@click.option("--paths", type=click.IntRange(min=2), default=50, show_default=True,
              metavar="N", help="Number of runs that splitting compares at a time.")  # fmt: skip
@override_options
@engine_options
@folder_option("risk", "Folder for risk.json.")
def risk(
    *,
    scenario: str,
    limit_text: str,
    overrides: tuple[str, ...],
    workers: int | None,
    scheduler: str,
    out: Path,
    runs: int,
    **options: Any,
) -> None:
    """Estimate the probability of a broken limit.

    Simulates SCENARIO with many seeds and estimates the probability that a run breaks the limit,
    with a 95 % confidence interval.
    """
    with clear_errors():
        require("risk", "studies", "scipy")
    from rich.console import Console

    from scenarios.studies.many.risk import JSON_FILE, RiskQuery, run_risk
    from scenarios.studies.many.variant import limited_variant

    with clear_errors():
        variant, limit = limited_variant(scenario, overrides, limit_text)
        query = RiskQuery(variant=variant, limit=limit, max_runs=runs, **options)
        estimate = run_risk(query, out, selected_workers(workers, scheduler), click.echo)
        print_risk(query, estimate, Console())
        click.echo(f"written: {out / JSON_FILE}")


COLUMNS: "Sequence[Column[tuple[RiskQuery, Risk]]]" = (
    Column("limit", lambda row: str(row[0].limit), left=True, wraps=True),
    Column("method", lambda row: row[1].method, left=True, wraps=True),
    Column("runs", lambda row: row[1].runs, wraps=True),
    Column("probability", lambda row: row[1].probability, ".3g", wraps=True),
    Column("interval, 95 %", lambda row: f"{row[1].low:.3g} to {row[1].high:.3g}", wraps=True),
    Column(
        "±, %",
        lambda row: row[1].relative_half_width if row[1].probability else None,
        ".0f",
        100.0,
        wraps=True,
    ),
)


def print_risk(query: "RiskQuery", estimate: "Risk", console: "Console") -> None:
    console.print(table_of(COLUMNS, [(query, estimate)]))
    for line in remarks(query, estimate):
        console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)


def remarks(query: "RiskQuery", estimate: "Risk") -> list[str]:
    from scenarios.studies.many.risk import NO_COMMAND, command_of

    if estimate.method == "counting":
        command = command_of(query, estimate)
        return [f"first run that broke it: {command}"] if command else ["no run broke it"]
    extinct = sum(repetition.extinct for repetition in estimate.repetitions)
    lines = [f"interval: {estimate.interval}"]
    if extinct:
        lines.append(
            f"{extinct} of {len(estimate.repetitions)} repetitions ended with all runs equally "
            "near the limit and count as 0; try more --paths or another --measure"
        )
    if not estimate.probability:
        lines.append("no run reached the limit: the interval does not bound the probability")
    return [*lines, NO_COMMAND] if estimate.probability else lines
