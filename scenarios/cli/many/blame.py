"""`convoy blame`, and its table."""

from pathlib import Path
from typing import TYPE_CHECKING, cast

import click

from scenarios.cli.columns import Column, table_of
from scenarios.cli.common_options import folder_option, picture_format_option
from scenarios.cli.error_lines import clear_errors
from scenarios.cli.many.study_options import (
    engine_options,
    figure_option,
    limit_option,
    selected_workers,
)
from scenarios.definition.errors import require
from scenarios.definition.schema.limit_rows import WORDS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from scenarios.studies.many.blame.ranking import Attribution
    from scenarios.studies.many.blame.rerun import FigureName
    from scenarios.studies.many.blame.study import BlameResult

MOST_ROWS = 12
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
@figure_option("Rank losses by their effect on this figure")
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
    with clear_errors():
        require("blame", "studies", "matplotlib")
    from rich.console import Console

    from scenarios.definition.run_limits import parsed_limit
    from scenarios.results.log_summary import log_in, scenario_of
    from scenarios.studies.engine.engine import study_engine
    from scenarios.studies.many.blame import blame_files, study

    with clear_errors():
        file = log_in(log)
        ranked = cast("FigureName", WORDS[figure].live)
        limit = parsed_limit(limit_text, scenario_of(file).vehicle_names)
        with study_engine(
            selected_workers(workers, scheduler),
            click.echo,
            out=out,
            files=(
                f"{blame_files.PICTURE}.{picture_format}",
                blame_files.JSON_FILE,
                blame_files.SMALLEST,
            ),
            identity=study.identity_of_blame(file, limit, ranked, max_runs),
        ) as engine:
            result = study.blame(file, limit, ranked, engine, max_runs=max_runs)
            written = blame_files.write_report(result, out, picture_format)
        print_blame(result, Console())
        if result.smallest is not None:
            click.echo(f"\nbreak {limit} again: {blame_files.command_of(out)}")
        click.echo(f"written: {', '.join(map(str, written))}")


def print_blame(result: "BlameResult", console: "Console") -> None:
    console.print(_opening(result), highlight=False)
    console.print(table_of(COLUMNS, result.rows[:MOST_ROWS]))
    if left := result.rows[MOST_ROWS:]:
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
    if row.alone is None:
        return ""
    return "no" if row.alone.broken_at is None else "yes"


COLUMNS: "Sequence[Column[Attribution]]" = (
    Column("lost", _which, left=True, wraps=True),
    Column("sent, s", lambda row: "{:.2f}-{:.2f}".format(*row.span_s)),
    Column("messages", lambda row: row.messages),
    Column("reduction if\nrestored, m", lambda row: row.reduction_m, "z.3f"),
    Column("figure\nalone, m", lambda row: row.alone.figure_m if row.alone else "", ".3f"),
    Column("breaks limit\nalone", _breaks_alone),
)


def _ending(result: "BlameResult") -> str:
    from scenarios.studies.many.blame.losses import bursts_of

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
