"""`convoy channel figure`: a picture of what channels cost a convoy, and its figures."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.failure import clear_errors, require

if TYPE_CHECKING:
    from scenarios.studies.channel.figure.drives import Cost


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
    """Drive a convoy over many channels, and draw what loss, its bursts and latency cost."""
    with clear_errors():
        require("channel figure", "studies", "matplotlib")
    from scenarios.studies.channel.figure.drives import QUICK, Plan, lane_margin_m
    from scenarios.studies.channel.figure.figure import PICTURE, TWIN, channel_figure

    with clear_errors():
        costs = channel_figure(QUICK if quick else Plan(), out, click.echo)
        print_costs(costs, lane_margin_m())
        click.echo(f"written: {out / PICTURE} and {out / TWIN}")


def print_costs(costs: "Sequence[Cost]", lane_margin_m: float) -> None:
    """Print what the last vehicle was off by over each mean burst."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    headings = ("gap\nm", "lost\n%", "latency\nms", "in a row,\nmean", "error m\nmedian",
                "largest", "left its\nlane")  # fmt: skip
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for one in costs:
        channel, burst = one.channel, one.channel.burst_messages
        if burst is None:
            continue
        table.add_row(
            f"{channel.gap_m:g}",
            f"{100.0 * channel.loss_ratio:g}",
            f"{channel.latency_ms:g}",
            f"{burst:g}",
            f"{one.median_m:.2f}",
            f"{one.largest_m:.2f}",
            f"{one.beyond(lane_margin_m)} of {len(one.errors_m)}",
        )
    Console().print(table)
