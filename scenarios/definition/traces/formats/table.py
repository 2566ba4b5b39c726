"""Recorded drives as tables: CSV and its relatives, RTKLIB's .pos, exports of ROS topics."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from scenarios.definition.traces.formats.columns.column_names import (
    NamedColumn,
    TableColumns,
)
from scenarios.definition.traces.formats.columns.table_layout import (
    UNUSUAL,
    TableLayout,
    cells_of,
    is_row,
    layout_of,
    padded,
)
from scenarios.definition.traces.formats.columns.table_times import in_likely_unit, times_of
from scenarios.definition.traces.formats.columns.units import ANGLES, LENGTHS, SPEEDS
from scenarios.definition.traces.formats.time_cells import TimeColumn, as_numbers
from scenarios.definition.traces.recorded_drive import (
    ALTITUDES_M,
    FASTEST,
    Floats,
    LeftOut,
    LeftOutRecords,
    RecordedDrive,
)

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
