"""The command that finds which losses of a recorded run were to blame, and its table."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from scenarios.cli.columns import Column, table_of
from scenarios.cli.common_options import folder_option
from scenarios.cli.error_lines import clear_errors, require
from scenarios.cli.many.study_options import engine_options, limit_option, selected_fleet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from scenarios.studies.many.blame.ranking import Attribution
    from scenarios.studies.many.blame.study import Blame

MOST_ROWS = 12
MOST_BURSTS = 4


@click.command(
    epilog="""\b
Examples:
  convoy blame runs/20260101-120000-lossy_lane_change --out why
  convoy blame run.mcap --limit error_m=0.5 --out why
  convoy run why/smallest.toml --clock virtual       the smallest set of losses
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@limit_option
@click.option(
    "--figure",
    type=click.Choice(["error", "gap"]),
    default="error",
    show_default=True,
    help="Rank by the largest true cross-track error, or by the smallest true gap.",
)
@folder_option("blame", "Folder for blame.png, blame.json and smallest.toml.")
@engine_options
@click.option(
    "--runs",
    "most_runs",
    type=click.IntRange(min=10),
    default=400,
    show_default=True,
    help="How many runs at most; a set that could not be shrunk to the end is marked.",
)
def blame(
    *,
    log: Path,
    limit_text: str,
    figure: Literal["error", "gap"],
    out: Path,
    workers: int | None,
    scheduler: str,
    most_runs: int,
) -> None:
    """Find which losses of a recorded LOG, or the one in a run's folder, were to blame.

    The run is driven again in virtual time with bursts of lost messages given back, all else equal:
    that ranks them by metres. Then the smallest set of losses that still breaks the limit is
    sought, and written as a scenario.
    """
    with clear_errors():
        require("blame", "studies", "matplotlib")
    from rich.console import Console

    from scenarios.definition.run_limits import parsed_limit
    from scenarios.results.log_summary import log_in, scenario_of
    from scenarios.studies.engine.engine import study_engine
    from scenarios.studies.many.blame import report, study

    with clear_errors():
        file = log_in(log)
        limit = parsed_limit(limit_text, scenario_of(file).vehicle_names)
        with study_engine(
            selected_fleet(workers, scheduler),
            click.echo,
            out=out,
            files=(report.PICTURE, report.TWIN, report.SMALLEST),
            identity=study.identity_of_blame(file, limit, figure, most_runs),
        ) as engine:
            found = study.blame(file, limit, figure, engine, most_runs=most_runs)
            written = report.write_report(found, out)
        print_blame(found, Console())
        if found.smallest is not None:
            click.echo(f"\nit breaks {limit} again: {report.command_of(out)}")
        click.echo(f"written: {', '.join(map(str, written))}")


def print_blame(found: "Blame", console: "Console") -> None:
    console.print(_opening(found), highlight=False)
    console.print(table_of(COLUMNS, found.rows[:MOST_ROWS]))
    if left := found.rows[MOST_ROWS:]:
        console.print(f"{len(left)} more in the JSON")
    console.print(_ending(found), highlight=False)


def _opening(found: "Blame") -> str:
    recorded, clean = found.recorded, found.clean
    what = "largest true error" if found.question.figure == "error" else "smallest true gap"
    messages = sum(len(burst.messages) for burst in found.bursts)
    return (
        f"{what} {recorded.figure_m:.2f} m ({recorded.vehicle}, {recorded.worst_at / 1e9:.2f} s "
        f"after the start), without any loss {clean.figure_m:.2f} m; {messages} messages lost "
        f"until a second later, in {len(found.bursts)} burst{'s' * (len(found.bursts) > 1)}"
    )


def _which(row: "Attribution") -> str:
    if row.kind == "group":
        return f"{len(row.group)} bursts, not looked into one by one"
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
    Column("given back\nmends, m", lambda row: row.mended_m, "z.3f"),
    Column("alone\nm", lambda row: row.alone.figure_m if row.alone else "", ".3f"),
    Column("breaks it\nalone", _breaks_alone),
)


def _ending(found: "Blame") -> str:
    from scenarios.studies.many.blame.losses import bursts_of

    if found.smallest is None:
        return f"{found.unshrunk} ({found.runs} runs, {found.seconds:.0f} s)"
    bursts = ", ".join(
        "{} at {:.2f} to {:.2f} s".format(burst.line, *burst.span_s)
        for burst in bursts_of(found.smallest.items)
    )
    without = (
        "without any one of them it holds"
        if found.smallest.is_minimal
        else "not shrunk to the end, for --runs is used up"
    )
    return (
        f"smallest set that breaks {found.question.limit}: {len(found.smallest.items)} messages "
        f"({bursts}); {without} ({found.runs} runs, {found.seconds:.0f} s)"
    )
