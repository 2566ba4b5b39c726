"""Recorded drives as tables: CSV and its relatives, RTKLIB's .pos, exports of ROS and SUMO."""

import csv
import re
from collections.abc import Sequence
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from scenarios.definition.traces.drive import (
    FASTEST,
    METRES_PER_DEGREE,
    NO_TIMES,
    NOT_A_POSITION,
    DriveTable,
    Floats,
    Ints,
    TraceError,
)
from scenarios.definition.traces.formats.cells import (
    GPS_AHEAD_S,
    UNITS,
    UNIX_RANGE,
    TimeColumn,
    as_numbers,
    chosen_vehicle,
    first_usual,
    read_times,
)
from scenarios.definition.traces.formats.column_names import (
    ANGLES,
    LENGTHS,
    SPEEDS,
    UNIT_NAMES,
    NamedColumn,
    TableColumns,
    TimeSource,
    numbered,
    usable_columns,
)

SEPARATORS = (",", ";", "\t", "|", None)
"""Separators of cells; None is any number of spaces."""

COMMENTS = ("#", "%")
BLANK = " ,;\t|"

HEADER_MAX, LINES_BEFORE_MAX = 100_000, 200
"""Largest number of characters of a header, and of lines in which it is searched."""

SAMPLE = 2000
"""Number of lines from which the form of the cells is guessed."""

BLOCK = 4_000
"""Number of lines that are split at a time, to bound the memory."""

USUAL_SPEEDS, DOUBTFUL_SPEEDS = (0.5, 70.0), (0.1, 150.0)
"""Median speeds (m/s) of a car that confirm a unit of time, and that make it doubtful."""

SHORTEST_INTERVAL = 0.005
"""Shortest median interval (s) between points in a unit considered."""

NO_ALTITUDES, ALTITUDES_M = (9999.0, -9999.0), (-500.0, 10_000.0)
"""Numbers for an unknown altitude, and the range of usable ones."""

SCALED = 1e5
"""Median size of latitudes from which they are integers of 1e-7 deg."""

EARTH_M = (6.33e6, 6.40e6)
"""Distance (m) of the earth's surface from its centre: such x, y, z are no plane coordinates."""

EXAMPLE = "t_s,latitude_deg,longitude_deg or t_s,x_m,y_m"


class TableLayout(NamedTuple):
    """How the rows of a table are read, from line index `first` on.

    Rows of more than `most` cells are spoiled. `vehicle` is to be selected by rows.
    `unused` are the names of columns whose numbers increase like times, if there is no `source`.
    """

    separator: str | None
    columns: TableColumns
    source: TimeSource | None
    most: int
    first: int
    vehicle: str | None
    unused: list[str]


def read_table(text: str, vehicle: str | None = None) -> DriveTable:
    """Read a table of positions with a line of column names, which may be behind # or %.

    The separator is the one with which the names are usable. A row without a readable position
    is left out; other unreadable cells are NaN. Raises TraceError without usable names.
    """
    lines = text.splitlines()
    layout = _layout(lines, vehicle)
    columns = layout.columns
    used = [*columns.position, columns.altitude, columns.speed, columns.vehicle, columns.height]
    used += layout.source.columns if layout.source else ()
    cells: dict[int, list[str]] = {column.place: [] for column in used if column}
    numbers: list[int] = []
    bad: dict[int, str] = {}
    for start in range(layout.first, len(lines), BLOCK):
        rows = [
            (number, _cells(line, layout.separator))
            for number, line in enumerate(lines[start : start + BLOCK], start + 1)
            if _is_row(line)
        ]
        for number, row in rows:
            if len(row) < len(columns.names):
                row.extend([""] * (len(columns.names) - len(row)))
            elif len(row) > layout.most and any(cell.strip() for cell in row[layout.most :]):
                bad[number] = f"{len(row)} cells, {layout.most} expected"
        numbers += [number for number, _ in rows]
        for place, column in cells.items():
            column.extend([row[place] for _, row in rows])
    last = len(_cells(lines[-1], layout.separator)) if numbers else 0
    is_cut = last < len(columns.names) and not text.endswith(("\n", "\r"))
    if is_cut and last - 1 in {column.place for column in columns.position}:
        bad[numbers[-1]] = "the file ends within the position"
    del lines
    if columns.vehicle:
        names = [cell.strip() for cell in cells[columns.vehicle.place]]
        distinct = [name for name in dict.fromkeys(names) if name]
        if 2 * len(distinct) <= len(names):  # otherwise they number the records
            wanted = (chosen_vehicle(distinct, layout.vehicle), "")
            mine = [k for k, name in enumerate(names) if name in wanted]
            cells = {place: [column[k] for k in mine] for place, column in cells.items()}
            numbers = [numbers[k] for k in mine]
            layout = layout._replace(vehicle=None)
    chosen_vehicle([], layout.vehicle)
    return _drive(cells, np.array(numbers, dtype=np.int64), bad, layout)


# ---- Separator, header and used columns


def _layout(lines: Sequence[str], vehicle: str | None) -> TableLayout:
    names, separator, first = _header(lines)
    sample = [_cells(line, separator) for line in lines[first : first + SAMPLE] if _is_row(line)]
    columns = usable_columns(names)
    if cars := numbered(names):
        columns = cars[chosen_vehicle([*cars], vehicle) or ""]
        vehicle = None
    if columns is None:
        raise TraceError("no usable columns")
    if sample:
        needed = max(column.place for column in columns.position)
        if 2 * sum(len(row) > needed for row in sample) < len(sample):  # another than of the names
            rows = [line for line in lines[first : first + SAMPLE] if _is_row(line)]
            splits = [(other, [_cells(row, other) for row in rows]) for other in SEPARATORS]
            full = [sum(len(row) == len(names) for row in split) for _, split in splits]
            if 2 * max(full) > len(rows):
                separator, sample = splits[full.index(max(full))]
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
    padded = [[*row, *([""] * (width - len(row)))] for row in sample]
    source = _preferred_source(columns.times, padded)
    numbers = {name: as_numbers([row[k] for row in padded]) for k, name in columns.unused}
    rising = [name for name, cells in numbers.items() if (np.diff(cells) > 0.0).all()]
    unused = [] if source or len(padded) < 2 else rising
    most = max(width, usual)
    return TableLayout(separator, columns, source, most, first, vehicle, unused)


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


def _header(lines: Sequence[str]) -> tuple[list[str], str | None, int]:
    """Return the names of the columns, their separator, and the first line of rows.

    Of several comment lines with usable names, the last one counts.
    """
    header: tuple[list[str], str | None, int] | None = None
    given: list[str] = []
    for number, line in enumerate(lines[:LINES_BEFORE_MAX], 1):
        text = line.strip()
        if not text.strip(BLANK):
            continue
        comment = text.startswith(COMMENTS)
        if named := _named(text.lstrip("#% ")):
            header = (*named, number)
        if header and not comment:
            return header if named else (header[0], header[1], number - 1)
        if not comment and not re.fullmatch(r"\W*sep=.?\W*", text):
            given.append(text)
    if header is not None:
        return header
    line = max(given[:20] or [*lines[:1], ""], key=lambda one: len(re.findall("[,;\t]", one)))
    shown = ", ".join(cell.strip() for cell in _cells(line, max(",;\t", key=line.count)))
    shown = shown[:60].encode("unicode_escape").decode() or "none"
    remedy = f"name them in the first line, such as {EXAMPLE}"
    if any(map(str.isalpha, line)):
        remedy = f"allowed latitude and longitude, x and y, or east and north, such as {EXAMPLE}"
    raise TraceError(f"no usable columns: given {shown}; {remedy}")


def _named(line: str) -> tuple[list[str], str | None] | None:
    """Return the names in a line if they are usable, with the separator that finds most."""
    best: tuple[int, list[str], str | None] = (0, [], None)
    for separator in SEPARATORS if len(line) <= HEADER_MAX else ():
        names = _cells(line, separator)
        if separator is None:
            names = line.replace(" (", "(").replace(" [", "[").split()
        columns = usable_columns(names)
        rank = columns.rank if columns else 1 if len(names) > 3 and numbered(names) else 0
        if rank > best[0]:
            best = rank, names, separator
    return best[1:] if best[0] else None


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
    place = columns.times[0].columns[-1].place
    names = list(columns.names)
    if sum(longer[len(longer) // 2][place].count(sign) for sign in "-/.") == 2:
        names.insert(place, "date")
    return usable_columns(names) or columns


# ---- Times: which columns hold them, and their likely unit


def _preferred_source(
    sources: Sequence[TimeSource], rows: Sequence[Sequence[str]]
) -> TimeSource | None:
    """Return the first source with usable times that change in a sample of rows, or else one."""
    usable = []
    for source in sources:
        cells = [[row[column.place] for row in rows] for column in source.columns]
        times = _times_of(source, cells).seconds
        known = times[np.isfinite(times)]
        if 2 * known.size > len(rows):
            usable.append((not np.ptp(known), source))
    return min(usable, key=lambda one: one[0])[1] if usable else None


def _times_of(source: TimeSource, columns: Sequence[Sequence[str]]) -> TimeColumn:
    """Read the times of a source from the cells of its columns."""
    if source.kind == "stamp":
        seconds, nanos = map(as_numbers, columns)
        known = seconds[np.isfinite(seconds)]
        unix = known.size > 0 and UNIX_RANGE[0] <= np.median(known) <= UNIX_RANGE[1]
        zero = first_usual(known) if unix else 0.0
        return TimeColumn(seconds - zero + nanos / 1e9, "unix" if unix else None, zero)
    if source.kind == "date":
        column = read_times([f"{a.strip()} {b}" for a, b in zip(*columns, strict=True)])
    else:
        column = read_times(columns[0], source.unit)
    if source.columns[-1].base != "gpst" or column.clock != "unix":
        return column
    ahead = f"times of GPS are converted to UTC: {GPS_AHEAD_S:.0f} s less"
    remarks = [remark for remark in column.remarks if "zone" not in remark]
    return column._replace(zero_s=column.zero_s - GPS_AHEAD_S, remarks=(*remarks, ahead))


def _in_likely_unit(column: TimeColumn, source: TimeSource, points: Floats) -> TimeColumn:
    """Change the unit of the times if the drive would be absurdly slow or fast in it.

    Times whose column names the unit keep it, with a remark. `points` (2, n) are in m.
    """
    if source.kind != "single" or column.clock == "day" or column.remarks:
        return column
    known = np.isfinite(column.seconds) & np.isfinite(points).all(axis=0)
    moved = np.flatnonzero(np.diff(points[:, known]).any(axis=0))
    places = np.append(moved[:1], moved + 1)
    spans = np.diff(column.seconds[known][places])
    if not (spans > 0.0).any():
        return column
    lengths = np.hypot(*np.diff(points[:, known][:, places]))
    speed = float(np.median(lengths[spans > 0.0] / spans[spans > 0.0]))
    if DOUBTFUL_SPEEDS[0] <= speed <= DOUBTFUL_SPEEDS[1]:
        return column
    interval, per_second = float(np.median(spans[spans > 0.0])), UNITS[source.unit or "s"]
    likely = [
        unit
        for unit, per in UNITS.items()
        if USUAL_SPEEDS[0] <= speed * per / per_second <= USUAL_SPEEDS[1]
        and interval * per_second / per >= SHORTEST_INTERVAL
    ]
    name = source.columns[-1].name
    fact = f"the median speed by {name} is {speed:.2g} m/s"
    if not likely:
        doubt = f"{fact}: check the units of times and positions"
        return column._replace(remarks=(doubt,) if speed > DOUBTFUL_SPEEDS[1] else ())
    if source.unit:
        advice = f"its times are probably in {likely[0]}. Rename the column to t_{likely[0]} if so"
        return column._replace(remarks=(f"{fact}: {advice}",))
    seconds = (column.seconds + column.zero_s) / UNITS[likely[0]]
    reason = f"{name} is read in {likely[0]}: in s the median speed would be {speed:.2g} m/s"
    return TimeColumn(seconds, remarks=(reason,))


# ---- The drive


def _drive(
    cells: dict[int, list[str]], numbers: Ints, bad: dict[int, str], layout: TableLayout
) -> DriveTable:
    """Return the drive of the cells by place of their column; `bad` are reasons by line."""
    columns, source, remarks = layout.columns, layout.source, list[str]()
    raw = np.array([as_numbers(cells[column.place]) for column in columns.position])
    position = _scaled_position(raw, columns, remarks)
    if columns.height and not columns.geodetic:
        _refuse_ecef(position, as_numbers(cells[columns.height.place]))
    times = TimeColumn(np.full(numbers.size, np.nan))
    if source:
        plane = position
        if columns.geodetic:
            east = position[1] * np.cos(np.radians(position[0]))
            plane = METRES_PER_DEGREE * np.array((east, position[0]))
        times = _times_of(source, [cells[column.place] for column in source.columns])
        times = _in_likely_unit(times, source, plane)
    elif layout.unused:
        remarks.append(f"columns not used: {', '.join(layout.unused)[:120]}; {NO_TIMES}")
    altitude = _scaled(cells, columns.altitude, LENGTHS, numbers.size, remarks)
    usable = (altitude >= ALTITUDES_M[0]) & (altitude <= ALTITUDES_M[1])
    altitude[~usable | np.isin(altitude, NO_ALTITUDES)] = np.nan
    speed = np.abs(_scaled(cells, columns.speed, SPEEDS, numbers.size, remarks))
    speed[speed > FASTEST] = np.nan
    drive = DriveTable(
        geodetic=columns.geodetic,
        unit="line",
        numbers=numbers,
        position=position,
        altitude_m=altitude,
        time_s=times.seconds,
        speed_mps=speed,
        clock=times.clock,
        zero_s=times.zero_s,
        remarks=(*times.remarks, *remarks),
    )

    def reason(k: int) -> str:
        column = columns.position[int((~np.isfinite(raw[:, k])).argmax())]
        cell = cells[column.place][k].strip()
        fault = f"{column.name} is {cell[:20]!r}" if cell else f"{column.name} is empty"
        return bad.get(int(numbers[k]), fault)

    unusable = ~np.isfinite(raw).all(axis=0) | np.isin(numbers, list(bad))
    return drive.without(unusable, NOT_A_POSITION, reason)


def _scaled(
    cells: dict[int, list[str]],
    column: NamedColumn | None,
    units: dict[str, float],
    count: int,
    remarks: list[str],
) -> Floats:
    """Return the values of a column in the first of the units, NaN without a column."""
    if column is None:
        return np.full(count, np.nan)
    own = next(iter(units))
    factor = units.get(column.unit or own, 1.0)
    if factor != 1.0:
        remarks.append(f"{column.name} is converted from {column.unit} to {own}")
    return as_numbers(cells[column.place]) * factor


def _scaled_position(position: Floats, columns: TableColumns, remarks: list[str]) -> Floats:
    units, own = (ANGLES, "deg") if columns.geodetic else (LENGTHS, "m")
    unit = columns.position[0].unit
    latitudes = position[0][np.isfinite(position[0])]
    if unit is None and own == "deg" and latitudes.size and np.median(np.abs(latitudes)) > SCALED:
        unit = "semicircles" if "position_lat" in columns.position[0].name.lower() else "e7"
    factor = units.get(unit or own, 1.0)
    if factor == 1.0:
        return position
    first, second, *_ = (column.name for column in columns.position)
    shown = "1e-7 deg" if factor == ANGLES["e7"] else unit
    remarks.append(f"{first} and {second} are converted from {shown} to {own}")
    return position * factor


def _refuse_ecef(position: Floats, height: Floats) -> None:
    norm = np.sqrt(np.sum(position**2, axis=0) + height**2)
    if norm.size and EARTH_M[0] < np.median(norm) < EARTH_M[1]:
        raise TraceError(
            "x, y and z count from the centre of the earth (ECEF): convert them to latitude and "
            "longitude"
        )
