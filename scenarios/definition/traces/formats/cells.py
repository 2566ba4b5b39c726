"""Numbers, times and points from the cells of a text."""

import math
import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from typing import Any, NamedTuple

import numpy as np

from scenarios.definition.traces.drive import (
    NOT_A_POSITION,
    Clock,
    DriveTable,
    Floats,
    LeftOutRecords,
    TraceError,
)

UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
"""Units of times by name, with their number in a second."""

UNIX_RANGE = (1e9, 4.2e9)
"""Seconds that are read as Unix time: September 2001 to 2103."""

EXCEL_RANGE, EXCEL_EPOCH, DAY = (2e4, 8e4), 25_569.0, 86_400.0
"""Days since 1900 of a spreadsheet (1954 to 2119), those of 1970, and a day (s)."""

SHORTEST_STEP = 5e-4
"""Shortest median step (s) between records."""

UNKNOWN = frozenset(("", "nan", "NaN", "NAN", "null", "None", "N/A", "-"))
"""Cells without a value."""

ABSURD = 1e30
"""Least number that no clock and no position has."""

SAMPLE = 101
"""Number of cells from which the kind of a column is guessed."""

DATES_MAX = 1000
"""Number of different dates in a column of uncommon form; cells with further ones are NaN."""

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
MICROSECOND = timedelta(microseconds=1)

WITH_UNIT = re.compile(r"([-+\d.,]+)\s*(s|sec|ms|us|ns)\Z")
TIME = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d+)?))?(?:\s*([AaPp])[Mm]\b)?")
YEAR_FIRST = re.compile(r"(\d{4})\D(\d{1,2})\D(\d{1,2})$")
YEAR_LAST = re.compile(r"(\d{1,2})([./-])(\d{1,2})\2(\d{4})")

GPS_AHEAD_S = 18.0
"""Seconds by which GPS time is ahead of UTC since 2017."""


def as_number(cell: Any) -> float:
    """Return the number of a cell, with a point or a comma; NaN if it has none."""
    try:
        return float(cell)
    except (TypeError, ValueError, OverflowError):
        pass
    try:
        return float(str(cell).replace(",", ".", 1))
    except ValueError:
        return math.nan


def as_numbers(cells: Sequence[Any]) -> Floats:
    """Return the numbers of cells, NaN where there is none or it is absurd."""
    try:
        values = np.fromiter(map(float, cells), float, len(cells))
    except (TypeError, ValueError, OverflowError):
        values = np.fromiter(map(as_number, cells), float, len(cells))
    values[~(np.abs(values) < ABSURD)] = math.nan
    return values


# ---- Times: numbers in any unit, times of day, and dates


class TimeColumn(NamedTuple):
    """Times of the cells (s), NaN where unknown, from `zero_s` on the `clock` if there is one.

    `remarks` state assumptions on the unit, the zone and the order of dates.
    """

    seconds: Floats
    clock: Clock | None = None
    zero_s: float = 0.0
    remarks: tuple[str, ...] = ()


def read_times(cells: Sequence[str], unit: str | None = None) -> TimeColumn:
    """Read a column of times in one of UNITS; without `unit` its magnitude decides.

    A number of Unix time is recognised by its median magnitude, in spite of `unit`. Other
    numbers are seconds from any instant. Most of the cells decide whether the column holds
    numbers, times of day or dates; cells of another kind and unreadable cells are NaN.
    """
    cells = [cell.strip(" \t'\"") for cell in cells]
    known = [cell for cell in cells if cell not in UNKNOWN]
    sample = [cell for cell in known[:: max(1, len(known) // SAMPLE)] if re.search(r"\d", cell)]
    half = 0.5 * len(sample)
    if unit is None and (units := [m[2] for cell in sample if (m := WITH_UNIT.match(cell))]):
        unit = units[0].removesuffix("ec")
        cells = [match[1] if (match := WITH_UNIT.match(cell)) else cell for cell in cells]
        sample = [match[1] if (match := WITH_UNIT.match(cell)) else cell for cell in sample]
    if sum(abs(as_number(cell)) < ABSURD for cell in sample) > half:
        return _numbers(cells, unit)
    if sum(bool(TIME.fullmatch(cell.removesuffix("Z"))) for cell in sample) > half:
        return TimeColumn(np.array([_day_micros(TIME.match(cell)) for cell in cells]) / 1e6, "day")
    micros, remarks = _dates(cells)
    return _unix(micros, 1e6, remarks) if np.isfinite(micros).any() else TimeColumn(micros)


def _numbers(cells: Sequence[str], unit: str | None) -> TimeColumn:
    values = as_numbers(cells)
    known = values[np.isfinite(values)]
    steps = np.abs(np.diff(known))
    step = float(np.median(steps[steps > 0.0])) if steps.any() else 0.0
    size = float(np.median(np.abs(known)))
    least, most = UNIX_RANGE
    by_size = next((name for name, per in UNITS.items() if least * per <= size <= most * per), None)
    if unit not in (None, by_size) and size < least * UNITS[unit or "s"]:
        by_size = None if step >= SHORTEST_STEP * UNITS[unit or "s"] else by_size
    if by_size is None:
        if unit is None and EXCEL_RANGE[0] < size < EXCEL_RANGE[1] and 0.0 < step < SHORTEST_STEP:
            days = "times are read as days since 1900, as spreadsheets count"
            return _unix((values - EXCEL_EPOCH) * DAY, 1.0, (days,))
        if unit is None and (clock := _clock_digits(values, known, step)) is not None:
            return TimeColumn(clock, "day", 0.0, ("times are read as hours, minutes and seconds",))
        return TimeColumn(values / UNITS[unit or "s"])
    guessed = by_size != (unit or "s")
    remarks = (f"times are read as Unix time in {by_size}, by their magnitude",) if guessed else ()
    if by_size == "ns":
        try:  # a float has steps of 256 ns at today's Unix time
            whole = np.fromiter(map(int, cells), np.int64, len(cells))
        except (ValueError, OverflowError):
            return _unix(values, 1e9, remarks)
        zero = first_usual(values / 1e9)
        return TimeColumn((whole - int(zero) * 1_000_000_000) / 1e9, "unix", zero, remarks)
    column = _unix(values, UNITS[by_size], remarks)
    return column._replace(seconds=np.round(column.seconds, 6)) if by_size == "s" else column


def _clock_digits(values: Floats, known: Floats, step: float) -> Floats | None:
    """Return the seconds since midnight of numbers hhmmss.s; None if they are none.

    Their digits of minutes and seconds stay below 60, and leap by 40 at each minute.
    """
    minutes, seconds = known // 100 % 100, known % 100
    leaps = np.count_nonzero(np.diff(known // 100))
    usable = (known >= 0.0) & (known < 240_000.0) & (minutes < 60.0) & (seconds < 60.0)
    if not usable.all() or not leaps or not step < 40.0 or leaps > 0.5 * known.size:
        return None
    return np.asarray(values // 10_000 * 3600.0 + values // 100 % 100 * 60.0 + values % 100)


def _unix(values: Floats, per_second: float, remarks: tuple[str, ...]) -> TimeColumn:
    """Count Unix times from a whole second, so that fractions keep their precision."""
    zero = first_usual(values / per_second)
    return TimeColumn((values - zero * per_second) / per_second, "unix", zero, remarks)


def first_usual(seconds: Floats) -> float:
    """Return the whole second of the first time near the middle one."""
    known = seconds[np.isfinite(seconds)]
    middle = np.partition(known, known.size // 2)[known.size // 2]
    return float(np.floor(known[np.argmax(np.abs(known - middle) < 1e6)]))


def _day_micros(match: re.Match[str] | None) -> float:
    if match is None:
        return math.nan
    hour, minute, second, half = match.groups()
    hours = int(hour) % 12 + (12 if half in "Pp" else 0) if half else int(hour)
    micros = round(float((second or "0").replace(",", ".")) * 1e6)
    return float((hours * 60 + int(minute)) * 60_000_000 + micros)


def _dates(cells: Sequence[str]) -> tuple[Floats, tuple[str, ...]]:
    """Return the microseconds of Unix time of dates with times, and remarks."""
    slashes = {m.groups() for cell in cells if "/" in cell and (m := YEAR_LAST.search(cell))}
    month_first = _month_first({(int(a), int(b)) for a, mark, b, _ in slashes if mark == "/"})
    days: dict[str, tuple[float, bool]] = {}
    micros, naive = np.full(len(cells), math.nan), False
    for k, cell in enumerate(cells):
        try:
            moment = datetime.fromisoformat(cell)
        except ValueError:  # of another form
            match = TIME.search(cell)
            if match is None:
                continue
            date = f"{cell[: match.start()].rstrip(' T,_')} 00:00{cell[match.end() :]}"
            if date not in days:
                new = len(days) < DATES_MAX
                days[date] = _day(date, month_first=month_first) if new else (math.nan, False)
            micros[k] = days[date][0] + _day_micros(match)
        else:
            naive |= moment.tzinfo is None
            moment = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment
            micros[k] = (moment - EPOCH) / MICROSECOND
    naive |= any(no_zone for _, no_zone in days.values())
    remarks = ["dates such as 03/29/2026 are read with the month first"] if month_first else []
    return micros, (*remarks, *(["times have no zone: read as UTC"] if naive else []))


def _month_first(pairs: set[tuple[int, int]]) -> bool:
    """Whether the first number of dates such as 05/06/2026 is the month: unless times leap then."""
    if not pairs or any(first > 12 for first, _ in pairs):
        return False
    firsts, seconds = ({pair[k] for pair in pairs} for k in (0, 1))
    return max(seconds) > 12 or len(firsts) <= len(seconds)


def _day(date: str, *, month_first: bool) -> tuple[float, bool]:
    """Return the begin of a date (µs of Unix time, NaN if unreadable), and if it has no zone.

    `date` has the time 00:00, and perhaps a zone.
    """
    from dateutil import parser  # noqa: PLC0415 - not in a vehicle's process

    day, _, zone = date.strip().partition(" 00:00")
    if match := YEAR_FIRST.match(day):
        day = "{}-{:0>2}-{:0>2}".format(*match.groups())
    elif match := YEAR_LAST.fullmatch(day):
        first, mark, second, year = match.groups()
        if mark == "/" and month_first:
            first, second = second, first
        day = f"{year}-{second:0>2}-{first:0>2}"
    try:
        moment = parser.parse(f"{day} 00:00{zone}", tzinfos=_named_zone)
        in_utc = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment
        return (in_utc - EPOCH) / MICROSECOND, moment.tzinfo is None
    except (ValueError, ArithmeticError):
        return math.nan, False


def _named_zone(_name: str | None, offset: int | None) -> tzinfo | None:
    """Return the zone of an offset (s); names of local zones never count."""
    return None if offset is None else timezone(timedelta(seconds=offset))


# ---- Points


class Point(NamedTuple):
    """Cells of a point: numbers or their text, None or empty if missing."""

    latitude: Any
    longitude: Any
    altitude: Any = None
    time: str = ""
    speed: Any = None


def drive_of(
    points: Sequence[Point],
    left_out: LeftOutRecords | None = None,
    *,
    geodetic: bool = True,
) -> DriveTable:
    """Return the drive of the points that have a position, in degrees or as x and y (m)."""
    columns: list[Any] = list(zip(*points, strict=True)) or [()] * 5
    times = TimeColumn(np.full(len(points), math.nan))
    if any(columns[3]):
        times = read_times(columns[3])
    numbers = [as_numbers(columns[k]) for k in (0, 1, 2, 4)]
    drive = DriveTable(
        geodetic=geodetic,
        unit="point",
        numbers=np.arange(1, len(points) + 1),
        position=np.array(numbers[:2]),
        altitude_m=numbers[2],
        time_s=times.seconds,
        speed_mps=numbers[3],
        clock=times.clock,
        zero_s=times.zero_s,
        left_out=left_out or LeftOutRecords(),
        remarks=times.remarks,
    )
    unknown = ~np.isfinite(drive.position)

    def reason(k: int) -> str:
        axis = int(unknown[:, k].argmax())
        name, cell = ("latitude", "longitude")[axis], points[k][axis]
        return f"no {name}" if cell in (None, "") else f"{name} is {cell!r:.30}"

    return drive.without(np.any(unknown, axis=0), NOT_A_POSITION, reason)


def chosen_vehicle(names: Sequence[str], vehicle: str | None) -> str | None:
    """Return the one of a file's vehicles that is requested, or its only one; raises TraceError."""
    found = list(dict.fromkeys(names))
    shown = ", ".join(found[:12]) + (f" and {len(found) - 12} more" if len(found) > 12 else "")
    if vehicle is None and len(found) > 1:
        raise TraceError(
            f"the file holds {len(found)} vehicles, {shown}: set path.vehicle to one, or "
            "replay_vehicle of a replayed vehicle"
        )
    if vehicle is not None and vehicle not in found:
        allowed = shown or "only for a file that names vehicles"
        raise TraceError(f"given vehicle {vehicle}, allowed {allowed}")
    return vehicle or (found[0] if found else None)
