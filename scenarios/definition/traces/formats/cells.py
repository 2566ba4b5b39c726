"""Columns of positions in degrees that grow point by point."""

import math
import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from typing import Final, NamedTuple

import numpy as np

from scenarios.definition.traces.recorded_drive import (
    NOT_A_POSITION,
    Clock,
    Floats,
    LeftOutRecords,
    RecordedDrive,
)

# ---- Times in the cells of a table: dates with and without zone, times of day, and numbers


UNITS: Final = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
"""Units of times by name, with their number in a second."""

UNIX_RANGE: Final = (1e9, 4.2e9)
"""Seconds that are read as Unix time: September 2001 to 2103."""

SHORTEST_STEP: Final = 5e-4
"""Shortest median step (s) for which the name of a column decides its unit."""

UNKNOWN: Final = frozenset(("", "nan", "NaN", "NAN", "null", "None", "N/A", "-"))
"""Cells without a value."""

ABSURD: Final = 1e30
"""Least number that no clock and no position has."""

SAMPLE: Final = 101
"""Number of cells from which the kind of a column is guessed."""

MOST_DATES: Final = 1000
"""Number of different dates in a column of uncommon form; cells with further ones are NaN."""

EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
NAIVE_EPOCH: Final = datetime(1970, 1, 1)
MICROSECOND: Final = timedelta(microseconds=1)

NO_ZONE: Final = "times have no zone: read as UTC"
MONTH_FIRST: Final = "dates such as 03/29/2026 are read with the month first"

DIGIT: Final = re.compile(r"\d")
GROUPED: Final = re.compile(r"[+-]?\d{1,3}(?:(?:,\d{3})+\.|(?:\.\d{3})+,)\d+")
"""A number with thousands in groups, such as 1,234.5 and 1.234,5."""

TIME: Final = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d+)?))?(?:\s*([AaPp])[Mm]\b)?")
YEAR_AND_SLASH: Final = re.compile(r"\d{4}/")
YEAR_FIRST: Final = re.compile(r"(\d{4})\D(\d{1,2})\D(\d{1,2})$")
YEAR_LAST: Final = re.compile(r"(\d{1,2})([./-])(\d{1,2})\2(\d{4})$")

LEAP_SECONDS: Final = tuple(
    (datetime(*date, tzinfo=UTC) - EPOCH).total_seconds()
    for date in (
        (1999, 1, 1), (2006, 1, 1), (2009, 1, 1), (2012, 7, 1), (2015, 7, 1), (2017, 1, 1),
    )
)  # fmt: skip
"""Unix times from which GPS time is ahead of UTC by 13, 14, ... s."""


@dataclass(frozen=True, slots=True)
class TimeColumn:
    """Times of the cells (s), NaN where unknown, from `zero_s` on the `clock` if there is one.

    `remarks` state assumptions on the unit, the zone and the order of dates.
    """

    seconds: Floats
    clock: Clock | None
    zero_s: float
    remarks: tuple[str, ...]


def read_times(cells: Sequence[str], unit: str | None = None) -> TimeColumn:
    """Read a column of times in one of UNITS; without `unit` its magnitude decides.

    A number of Unix time is recognised by its median magnitude, in spite of `unit`. Other
    numbers are seconds from any instant. Most of the cells decide whether the column holds
    numbers, times of day or dates; cells of another kind and unreadable cells are NaN.
    """
    stripped = [cell.strip(" \t'\"") for cell in cells]
    known = [cell for cell in stripped if cell not in UNKNOWN]
    sample = [cell for cell in known[:: max(1, len(known) // SAMPLE)] if DIGIT.search(cell)]
    if 2 * sum(_is_number(cell) for cell in sample) > len(sample):
        return _numbers(stripped, unit)
    remarks: set[str] = set()
    if 2 * sum(bool(TIME.fullmatch(cell.removesuffix("Z"))) for cell in sample) > len(sample):
        micros = np.fromiter(map(_time_of_day, stripped), float, len(stripped))
        return TimeColumn(micros / 1e6, "day", 0.0, ())
    if sample and YEAR_AND_SLASH.match(sample[0]):  # otherwise ISO 8601, which is read fast
        stripped = [cell.replace("/", "-") for cell in stripped]
    micros = _dated(stripped, remarks)
    if not np.isfinite(micros).any():
        return TimeColumn(micros, None, 0.0, ())
    return _from_zero(micros, 1e6, tuple(sorted(remarks)))


def _is_number(cell: str) -> bool:
    return abs(as_number(cell)) < ABSURD


def as_number(cell: str) -> float:
    """Return the number of a cell, with a point or a comma; NaN if it has none."""
    if "," in cell:
        whole, last = cell.rstrip(), max(cell.rfind(","), cell.rfind("."))
        if GROUPED.fullmatch(whole.lstrip()):
            cell = re.sub("[,.]", "", whole[:last]) + whole[last:]
        cell = cell.replace(",", ".", 1)
    try:
        return float(cell)
    except ValueError:
        return math.nan


def as_numbers(cells: Sequence[str]) -> Floats:
    """Return the numbers of cells, NaN where there is none or it is absurd."""
    try:
        values = np.fromiter(map(float, cells), float, len(cells))
    except ValueError:
        values = np.fromiter(map(as_number, cells), float, len(cells))
    values[~(np.abs(values) < ABSURD)] = math.nan
    return values


def _numbers(cells: Sequence[str], unit: str | None) -> TimeColumn:
    values = as_numbers(cells)
    name, unix = _unit(values[np.isfinite(values)], unit)
    if not unix:
        return TimeColumn(values / UNITS[name], None, 0.0, ())
    guessed = unit != name and (unit is not None or name != "s")
    remarks = (f"times are read as Unix time in {name}, by their magnitude",) if guessed else ()
    if name == "ns":
        try:  # a float has steps of 256 ns at today's Unix time
            whole = np.fromiter(map(int, cells), np.int64, len(cells))
        except (ValueError, OverflowError):
            return _from_zero(values, UNITS[name], remarks)
        zero = first_usual(values / 1e9)
        seconds = (whole - int(zero) * 1_000_000_000) / 1e9
        return TimeColumn(seconds, "unix", zero, remarks)
    column = _from_zero(values, UNITS[name], remarks)
    return replace(column, seconds=np.round(column.seconds, 6)) if name == "s" else column


def _unit(values: Floats, unit: str | None) -> tuple[str, bool]:
    """Return the unit of a column, and whether its values are Unix time."""
    size = float(np.median(np.abs(values)))
    least, most = UNIX_RANGE
    by_size = next((name for name, per in UNITS.items() if least * per <= size <= most * per), None)
    if unit is not None and by_size != unit:
        steps = np.abs(np.diff(values))
        step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
        if size < least * UNITS[unit] and step >= SHORTEST_STEP * UNITS[unit]:
            return unit, False
    return by_size or unit or "s", by_size is not None


def _from_zero(values: Floats, per_second: float, remarks: tuple[str, ...]) -> TimeColumn:
    """Count Unix times from a whole second, so that fractions keep their precision."""
    zero = first_usual(values / per_second)
    return TimeColumn((values - zero * per_second) / per_second, "unix", zero, remarks)


def first_usual(seconds: Floats) -> float:
    """Return the whole second of the first time near the middle one."""
    known = seconds[np.isfinite(seconds)]
    middle = np.partition(known, known.size // 2)[known.size // 2]
    return float(np.floor(known[np.argmax(np.abs(known - middle) < 1e6)]))


def _time_of_day(cell: str) -> float:
    """Return the microseconds since midnight."""
    match = TIME.match(cell)
    return _since_midnight(match) if match else math.nan


def _since_midnight(match: re.Match[str]) -> float:
    hour, minute, second, half = match.groups()
    hours = int(hour)
    if half:
        hours = hours % 12 + (12 if half in "Pp" else 0)
    whole, _, fraction = (second or "0").replace(",", ".").partition(".")
    micros = round(float(f"0.{fraction or 0}") * 1e6)
    return float(((hours * 60 + int(minute)) * 60 + int(whole)) * 1_000_000 + micros)


class _Day(NamedTuple):
    """Begin of a date: microseconds of Unix time, NaN if unreadable, and what is assumed."""

    begin: float
    remarks: frozenset[str] = frozenset()


def _dated(cells: Sequence[str], remarks: set[str]) -> Floats:
    """Return the microseconds of Unix time of dates with times."""
    days: dict[str, _Day] = {}
    micros = np.empty(len(cells))
    read, naive = datetime.fromisoformat, False
    for k, cell in enumerate(cells):
        try:
            moment = read(cell)
            if moment.tzinfo is None:
                naive = True
                micros[k] = (moment - NAIVE_EPOCH) / MICROSECOND
            else:
                micros[k] = (moment - EPOCH) / MICROSECOND
            continue
        except (ValueError, OverflowError):
            pass  # of another form
        match = TIME.search(cell)
        if match is None:
            micros[k] = math.nan
            continue
        date = f"{cell[: match.start()].rstrip(' T,_')} 00:00{cell[match.end() :]}"
        if date not in days:
            days[date] = _day(date) if len(days) < MOST_DATES else _Day(math.nan)
        micros[k] = days[date].begin + _since_midnight(match)
    if naive:
        remarks.add(NO_ZONE)
    remarks.update(*(day.remarks for day in days.values()))
    return micros


def _day(date: str) -> _Day:
    """Read a date with the time 00:00 and perhaps a zone."""
    from dateutil import parser  # noqa: PLC0415 - not in a vehicle's process

    day, _, zone = date.strip().partition(" 00:00")
    remarks = set()
    if match := YEAR_FIRST.match(day):
        day = "{}-{:0>2}-{:0>2}".format(*match.groups())
    elif match := YEAR_LAST.match(day):
        first, mark, second, year = match.groups()
        if mark == "/" and int(first) <= 12:
            first, second = second, first
            remarks.add(MONTH_FIRST)
        day = f"{year}-{second:0>2}-{first:0>2}"
    try:
        moment = parser.parse(f"{day} 00:00{zone}", tzinfos=_named_zone)
        if moment.tzinfo is None:
            remarks.add(NO_ZONE)
            moment = moment.replace(tzinfo=UTC)
        return _Day((moment - EPOCH) / MICROSECOND, frozenset(remarks))
    except (ValueError, ArithmeticError):
        return _Day(math.nan)


def _named_zone(_name: str | None, offset: int | None) -> tzinfo | None:
    """Return the zone of an offset (s); names of local zones never count."""
    return None if offset is None else timezone(timedelta(seconds=offset))


def utc_from_gps(seconds: Floats) -> Floats:
    """Convert Unix seconds of the GPS calendar, which has no leap seconds, to UTC."""
    begins = np.array(LEAP_SECONDS) + np.arange(13, 13 + len(LEAP_SECONDS))
    return np.asarray(seconds - 12.0 - np.searchsorted(begins, seconds, side="right"))


# ---- Point columns


Cell = str | float | None
"""A number, or its text; None or empty if it is missing."""


def _doubles() -> "array[float]":
    return array("d")


@dataclass(frozen=True, slots=True)
class PointColumns:
    """Points of a file by columns; `unusable` has the reasons of those without a position."""

    latitude: "array[float]" = field(default_factory=_doubles)
    longitude: "array[float]" = field(default_factory=_doubles)
    altitude: "array[float]" = field(default_factory=_doubles)
    speed: "array[float]" = field(default_factory=_doubles)
    times: list[str] = field(default_factory=list)
    unusable: dict[int, str] = field(default_factory=dict)

    def add(
        self,
        latitude: Cell,
        longitude: Cell,
        altitude: Cell = None,
        time: str = "",
        speed: Cell = None,
    ) -> None:
        try:
            north, east = float(latitude), float(longitude)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            north, east = _number(latitude), _number(longitude)
        if not math.isfinite(north + east):
            name, cell = (
                ("longitude", longitude) if math.isfinite(north) else ("latitude", latitude)
            )
            missing = cell is None or cell == ""
            self.unusable[len(self.times)] = f"no {name}" if missing else f"{name} is {cell!r:.30}"
        self.latitude.append(north)
        self.longitude.append(east)
        self.altitude.append(math.nan if altitude is None else _number(altitude))
        self.speed.append(math.nan if speed is None else _number(speed))
        self.times.append(time)

    def drive(self, left_out: LeftOutRecords | None = None, unit: str = "point") -> RecordedDrive:
        """Return the drive, without the unusable points."""
        count = len(self.times)
        times = TimeColumn(np.full(count, math.nan), None, 0.0, ())
        if any(self.times):
            times = read_times(self.times)
        drive = RecordedDrive(
            geodetic=True,
            unit=unit,
            numbers=np.arange(1, count + 1),
            position=np.array((self.latitude, self.longitude)),
            altitude_m=_known(self.altitude),
            time_s=times.seconds,
            speed_mps=_known(self.speed),
            clock=times.clock,
            zero_s=times.zero_s,
            left_out=left_out or LeftOutRecords(),
            remarks=times.remarks,
        )
        marked = np.zeros(count, dtype=bool)
        marked[list(self.unusable)] = True
        return drive.without(marked, NOT_A_POSITION, self.unusable.__getitem__)


def _number(cell: Cell) -> float:
    """Return the number of a cell, NaN if there is none."""
    try:
        return float(cell)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return as_number(str(cell))


def _known(values: "array[float]") -> Floats:
    known = np.array(values)
    known[~np.isfinite(known)] = math.nan
    return known
