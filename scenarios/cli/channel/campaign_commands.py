"""`convoy channel figure` and `convoy channel cuts`, and their tables."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.columns import Column, table_of
from scenarios.cli.common_options import folder_option, picture_format_option
from scenarios.cli.error_lines import clear_errors
from scenarios.definition.errors import require

if TYPE_CHECKING:
    from collections.abc import Sequence

    from scenarios.studies.channel.cost_drives import Cost
    from scenarios.studies.cuts.campaign import Comparison
    from scenarios.studies.cuts.roads import Road
    from scenarios.studies.cuts.run_figures import VariantFigures


@click.command(
    epilog="""\b
Examples:
  convoy channel figure --out channel            2 to 3 minutes on two cores
  convoy channel figure --quick --out look
"""
)
@click.option("--quick", is_flag=True, help="Simulate only a few runs, as a preview.")
@folder_option("channel", "Folder for the plot and channel.json.")
@picture_format_option
def figure(*, quick: bool, out: Path, picture_format: str) -> None:
    """Plot the cost of loss, bursts and latency.

    Simulates a lane change over many channels and plots the largest error of the last car.
    """
    with clear_errors():
        require("channel figure", "studies", "matplotlib", "scipy")
    from rich.console import Console

    from scenarios.studies.channel.cost_drives import QUICK, Plan, lane_margin_m
    from scenarios.studies.channel.cost_report import JSON_FILE, PICTURE, channel_figure

    with clear_errors():
        plan = QUICK if quick else Plan()
        costs = channel_figure(plan, out, click.echo, picture_format=picture_format)
        margin_m = lane_margin_m()
        left_lane: Column[Cost] = Column(
            "left its\nlane", lambda one: f"{one.runs_beyond(margin_m)} of {len(one.errors_m)}"
        )
        over_bursts = [one for one in costs if one.channel.burst_messages is not None]
        Console().print(table_of((*COST_COLUMNS, left_lane), over_bursts))
        click.echo(f"written: {out / PICTURE}.{picture_format} and {out / JSON_FILE}")


COST_COLUMNS: "Sequence[Column[Cost]]" = (
    Column("gap\nm", lambda row: row.channel.gap_m, "g"),
    Column("lost\n%", lambda row: row.channel.loss_ratio, "g", 100.0),
    Column("latency\nms", lambda row: row.channel.latency_ms, "g"),
    Column("in a row,\nmean", lambda row: row.channel.burst_messages, "g"),
    Column("error m\nmedian", lambda row: row.median_m, ".2f"),
    Column("largest", lambda row: row.largest_m, ".2f"),
)


@click.command(
    epilog="""\b
Examples:
  convoy channel cuts --out cuts                 5 minutes on two cores
  convoy channel cuts --cuts 1000 --out cuts     an hour
  convoy channel cuts --compare reaction --road lane_change --out reactions
"""
)
@click.option(
    "--cuts",
    "count",
    type=click.IntRange(2, 100_000),
    default=60,
    show_default=True,
    metavar="N",
    help="Number of cuts. Each is simulated with all variants.",
)
@click.option(
    "--compare",
    "comparison",
    type=click.Choice(["history", "reaction"]),
    default="history",
    show_default=True,
    help="Compare poses with and without path history, or four reactions without data.",
)
@click.option(
    "--road",
    "roads",
    type=click.Choice(["lane_change", "highway", "church_lot", "block", "slalom", "roundabout"]),
    multiple=True,
    help="Roads of the convoys; all by default.",
)
@folder_option("cuts", "Folder for the plot, cuts.json and the scenarios of failed runs.")
@picture_format_option
def cuts(
    *,
    count: int,
    comparison: "Comparison",
    roads: "Sequence[Road]",
    out: Path,
    picture_format: str,
) -> None:
    """Cut links at random, compare the followers.

    Convoys of 3 to 8 cars lose all links, those of the lead, one link or one car, once or flapping,
    for 0.2 to 8 s or permanently; some have a failing GNSS receiver. Departures from the lane are
    avoidable if the path that the car had received sufficed to stop.
    """
    with clear_errors():
        require("channel cuts", "studies", "matplotlib", "scipy")
    from rich.console import Console

    from scenarios.studies.cuts.campaign import FAILURES, JSON_FILE, PICTURE, run_campaign
    from scenarios.studies.cuts.roads import ROADS

    with clear_errors():
        summaries = run_campaign(
            count,
            out,
            click.echo,
            comparison=comparison,
            roads=roads or ROADS,
            picture_format=picture_format,
        )
        Console().print(table_of(VARIANT_COLUMNS, summaries))
        click.echo("; ".join(outcome_of(summary) for summary in summaries))
        click.echo(
            f"written: {out / PICTURE}.{picture_format}, {out / JSON_FILE}, {out / FAILURES}"
        )


def outcome_of(summary: "VariantFigures") -> str:
    return (
        f"{summary.variant}: {summary.collided} of {summary.runs} runs with collisions, "
        f"{summary.departed} left the lane, {summary.departed_avoidably} avoidably"
    )


VARIANT_COLUMNS: "Sequence[Column[VariantFigures]]" = (
    Column("variant", lambda row: row.variant, left=True, wraps=True),
    Column("runs", lambda row: row.runs, "d"),
    Column("colli-\nsions", lambda row: row.collided, "d"),
    Column("left\nlane", lambda row: row.departed, "d"),
    Column("avoid-\nably", lambda row: row.departed_avoidably, "d"),
    Column("error, m\nmedian", lambda row: row.error_m_median, ".2f"),
    Column("95 %", lambda row: row.error_m_95, ".2f"),
    Column("max", lambda row: row.error_m_max, ".2f"),
    Column("blind, m\nmax", lambda row: row.blind_m_max, ".1f"),
    Column("mis-\npredicted", lambda row: row.blind_mispredicted, "d"),
    Column("stood, s\nmax", lambda row: row.stood_s_max, ".1f"),
    Column("resumed\n%", lambda row: row.resumed_ratio, ".0f", 100.0),
)
