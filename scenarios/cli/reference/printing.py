"""Texts and rows at the width of a terminal."""

from collections.abc import Iterable
from inspect import cleandoc
from textwrap import fill

import click

from scenarios.cli.columns import grid_of

WIDTH = 80
Row = tuple[str, ...]


def print_text(text: str) -> None:
    paragraphs = cleandoc(text).split("\n\n")
    click.echo("\n\n".join(one if "   " in one else fill(one, WIDTH) for one in paragraphs))


def print_rows(rows: Iterable[Row]) -> None:
    from rich.console import Console

    Console().print(grid_of(rows))


def print_section(heading: str, rows: Iterable[Row], text: str = "") -> None:
    from rich.console import Console

    console = Console()
    click.echo()
    console.print(heading, style="bold", highlight=False, markup=False)
    table = grid_of(rows)
    if text:
        print_text(text)
    if text and table.row_count:
        click.echo()
    if table.row_count:
        console.print(table)
