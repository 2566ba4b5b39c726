"""Times of a table: which columns hold them, and their likely unit."""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from scenarios.definition.traces.formats.columns.column_names import TimeSource
from scenarios.definition.traces.formats.time_cells import (
    UNITS,
    UNIX_RANGE,
    TimeColumn,
    as_numbers,
    first_usual,
    read_times,
    utc_from_gps,
)
from scenarios.definition.traces.recorded_drive import METRES_PER_DEGREE, Floats

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
