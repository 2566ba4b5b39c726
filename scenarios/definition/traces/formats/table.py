"""Recorded drives as tables: CSV and its relatives, RTKLIB's .pos, exports of ROS topics."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from typing import Final

import numpy as np

from scenarios.definition.traces.formats.cells import (
    UNITS,
    UNIX_RANGE,
    TimeColumn,
    as_numbers,
    first_usual,
    read_times,
    utc_from_gps,
)
from scenarios.definition.traces.formats.column_names import (
    ANGLES,
    LENGTHS,
    SPEEDS,
    UNIT_NAMES,
    NamedColumn,
    TableColumns,
    TimeSource,
    usable_columns,
)
from scenarios.definition.traces.recorded_drive import (
    ALTITUDES_M,
    FASTEST,
    METRES_PER_DEGREE,
    Floats,
    LeftOut,
    LeftOutRecords,
    RecordedDrive,
    TraceError,
)

# ---- Times of a table: which columns hold them, and their likely unit


USUAL_SPEEDS: Final = (0.5, 70.0)
"""Median speeds (m/s) of a car that confirm a unit of time."""

DOUBTFUL_SPEEDS: Final = (0.1, 150.0)
"""Median speeds (m/s) beyond which another unit of time is considered."""

LEAST_INTERVAL: Final = 0.005
"""Shortest median interval (s) between points in the unit considered."""


def preferred_source(
    sources: Sequence[TimeSource], rows: Sequence[Sequence[str]]
) -> TimeSource | None:
    """Return the first source whose cells fit and change in a sample of rows."""
    fitting = [source for source in sources if _fits(source, rows)]
    for source in fitting:
        places = [column.place for column in source.columns]
        values = {tuple(row[k].strip() for k in places) for row in rows}
        if len({value for value in values if any(value)}) > 1:
            return source
    return fitting[0] if fitting else None


def _fits(source: TimeSource, rows: Sequence[Sequence[str]]) -> bool:
    """Whether most dates are dates without a time, where the time is in another column."""
    if source.kind != "date":
        return True
    date, time = (column.place for column in source.columns)
    fitting = [
        bool(re.search(r"\d", row[date]))
        and ":" not in row[date]
        and ":" in row[time]
        and not re.search(r"[-/]", row[time].strip(" -"))
        for row in rows
    ]
    return 2 * sum(fitting) > len(fitting)


def times_of(source: TimeSource, columns: Sequence[Sequence[str]]) -> TimeColumn:
    """Read the times of a source from the cells of its columns."""
    if source.kind == "stamp":
        return _stamped(*map(as_numbers, columns))
    if source.kind == "date":
        column = read_times([f"{a.strip()} {b}" for a, b in zip(*columns, strict=True)])
    else:
        column = read_times(columns[0], source.unit)
    return _in_utc(column) if source.gps and column.clock == "unix" else column


def _stamped(seconds: Floats, nanos: Floats) -> TimeColumn:
    known = seconds[np.isfinite(seconds)]
    unix = known.size > 0 and UNIX_RANGE[0] <= np.median(known) <= UNIX_RANGE[1]
    zero = first_usual(known) if unix else 0.0
    return TimeColumn(seconds - zero + nanos / 1e9, "unix" if unix else None, zero, ())


def _in_utc(column: TimeColumn) -> TimeColumn:
    zero = float(utc_from_gps(np.array(column.zero_s)))
    ahead = f"times of GPS are converted to UTC: {column.zero_s - zero:.0f} s less"
    remarks = [remark for remark in column.remarks if "zone" not in remark]
    return replace(column, zero_s=zero, remarks=(*remarks, ahead))


def in_likely_unit(
    column: TimeColumn, source: TimeSource, position: Floats, *, geodetic: bool
) -> TimeColumn:
    """Change the unit of the times if the drive would be absurdly slow or fast in it.

    Times whose column names the unit keep it, with a remark. `position` is that of the rows.
    """
    named = source.unit
    if source.kind != "single" or column.clock == "day" or column.remarks:
        return column
    speed, interval = _median_speed(column.seconds, position, geodetic=geodetic)
    if DOUBTFUL_SPEEDS[0] <= speed <= DOUBTFUL_SPEEDS[1] or not speed > 0.0:
        return column
    factors = {unit: UNITS[named or "s"] / per for unit, per in UNITS.items()}
    likely = [
        unit
        for unit, factor in factors.items()
        if USUAL_SPEEDS[0] <= speed / factor <= USUAL_SPEEDS[1]
        and interval * factor >= LEAST_INTERVAL
    ]
    name = source.columns[-1].name
    if not likely:
        doubt = (
            f"the median speed by {name} is {speed:.2g} m/s: check the units of times and positions"
        )
        return replace(column, remarks=(doubt,) if speed > DOUBTFUL_SPEEDS[1] else ())
    if named:
        advice = (
            f"the median speed by {name} is {speed:.2g} m/s: its times are probably in "
            f"{likely[0]}. Rename the column to t_{likely[0]} if they are"
        )
        return replace(column, remarks=(advice,))
    seconds = (column.seconds + column.zero_s) * factors[likely[0]]
    reason = f"{name} is read in {likely[0]}: in s the median speed would be {speed:.2g} m/s"
    return TimeColumn(seconds, None, 0.0, (reason,))


def _median_speed(seconds: Floats, position: Floats, *, geodetic: bool) -> tuple[float, float]:
    """Return the median speed between different points and the median interval; 0 if unknown."""
    known = np.isfinite(seconds) & np.isfinite(position).all(axis=0)
    first, second = position[:, known]
    if geodetic:
        north = first * METRES_PER_DEGREE
        east = second * METRES_PER_DEGREE * np.cos(np.radians(first))
    else:
        east, north = first, second
    moved = np.flatnonzero(np.hypot(np.diff(east), np.diff(north)) > 0.0)
    places = np.append(moved[:1], moved + 1)
    lengths = np.hypot(np.diff(east[places]), np.diff(north[places]))
    spans = np.diff(seconds[known][places])
    usable = spans > 0.0
    if not usable.any():
        return 0.0, 0.0
    speed = float(np.median(lengths[usable] / spans[usable]))
    return speed, float(np.median(spans[usable]))


# ---- Separator, header and used columns of a table


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


# ---- Table


BLOCK: Final = 4_000
"""Number of lines that are split at a time, to bound the memory."""

NO_ALTITUDE: Final = 9999.0

DEGREES_STEP: Final = 1e-3
"""Median step (deg) between points below which x and y may be degrees."""

LEAST_SCALED: Final = 1e5
"""Median size of latitudes from which they are integers of 1e-7 deg."""


@dataclass(slots=True)
class _Rows:
    """Columns of all rows of a table; `bad` has the index, kind and reason of left out ones."""

    numbers: list[int] = field(default_factory=list)
    position: list[Floats] = field(default_factory=list)
    altitude: list[Floats] = field(default_factory=list)
    speed: list[Floats] = field(default_factory=list)
    times: list[list[str]] = field(default_factory=list)
    bad: list[tuple[int, str, str]] = field(default_factory=list)


def read_table(text: str) -> RecordedDrive:
    """Read a table of positions with a line of column names, which may be behind # or %.

    The separator is the one with which the names are usable. A row without a readable position
    is left out; other unreadable cells are NaN. Raises TraceError without usable names.
    """
    lines = text.splitlines()
    layout = layout_of(lines)
    rows = _Rows(times=[[] for _ in layout.time_places])
    for start in range(layout.first, len(lines), BLOCK):
        _add_block(rows, lines, start, layout)
    if rows.numbers and _ends_within_position(text, lines[-1], layout):
        rows.bad.append((len(rows.numbers) - 1, "cut row", "the file ends within the position"))
    del lines
    return _drive(rows, layout)


def _ends_within_position(text: str, last: str, layout: TableLayout) -> bool:
    """Whether the last row lacks its end from a cell of the position on: digits may be missing."""
    cells = len(cells_of(last, layout.separator))
    is_cut = not text.endswith(("\n", "\r")) and cells < len(layout.columns.names)
    return is_cut and any(column.place == cells - 1 for column in layout.columns.position)


def _add_block(rows: _Rows, lines: Sequence[str], start: int, layout: TableLayout) -> None:
    """Add the rows from line `start` on."""
    columns, before = layout.columns, len(rows.numbers)
    stop = min(start + BLOCK, len(lines))
    places = [
        place
        for place, line in enumerate(lines[start:stop], start)
        if (line and line[0] not in UNUSUAL) or is_row(line)
    ]
    if not places:
        return
    split = [cells_of(lines[place], layout.separator) for place in places]
    counts = [len(row) for row in split]
    if min(counts) < len(columns.names):
        split = [padded(row, len(columns.names)) for row in split]
    position = np.array(
        [as_numbers([row[column.place] for row in split]) for column in columns.position]
    )
    longer = [k for k, count in enumerate(counts) if count > layout.most]
    spoiled = {k for k in longer if any(cell.strip() for cell in split[k][layout.most :])}
    position[:, list(spoiled)] = np.nan
    unknown = ~np.isfinite(position)
    marked = np.flatnonzero(unknown.any(axis=0))
    for k, axis in zip(marked.tolist(), unknown[:, marked].argmax(axis=0).tolist(), strict=True):
        if k in spoiled:
            reason = "too many cells", f"{counts[k]} cells, {layout.most} expected"
        else:
            reason = _reason(columns.position[axis], split[k])
        rows.bad.append((before + k, *reason))
    rows.numbers.extend(place + 1 for place in places)
    rows.position.append(position)
    for values, column in ((rows.altitude, columns.altitude), (rows.speed, columns.speed)):
        if column:
            values.append(as_numbers([row[column.place] for row in split]))
    for cells, place in zip(rows.times, layout.time_places, strict=True):
        cells.extend([row[place] for row in split])


def _reason(column: NamedColumn, row: list[str]) -> tuple[str, str]:
    """Return kind and reason of a row with an unreadable position in a column."""
    cell = row[column.place].strip()
    if not cell:
        return "no position", f"{column.name} is empty"
    return "not a number", f"{column.name} is {cell[:20]!r}"


def _drive(rows: _Rows, layout: TableLayout) -> RecordedDrive:
    columns, source = layout.columns, layout.source
    remarks: list[str] = []
    count = len(rows.numbers)
    position = (
        np.concatenate(rows.position, axis=1)
        if rows.position
        else np.empty((len(columns.position), 0))
    )
    position = _scaled_position(position, columns, remarks)
    altitude = _scaled(rows.altitude, columns.altitude, LENGTHS, count, remarks)
    geodetic = columns.geodetic
    if not geodetic and columns.position[0].unit is None and _in_degrees(position):
        position, geodetic = position[::-1], True
        x, y = (column.name for column in columns.position)
        remarks.append(f"{x} and {y} are read as longitude and latitude: in m all are one place")
    times = TimeColumn(np.full(count, np.nan), None, 0.0, ())
    if source:
        times = in_likely_unit(times_of(source, rows.times), source, position, geodetic=geodetic)
    rows.times.clear()
    unusable = ~((altitude >= ALTITUDES_M[0]) & (altitude <= ALTITUDES_M[1]))
    altitude[unusable | (altitude == NO_ALTITUDE)] = np.nan
    speed = np.abs(_scaled(rows.speed, columns.speed, SPEEDS, count, remarks))
    speed[speed > FASTEST] = np.nan
    left_out = LeftOutRecords()
    good = np.ones(count, dtype=bool)
    for k, kind, reason in rows.bad:
        if good[k]:
            left_out.add(LeftOut(rows.numbers[k], kind, reason, float(times.seconds[k])))
        good[k] = False
    return RecordedDrive(
        geodetic=geodetic,
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
    units, own = (ANGLES, "deg") if columns.geodetic else (LENGTHS, "m")
    unit = columns.position[0].unit
    latitudes = position[0][np.isfinite(position[0])]
    if unit is None and own == "deg" and latitudes.size:
        scaled = "semicircles" if "position_lat" in columns.position[0].name.lower() else "e7"
        unit = scaled if np.median(np.abs(latitudes)) > LEAST_SCALED else None
    factor = units.get(unit or own, 1.0)
    if factor == 1.0:
        return position
    first, second, *_ = (column.name for column in columns.position)
    shown = "1e-7 deg" if factor == ANGLES["e7"] else unit
    remarks.append(f"{first} and {second} are converted from {shown} to {own}")
    return position * factor


def _in_degrees(position: Floats) -> bool:
    """Whether positions x, y are a drive in degrees, and within a metre if they are in metres."""
    known = position[:, np.isfinite(position).all(axis=0)]
    known = known[:, (np.abs(known[0]) <= 180.0) & (np.abs(known[1]) <= 90.0) & known.all(axis=0)]
    if 2 * known.shape[1] <= position.shape[1] or known.shape[1] < 2:
        return False
    middle = np.median(known, axis=1)
    near = known[:, np.hypot(*(known - middle[:, None])) < 1.0]
    steps = np.hypot(*np.diff(near))
    step = float(np.median(steps[steps > 0.0])) if steps.any() else 0.0
    extent = float(np.max(np.ptp(near, axis=1)))
    is_drive = 0.0 < step < DEGREES_STEP and extent > 5.0 * step
    return is_drive and extent < 1.0 and 2 * near.shape[1] > position.shape[1]
