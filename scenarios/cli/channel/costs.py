"""The command that drives a convoy over many channels, and its table."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.columns import Column, table_of
from scenarios.cli.failure import clear_errors, require

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from scenarios.studies.channel.cost_drives import Cost


@click.command(
    epilog="""\b
Examples:
  convoy channel figure --out channel            two or three minutes on two cores
  convoy channel figure --quick --out look
"""
)
@click.option("--quick", is_flag=True, help="A few drives only, to see how it looks.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("channel"),
    show_default=True,
    help="Folder for channel.png and channel.json.",
)
def figure(*, quick: bool, out: Path) -> None:
    """Drive a convoy over many channels and draw what loss, bursts and latency cost."""
    with clear_errors():
        require("channel figure", "studies", "matplotlib", "scipy")
    from rich.console import Console

    from scenarios.studies.channel.cost_drives import QUICK, Plan, lane_margin_m
    from scenarios.studies.channel.cost_report import PICTURE, TWIN, channel_figure

    with clear_errors():
        costs = channel_figure(QUICK if quick else Plan(), out, click.echo)
        print_costs(costs, lane_margin_m(), Console())
        click.echo(f"written: {out / PICTURE} and {out / TWIN}")


COLUMNS: "Sequence[Column[Cost]]" = (
    Column("gap\nm", lambda one: one.channel.gap_m, "g"),
    Column("lost\n%", lambda one: one.channel.loss_ratio, "g", 100.0),
    Column("latency\nms", lambda one: one.channel.latency_ms, "g"),
    Column("in a row,\nmean", lambda one: one.channel.burst_messages, "g"),
    Column("error m\nmedian", lambda one: one.median_m, ".2f"),
    Column("largest", lambda one: one.largest_m, ".2f"),
)


def _left_lane(lane_margin_m: float) -> "Column[Cost]":
    return Column(
        "left its\nlane", lambda one: f"{one.beyond(lane_margin_m)} of {len(one.errors_m)}"
    )


def print_costs(costs: "Sequence[Cost]", lane_margin_m: float, console: "Console") -> None:
    """Print what the last vehicle was off by over each mean burst, and over the worst channel."""
    rows = [one for one in costs if one.channel.burst_messages is not None]
    columns = (*COLUMNS, _left_lane(lane_margin_m))
    console.print(table_of(columns, rows))
