"""Recorded drives as tables: CSV and its relatives, RTKLIB's .pos, exports of ROS topics."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from scenarios.definition.traces.formats.columns.column_names import (
    NamedColumn,
    TableColumns,
    TimeSource,
    usable_columns,
)
from scenarios.definition.traces.formats.columns.table_times import (
    in_likely_unit,
    preferred_source,
    times_of,
)
from scenarios.definition.traces.formats.columns.units import ANGLES, LENGTHS, SPEEDS, degrees
from scenarios.definition.traces.formats.time_cells import TimeColumn, as_numbers
from scenarios.definition.traces.recorded_drive import (
    Floats,
    LeftOut,
    LeftOutRecords,
    RecordedDrive,
    TraceError,
)

SEPARATORS: Final = (",", ";", "\t", "|", None)
"""Separators of cells; None is any number of spaces."""

COMMENTS: Final = ("#", "%")
BLANK: Final = " ,;\t|"
UNUSUAL: Final = f"{BLANK}#%"
"""First characters of lines that may be no rows."""

MOST_BEFORE: Final = 200
"""Number of lines in which the column names are searched."""

SAMPLE: Final = 2000
"""Number of lines from which the form of the cells is guessed."""

BLOCK: Final = 4_000
"""Number of lines that are split at a time, to bound the memory."""

ALTITUDES_M: Final = (-500.0, 10_000.0)
NO_ALTITUDE: Final = 9999.0
FASTEST: Final = 150.0
"""Recorded speeds (m/s) above this are unknown."""

LEAST_SCALED: Final = 1e5
"""Median size of latitudes from which they are integers of 1e-7 deg."""

READ: Final = "latitude and longitude, x and y, or east and north"
EXAMPLE: Final = "t_s,latitude_deg,longitude_deg or t_s,x_m,y_m"


@dataclass(frozen=True, slots=True)
class _Layout:
    """How the rows of a table are read; rows of more than `most` cells are spoiled."""

    separator: str | None
    columns: TableColumns
    source: TimeSource | None
    most: int

    @property
    def time_places(self) -> list[int]:
        return [column.place for column in self.source.columns] if self.source else []


@dataclass(slots=True)
class _Rows:
    """Columns of all rows of a table; `bad` has the index, kind and reason of left out ones."""

    numbers: list[int] = field(default_factory=list)
    position: list[Floats] = field(default_factory=list)
    altitude: list[Floats] = field(default_factory=list)
    speed: list[Floats] = field(default_factory=list)
    times: list[list[str]] = field(default_factory=list)
    bad: list[tuple[int, str, str]] = field(default_factory=list)
    converted: bool = False


def read_table(text: str) -> RecordedDrive:
    """Read a table of positions with a line of column names, which may be behind # or %.

    The separator is the one with which the names are usable. A row without a readable position
    is left out; other unreadable cells are NaN. Raises TraceError without usable names.
    """
    lines = text.splitlines()
    columns, separator, first = _header(lines)
    sample = [_cells(line, separator) for line in lines[first : first + SAMPLE] if _is_row(line)]
    if sample:
        separator, sample = _separator_of_rows(lines, first, separator, columns, sample)
        columns = _with_divided_time(columns, sample)
    width = len(columns.names)
    usual = int(np.median([len(row) for row in sample])) if sample else width
    if separator == "," and usual >= 2 * width:
        raise TraceError(
            f"the rows have {usual} cells, but the header names {width}: "
            "separate the cells of decimal commas by ; instead"
        )
    source = preferred_source(columns.times, [_padded(row, width) for row in sample])
    layout = _Layout(separator, columns, source, max(width, usual))
    rows = _Rows(times=[[] for _ in layout.time_places])
    for start in range(first, len(lines), BLOCK):
        _add_block(rows, lines, start, layout)
    del lines
    return _drive(rows, columns, source)


def _is_row(line: str) -> bool:
    text = line.strip(BLANK)
    return bool(text) and not text.startswith(COMMENTS)


def _cells(line: str, separator: str | None) -> list[str]:
    """Split a single line, so that an open quote affects no other line."""
    if '"' not in line or separator is None:
        return line.split(separator)
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    except csv.Error:
        return []


def _padded(row: list[str], width: int) -> list[str]:
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
        given = given or ("" if comment else text)
    if header is None:
        raise TraceError(_without_names(given or (lines[0] if lines else "")))
    return header


def _named(line: str) -> tuple[TableColumns, str | None] | None:
    """Return the usable columns that the line names, with the separator that finds most."""
    best: tuple[TableColumns, str | None] | None = None
    for separator in SEPARATORS:
        names = _cells(line, separator)
        if separator is None:
            names = line.replace(" (", "(").replace(" [", "[").split()
        columns = usable_columns(names) if len(names) < 10_000 else None
        if columns and (best is None or columns.rank > best[0].rank):
            best = columns, separator
    return best


def _without_names(line: str) -> str:
    shown = ", ".join(cell.strip() for cell in _cells(line, _most_frequent(line)))
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
    rows = [line for line in lines[first : first + SAMPLE] if _is_row(line)]
    for other in SEPARATORS:
        split = [_cells(line, other) for line in rows]
        if 2 * sum(len(row) == len(columns.names) for row in split) > len(split):
            return other, split
    return separator, sample


def _with_divided_time(columns: TableColumns, sample: list[list[str]]) -> TableColumns:
    """Name date and time apart if the rows have a cell more than the header, as in RTKLIB's."""
    if not columns.times or int(np.median([len(row) for row in sample])) != len(columns.names) + 1:
        return columns
    source = columns.times[0]
    place = source.columns[-1].place
    row = sample[len(sample) // 2]
    names = list(columns.names)
    if sum(row[place].count(sign) for sign in "-/.") == 2:
        names.insert(place, "date")
    elif source.gps and row[place].strip().isdigit():
        names[place : place + 1] = ["week", "tow"]
    return usable_columns(names) or columns


def _add_block(rows: _Rows, lines: Sequence[str], start: int, layout: _Layout) -> None:
    """Add the rows from line `start` on."""
    columns, before = layout.columns, len(rows.numbers)
    stop = min(start + BLOCK, len(lines))
    places = [
        place
        for place, line in enumerate(lines[start:stop], start)
        if (line and line[0] not in UNUSUAL) or _is_row(line)
    ]
    if not places:
        return
    split = [_cells(lines[place], layout.separator) for place in places]
    counts = [len(row) for row in split]
    if min(counts) < len(columns.names):
        split = [_padded(row, len(columns.names)) for row in split]
    axes = range(len(columns.position))
    position = np.array([_coordinates(rows, split, columns, axis) for axis in axes])
    longer = [k for k, count in enumerate(counts) if count > layout.most]
    spoiled = {k for k in longer if any(cell.strip() for cell in split[k][layout.most :])}
    position[:, list(spoiled)] = np.nan
    for k in np.flatnonzero(~np.isfinite(position).all(axis=0)).tolist():
        if k in spoiled:
            reason = "too many cells", f"{counts[k]} cells, {layout.most} expected"
        else:
            reason = _reason(columns, split[k], position[:, k])
        rows.bad.append((before + k, *reason))
    rows.numbers.extend(place + 1 for place in places)
    rows.position.append(position)
    for values, column in ((rows.altitude, columns.altitude), (rows.speed, columns.speed)):
        if column:
            values.append(as_numbers([row[column.place] for row in split]))
    for cells, place in zip(rows.times, layout.time_places, strict=True):
        cells.extend([row[place] for row in split])


def _coordinates(rows: _Rows, split: list[list[str]], columns: TableColumns, axis: int) -> Floats:
    place = columns.position[axis].place
    cells = [row[place] for row in split]
    if columns.hemispheres:
        letter = columns.hemispheres[axis].place
        rows.converted = True
        return np.array([degrees(row[place], row[letter].strip(" \"'")) for row in split])
    values = as_numbers(cells)
    if columns.kind == "geodetic":
        for k in np.flatnonzero(np.isnan(values)).tolist():
            values[k] = degrees(cells[k])
            rows.converted |= bool(np.isfinite(values[k]))
    return values


def _reason(columns: TableColumns, row: list[str], position: Floats) -> tuple[str, str]:
    """Return kind and reason of a row whose `position` is unreadable."""
    bad = np.flatnonzero(~np.isfinite(position))
    column = columns.position[int(bad[0])]
    cell = row[column.place].strip()
    if not cell:
        return "no position", f"{column.name} is empty"
    return "not a number", f"{column.name} is {cell[:20]!r}"


def _drive(rows: _Rows, columns: TableColumns, source: TimeSource | None) -> RecordedDrive:
    remarks: list[str] = []
    count = len(rows.numbers)
    position = np.concatenate(rows.position, axis=1) if rows.position else np.empty((2, 0))
    position = _scaled_position(position, columns, remarks)
    if rows.converted:
        remarks.append("positions in degrees and minutes are converted")
    altitude = _scaled(rows.altitude, columns.altitude, LENGTHS, count, remarks)
    if columns.kind == "ecef":
        *geodetic, height = _geodetic(position)
        position, altitude = np.array(geodetic), altitude if columns.altitude else height
    geodetic_ = columns.kind != "plane"
    times = TimeColumn(np.full(count, np.nan), None, 0.0, ())
    if source:
        times = in_likely_unit(times_of(source, rows.times), source, position, geodetic=geodetic_)
    rows.times.clear()
    unusable = ~((altitude >= ALTITUDES_M[0]) & (altitude <= ALTITUDES_M[1]))
    altitude[unusable | (altitude == NO_ALTITUDE)] = np.nan
    speed = np.abs(_scaled(rows.speed, columns.speed, SPEEDS, count, remarks))
    speed[speed > FASTEST] = np.nan
    left_out = LeftOutRecords()
    good = np.ones(count, dtype=bool)
    for k, kind, reason in rows.bad:
        good[k] = False
        left_out.add(LeftOut(rows.numbers[k], kind, reason, float(times.seconds[k])))
    return RecordedDrive(
        geodetic=geodetic_,
        unit="line",
        numbers=np.array(rows.numbers, dtype=np.int64)[good],
        position=position[:, good],
        altitude_m=altitude[good],
        time_s=times.seconds[good],
        speed_mps=speed[good],
        clock=times.clock,
        zero_s=times.zero_s,
        left_out=left_out,
        remarks=(*times.remarks, *remarks),
    )


def _scaled(
    parts: list[Floats],
    column: NamedColumn | None,
    units: dict[str, float],
    count: int,
    remarks: list[str],
) -> Floats:
    """Return the values of a column in the first of the units, NaN without a column."""
    if column is None or not parts:
        return np.full(count, np.nan)
    own = next(iter(units))
    factor = units.get(column.unit or own, 1.0)
    if factor != 1.0:
        remarks.append(f"{column.name} is converted from {column.unit} to {own}")
    return np.concatenate(parts) * factor


def _scaled_position(position: Floats, columns: TableColumns, remarks: list[str]) -> Floats:
    units, own = (ANGLES, "deg") if columns.kind == "geodetic" else (LENGTHS, "m")
    unit = columns.position[0].unit
    latitudes = position[0][np.isfinite(position[0])]
    if unit is None and own == "deg" and latitudes.size:
        unit = "e7" if np.median(np.abs(latitudes)) > LEAST_SCALED else None
    factor = units.get(unit or own, 1.0)
    if factor == 1.0:
        return position
    first, second, *_ = (column.name for column in columns.position)
    shown = "1e-7 deg" if factor == ANGLES["e7"] else unit
    remarks.append(f"{first} and {second} are converted from {shown} to {own}")
    return position * factor


def _geodetic(position: Floats) -> tuple[Floats, Floats, Floats]:
    """Return latitude, longitude (deg) and height (m) of earth-centred coordinates."""
    from pymap3d import ecef2geodetic  # noqa: PLC0415 - not in a vehicle's process

    latitude, longitude, height = ecef2geodetic(*position)
    return latitude, longitude, height
