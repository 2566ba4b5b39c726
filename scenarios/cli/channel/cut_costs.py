"""The command that cuts all links of a convoy, many times, and its table."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.columns import Column, table_of
from scenarios.cli.failure import clear_errors, require

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from scenarios.studies.cuts.campaign import ReactionFigures


@click.command(
    epilog="""\b
Examples:
  convoy channel cuts --out cuts                 a minute or two on two cores
  convoy channel cuts --cuts 1000 --out cuts     half an hour
"""
)
@click.option(
    "--cuts",
    "count",
    type=click.IntRange(2, 100_000),
    default=60,
    show_default=True,
    help="How many, with each of four reactions.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("cuts"),
    show_default=True,
    help="Folder for cuts.png and cuts.json.",
)
def cuts(*, count: int, out: Path) -> None:
    """Cut all links at random instants of double lane changes: what each reaction makes of it."""
    with clear_errors():
        require("channel cuts", "studies", "matplotlib", "scipy")
    from rich.console import Console

    from scenarios.studies.cuts.campaign import PICTURE, TWIN, cuts_figure

    with clear_errors():
        found = cuts_figure(count, out, click.echo)
        print_cuts(found, Console())
        click.echo(f"written: {out / PICTURE} and {out / TWIN}")


COLUMNS: "Sequence[Column[ReactionFigures]]" = (
    Column("reaction", lambda one: one.reaction, left=True, wraps=True),
    Column("error m\nmedian", lambda one: one.error_m_median, ".2f"),
    Column("largest", lambda one: one.error_m_max, ".2f"),
    Column("on known\nroad, m", lambda one: one.error_inside_m_max, ".2f"),
    Column("blind m\nlargest", lambda one: one.blind_m_max, ".1f"),
    Column("stood\n%", lambda one: one.stood_ratio, ".0f", 100.0),
    Column("friction\nused", lambda one: one.friction_ratio_max, ".2f"),
    Column("resumed\n%", lambda one: one.resumed_ratio, ".0f", 100.0),
)


def print_cuts(found: "Sequence[ReactionFigures]", console: "Console") -> None:
    """Print what followers did with each reaction, one a row."""
    console.print(table_of(COLUMNS, found))
