"""Printed tables: their columns are data, and one function renders them."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:  # rich is loaded when a table is printed
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

Row = TypeVar("Row")

UNBOUNDED = 100_000


@dataclass(frozen=True, slots=True)
class Column(Generic[Row]):
    """A column: its heading, with the unit, and the value of a row.

    A number is printed as `format`, `scale` times as large, and None as "-"; several numbers are
    printed with slashes between them. Figures are aligned right and never wrap.
    """

    heading: str
    value: "Callable[[Row], float | str | Text | tuple[float | None, ...] | None]"
    format: str = ""
    scale: float = 1
    left: bool = False
    wraps: bool = False
    max_width: int | None = None

    def cell(self, row: Row) -> "str | Text":
        value = self.value(row)
        if value is None or isinstance(value, int | float):
            return figure(value, self.format, self.scale)
        if isinstance(value, tuple):
            return " / ".join(figure(number, self.format, self.scale) for number in value)
        return value


def figure(value: float | None, form: str = "", scale: float = 1) -> str:
    """Format a number, `scale` times as large; "-" if there is none."""
    return "-" if value is None else format(value * scale, form)


def table_of(
    columns: Sequence[Column[Row]],
    rows: Iterable[Row],
    style: Callable[[Row], str | None] | None = None,
    **options: Any,
) -> "Table":
    """Make a table; `style` is that of a row, `options` are those of rich's tables."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(**{"box": SIMPLE_HEAD, "padding": (0, 1, 0, 0), **options})
    for column in columns:
        table.add_column(
            column.heading,
            justify="left" if column.left else "right",
            no_wrap=not column.wraps,
            max_width=column.max_width,
        )
    for row in rows:
        cells = (column.cell(row) for column in columns)
        table.add_row(*cells, style=style(row) if style else None)
    return table


def grid_of(rows: Iterable[tuple[str, ...]]) -> "Table":
    """Make a table without headings and lines; the last column takes the remaining width."""
    from rich.markup import escape
    from rich.table import Table

    table = Table.grid(padding=(0, 2, 0, 0))
    for place, row in enumerate(rows):
        if not place:
            for _ in row[:-1]:
                table.add_column(no_wrap=True)
            table.add_column()
        table.add_row(*map(escape, row))
    return table


def print_whole(table: "Table", console: "Console") -> None:
    """Print a table without cutting its figures.

    In a narrow terminal, rich would shorten cells to an ellipsis. Tables without wrapping columns
    are printed in full width instead.
    """
    from rich.measure import Measurement

    if all(column.no_wrap for column in table.columns):
        unbounded = console.options.update(width=UNBOUNDED)
        needed = Measurement.get(console, unbounded, table).maximum
        if needed > console.width:
            table.width = needed
    console.print(table, crop=False)


def worst_rows(rows: Sequence[Row], trouble: Callable[[Row], float], most: int | None) -> list[Row]:
    """The `most` rows with the largest `trouble`, in their own order; all rows for None."""
    worst = sorted(range(len(rows)), key=lambda place: -trouble(rows[place]))[:most]
    return [rows[place] for place in sorted(worst)]
