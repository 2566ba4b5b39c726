"""`convoy channel figure` and `convoy channel cuts`, and their tables."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.columns import Column, table_of
from scenarios.cli.common_options import folder_option, picture_format_option
from scenarios.cli.error_lines import clear_errors, require

if TYPE_CHECKING:
    from collections.abc import Sequence

    from scenarios.studies.channel.cost_drives import Cost
    from scenarios.studies.cuts.campaign import ReactionFigures


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
    Column("gap\nm", lambda one: one.channel.gap_m, "g"),
    Column("lost\n%", lambda one: one.channel.loss_ratio, "g", 100.0),
    Column("latency\nms", lambda one: one.channel.latency_ms, "g"),
    Column("in a row,\nmean", lambda one: one.channel.burst_messages, "g"),
    Column("error m\nmedian", lambda one: one.median_m, ".2f"),
    Column("largest", lambda one: one.largest_m, ".2f"),
)


@click.command(
    epilog="""\b
Examples:
  convoy channel cuts --out cuts                 1 to 2 minutes on two cores
  convoy channel cuts --cuts 1000 --out cuts     half an hour
"""
)
@click.option(
    "--cuts",
    "count",
    type=click.IntRange(2, 100_000),
    default=60,
    show_default=True,
    metavar="N",
    help="Number of cuts. Each is simulated with four reactions.",
)
@folder_option("cuts", "Folder for the plot and cuts.json.")
@picture_format_option
def cuts(*, count: int, out: Path, picture_format: str) -> None:
    """Cut all links at random, compare reactions.

    Cuts all links at random times of double lane changes, and compares the reactions degrade,
    extrapolate, hold and straight (see `convoy reference degradation`).
    """
    with clear_errors():
        require("channel cuts", "studies", "matplotlib", "scipy")
    from rich.console import Console

    from scenarios.studies.cuts.campaign import JSON_FILE, PICTURE, run_campaign

    with clear_errors():
        found = run_campaign(count, out, click.echo, picture_format=picture_format)
        Console().print(table_of(REACTION_COLUMNS, found))
        click.echo(f"written: {out / PICTURE}.{picture_format} and {out / JSON_FILE}")


REACTION_COLUMNS: "Sequence[Column[ReactionFigures]]" = (
    Column("reaction", lambda one: one.reaction, left=True, wraps=True),
    Column("error, m\nmedian", lambda one: one.error_m_median, ".2f"),
    Column("max", lambda one: one.error_m_max, ".2f"),
    Column("on known\npath, max", lambda one: one.error_on_known_path_m_max, ".2f"),
    Column("blind, m\nmax", lambda one: one.blind_m_max, ".1f"),
    Column("stopped\n%", lambda one: one.stopped_ratio, ".0f", 100.0),
    Column("friction\nmax", lambda one: one.friction_ratio_max, ".2f"),
    Column("resumed\n%", lambda one: one.resumed_ratio, ".0f", 100.0),
)
