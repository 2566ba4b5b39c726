"""Separator, header and used columns of a table."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Final

import numpy as np

from scenarios.definition.traces.formats.columns.column_names import (
    TableColumns,
    TimeSource,
    usable_columns,
)
from scenarios.definition.traces.formats.columns.table_times import preferred_source
from scenarios.definition.traces.formats.columns.units import UNIT_NAMES
from scenarios.definition.traces.recorded_drive import TraceError

SEPARATORS: Final = (",", ";", "\t", "|", None)
"""Separators of cells; None is any number of spaces."""

SEPARATOR: Final = re.compile(r"\W*sep=.?\W*")
"""A line with which Excel names the separator."""

COMMENTS: Final = ("#", "%")
BLANK: Final = " ,;\t|"
UNUSUAL: Final = f"{BLANK}#%"
"""First characters of lines that may be no rows."""

LONGEST_HEADER: Final = 100_000
"""Number of characters above which a line is no header."""

MOST_BEFORE: Final = 200
"""Number of lines in which the column names are searched."""

SAMPLE: Final = 2000
"""Number of lines from which the form of the cells is guessed."""

READ: Final = "latitude and longitude, x and y, or east and north"
EXAMPLE: Final = "t_s,latitude_deg,longitude_deg or t_s,x_m,y_m"


@dataclass(frozen=True, slots=True)
class TableLayout:
    """How the rows of a table are read, from line index `first` on.

    Rows of more than `most` cells are spoiled.
    """

    separator: str | None
    columns: TableColumns
    source: TimeSource | None
    most: int
    first: int

    @property
    def time_places(self) -> list[int]:
        return [column.place for column in self.source.columns] if self.source else []


def layout_of(lines: Sequence[str]) -> TableLayout:
    """Find the header and the form of the rows. Raises TraceError without usable names."""
    columns, separator, first = _header(lines)
    sample = [cells_of(line, separator) for line in lines[first : first + SAMPLE] if is_row(line)]
    if sample:
        separator, sample = _separator_of_rows(lines, first, separator, columns, sample)
        columns = _with_divided_time(columns, sample)
        if units := _units(columns, sample[0]):
            columns, first, sample = units, first + 1, sample[1:]
    if any("d'" in column.name for column in columns.position):
        raise TraceError(
            "degrees, minutes and seconds in separate cells: "
            "export decimal degrees (RTKLIB: out-outdegform = deg)"
        )
    width = len(columns.names)
    usual = int(np.median([len(row) for row in sample])) if sample else width
    if separator == "," and usual >= 2 * width:
        raise TraceError(
            f"the rows have {usual} cells, but the header names {width}: "
            "separate the cells of decimal commas by ; instead"
        )
    source = preferred_source(columns.times, [padded(row, width) for row in sample])
    return TableLayout(separator, columns, source, max(width, usual), first)


def is_row(line: str) -> bool:
    text = line.strip(BLANK)
    return bool(text) and not text.startswith(COMMENTS)


def cells_of(line: str, separator: str | None) -> list[str]:
    """Split a single line, so that an open quote affects no other line."""
    if '"' not in line or separator is None:
        return line.split(separator)
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    except csv.Error:
        return []


def padded(row: list[str], width: int) -> list[str]:
    return row if len(row) >= width else [*row, *[""] * (width - len(row))]


def _header(lines: Sequence[str]) -> tuple[TableColumns, str | None, int]:
    """Return the usable columns, the separator of their names, and the first line of rows.

    Of several comment lines with usable names, the last one counts.
    """
    header: tuple[TableColumns, str | None, int] | None = None
    given = ""
    for number, line in enumerate(lines[:MOST_BEFORE], 1):
        text = line.strip()
        if not text.strip(BLANK):
            continue
        comment = text.startswith(COMMENTS)
        if named := _named(text.lstrip("#% ")):
            header = (*named, number)
        if header and not comment:
            return header if named else (header[0], header[1], number - 1)
        given = given or ("" if comment or SEPARATOR.fullmatch(text) else text)
    if header is None:
        raise TraceError(_without_names(given or (lines[0] if lines else "")))
    return header


def _named(line: str) -> tuple[TableColumns, str | None] | None:
    """Return the usable columns that the line names, with the separator that finds most."""
    best: tuple[TableColumns, str | None] | None = None
    if len(line) > LONGEST_HEADER:
        return None
    for separator in SEPARATORS:
        names = cells_of(line, separator)
        if separator is None:
            names = line.replace(" (", "(").replace(" [", "[").split()
        columns = usable_columns(names)
        if columns and (best is None or columns.rank > best[0].rank):
            best = columns, separator
    return best


def _without_names(line: str) -> str:
    shown = ", ".join(cell.strip() for cell in cells_of(line, _most_frequent(line)))
    given = shown[:60].encode("unicode_escape").decode() or "none"
    numeric = not any(letter.isalpha() for letter in line)
    remedy = f"name them in the first line, such as {EXAMPLE}" if numeric else f"allowed {READ}, "
    return f"no usable columns: given {given}; {remedy}" + ("" if numeric else f"such as {EXAMPLE}")


def _most_frequent(line: str) -> str:
    return max(",;\t", key=line.count)


def _separator_of_rows(
    lines: Sequence[str],
    first: int,
    separator: str | None,
    columns: TableColumns,
    sample: list[list[str]],
) -> tuple[str | None, list[list[str]]]:
    """Return the separator of the rows, which may be another than that of the names."""
    needed = max(column.place for column in columns.position)
    if 2 * sum(len(row) > needed for row in sample) >= len(sample):
        return separator, sample
    rows = [line for line in lines[first : first + SAMPLE] if is_row(line)]
    for other in SEPARATORS:
        split = [cells_of(line, other) for line in rows]
        if 2 * sum(len(row) == len(columns.names) for row in split) > len(split):
            return other, split
    return separator, sample


def _units(columns: TableColumns, row: list[str]) -> TableColumns | None:
    """Return the columns with the units of the row, if it is a row of units."""
    cells = [cell.strip(" \"'[]()").lower() for cell in row]
    if sum(cell in UNIT_NAMES for cell in cells) < 2 or any(map(str.isdigit, "".join(cells))):
        return None
    pairs = zip_longest(columns.names, cells[: len(columns.names)], fillvalue="")
    return usable_columns([f"{name} ({unit})" if unit else name for name, unit in pairs])


def _with_divided_time(columns: TableColumns, sample: list[list[str]]) -> TableColumns:
    """Name date and time apart if the rows have a cell more than the header, as in RTKLIB's."""
    longer = [row for row in sample if len(row) == len(columns.names) + 1]
    if not columns.times or 2 * len(longer) <= len(sample):
        return columns
    source = columns.times[0]
    place = source.columns[-1].place
    row = longer[len(longer) // 2]
    names = list(columns.names)
    if sum(row[place].count(sign) for sign in "-/.") == 2:
        names.insert(place, "date")
    return usable_columns(names) or columns
