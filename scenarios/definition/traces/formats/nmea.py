"""NMEA 0183: the sentences of one instant become one point."""

import functools
import math
import operator
import re
from collections import Counter
from dataclasses import dataclass
from datetime import date

import numpy as np

from scenarios.definition.traces.drive import (
    NO_FIX,
    NOT_A_POSITION,
    Clock,
    DriveTable,
    Floats,
    LeftOut,
    LeftOutRecords,
    TraceError,
)
from scenarios.definition.traces.formats.cells import DAY, as_number

KNOT = 1852.0 / 3600.0
"""Knot (m/s)."""

CONTINUOUS_S = 600.0
"""Largest step of the time between points that have one date in common."""

SENTENCE = re.compile(
    r"\$([A-OQ-Z][A-Z](?:GGA|GNS|RMC|GLL|ZDA|VTG)),([^$*]*)(?:\*([0-9A-Fa-f]{2})?)?"
)

POSITIONS = {"GGA": (1, 2, 6), "GNS": (1, 2, 6), "RMC": (1, 3, 2), "GLL": (5, 1, 6)}
"""Fields of time, latitude and status by kind; the position of the first kind counts."""

RANKS = [*POSITIONS]
UNFIT = re.compile(r"[0V]|N{1,2}")
"""Status of a position without a valid fix."""


@dataclass(slots=True)
class _NmeaPoint:
    """Values of the sentences of one time of day (s), NaN where unknown; `date` is in days."""

    number: int
    day_s: float
    rank: int = len(RANKS)
    latitude: float = math.nan
    longitude: float = math.nan
    altitude: float = math.nan
    speed: float = math.nan
    date: float = math.nan
    unfit: bool = False


def read_nmea(text: str) -> DriveTable:
    """Read the positions of GGA, GNS, RMC and GLL, with the speeds of RMC or VTG.

    Sentences of the same time become one point, in the order of their first one. Dates of RMC or
    ZDA make Unix times; without a date times of day continue over midnight. Checksums may be
    missing if all sentences lack them. Raises TraceError without a position.
    """
    left_out = LeftOutRecords()
    checked = bool(re.search(r"\$[A-Z]{2}(?:GGA|RMC|GNS|GLL),[^\r\n$*]*\*[0-9A-Fa-f]{2}", text))
    instants: dict[tuple[float, int], _NmeaPoint] = {}
    seen: Counter[tuple[float, str]] = Counter()
    latest: _NmeaPoint | None = None
    for number, line in enumerate(re.split(r"\r\n|\n|\r", text), 1):
        if line.strip() and not re.search(r"\$[A-Z]", line) and not line.startswith("!"):
            left_out.add(LeftOut(number, "not a sentence", "not a sentence"))
        for name, body, checksum in SENTENCE.findall(line):
            code = functools.reduce(operator.xor, f"{name},{body}".encode("ascii", "replace"), 0)
            if checked and not (checksum and code == int(checksum, 16)):
                left_out.add(LeftOut(number, "wrong checksum", "wrong or missing checksum"))
                continue
            fields, kind = [name, *body.split(","), *[""] * 12], name[2:]
            if kind == "VTG":
                if latest and math.isnan(latest.speed):
                    latest.speed = as_number(fields[5]) * KNOT
                continue
            day_s = _day_seconds(fields[1 if kind == "ZDA" else POSITIONS[kind][0]])
            count = -len(instants) if math.isnan(day_s) else seen[day_s, name]
            seen[day_s, name] += 1
            latest = instants.setdefault((day_s, count), _NmeaPoint(number, day_s))
            if reason := _add(latest, kind, fields, number):
                left_out.add(LeftOut(number, NOT_A_POSITION, reason))
    return _drive([*instants.values()], left_out, checked=checked)


def _add(point: _NmeaPoint, kind: str, fields: list[str], number: int) -> str:
    """Add the values of a sentence, whose position counts if its kind is the first.

    Returns what is wrong with its position.
    """
    if kind == "ZDA":
        point.date = _days(*fields[2:5])
        return ""
    if kind == "RMC":
        point.speed = as_number(fields[7]) * KNOT
        point.date = _days(fields[9][:2], fields[9][2:4], fields[9][4:])
    elif kind != "GLL":
        geoid = as_number(fields[11 if kind == "GGA" else 10])
        point.altitude = as_number(fields[9]) + (0.0 if math.isnan(geoid) else geoid)
    _, first, status = POSITIONS[kind]
    cells = fields[first : first + 4]
    latitude, longitude = _angle(cells[0], cells[1], "NS"), _angle(cells[2], cells[3], "EW")
    if not math.isfinite(latitude + longitude):
        return f"position is {','.join(cells)!r:.40}" if cells[0] and cells[2] else ""
    if RANKS.index(kind) < point.rank:
        point.rank, point.number = RANKS.index(kind), number
        point.latitude, point.longitude = latitude, longitude
        point.unfit = bool(UNFIT.fullmatch(fields[status]))
    return ""


def _drive(points: list[_NmeaPoint], left_out: LeftOutRecords, *, checked: bool) -> DriveTable:
    clock, zero_s, times = _dated(points)
    listed = {record.number for record in left_out.records}
    for point, time in zip(points, times.tolist(), strict=True):
        if math.isnan(point.latitude) and point.number not in listed:
            left_out.add(LeftOut(point.number, NO_FIX, NO_FIX, time))
    located = np.array([math.isfinite(point.latitude) for point in points], dtype=bool)
    kept, times = [point for point in points if math.isfinite(point.latitude)], times[located]
    if not kept:
        reason = "no valid GGA, RMC, GLL or GNS sentence"
        raise TraceError(", ".join((reason, *left_out.lines("line")[:1])))
    remarks = [] if checked else ["sentences have no checksums: wrong values may remain"]
    if unfit := sum(point.unfit for point in kept):
        have = "position has" if unfit == 1 else "positions have"
        remarks.append(f"{unfit} {have} quality 0 or status V: used like the others")
    return DriveTable(
        geodetic=True,
        unit="line",
        numbers=np.array([point.number for point in kept]),
        position=np.array([(point.latitude, point.longitude) for point in kept]).T,
        altitude_m=np.array([point.altitude for point in kept]),
        time_s=times,
        speed_mps=np.array([point.speed for point in kept]),
        clock=clock if np.isfinite(times).any() else None,
        zero_s=zero_s,
        left_out=left_out,
        remarks=tuple(remarks),
    )


def _dated(points: list[_NmeaPoint]) -> tuple[Clock, float, Floats]:
    """Return the clock, its zero and the times of the points on it, continued over midnight.

    Points whose times follow each other closely have the date of most of them: dates of a receiver
    before its first fix, or late at midnight, do not matter.
    """
    times = np.array([point.day_s for point in points])
    dates = np.array([point.date for point in points])
    known = np.flatnonzero(np.isfinite(times))
    times[known] += DAY * np.cumsum(np.diff(times[known], prepend=times[known][:1]) < -DAY / 2)
    begins = DAY * (dates - np.floor(times / DAY))
    if not np.isfinite(begins).any():
        return "day", 0.0, times
    begin, zero = float(np.nanmedian(begins)), math.nan
    breaks = np.flatnonzero(np.abs(np.diff(times[known])) > CONTINUOUS_S) + 1
    for piece in np.split(known, breaks):
        usable = np.sort(begins[piece][np.isfinite(begins[piece])])
        begin = float(usable[(usable.size - 1) // 2]) if usable.size else begin
        zero = begin if math.isnan(zero) else zero
        times[piece] += begin - zero
    return "unix", zero, times


def _angle(cell: str, hemisphere: str, signs: str) -> float:
    """Return the degrees of a cell dddmm.mmm, NaN without a hemisphere."""
    whole, minutes = divmod(as_number(cell), 100.0)
    letter = hemisphere.strip().upper()
    if not whole >= 0.0 or not letter or letter not in signs:
        return math.nan
    return (whole + minutes / 60.0) * (-1.0 if letter == signs[1] else 1.0)


def _day_seconds(cell: str) -> float:
    """Convert a time hhmmss.sss to seconds since midnight."""
    hour, minute, second = as_number(cell[:2]), as_number(cell[2:4]), as_number(cell[4:])
    usable = hour < 24.0 and minute < 60.0 and second < 61.0
    return hour * 3600.0 + minute * 60.0 + second if usable else math.nan


def _days(day: str, month: str, year: str) -> float:
    """Return the days since 1970 of a date; years of two digits are 1980 to 2079."""
    try:
        since = int(year) + (2000 if int(year) < 80 else 1900 if int(year) < 100 else 0)
        return float((date(since, int(month), int(day)) - date(1970, 1, 1)).days)
    except ValueError:
        return math.nan
