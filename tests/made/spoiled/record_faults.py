"""Faults of a recording, each as a function that states which records a reader may leave out.

A fault takes a recording and a random generator, and returns the spoiled recording.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from random import Random

from tests.made.spoiled.synthetic_drives import START, Fix, Recording

Fault = Callable[[Recording, Random], Recording]

WEEKS_1024 = 1024 * 7 * 86_400.0
"""Period (s) of the week number of GPS."""


def moved_by(fix: Fix, seconds: float) -> Fix:
    return replace(fix, time=round(fix.time + seconds, 6)) if isinstance(fix.time, float) else fix


# --- Speeds and heights: no record is lost


def zero_speeds(recording: Recording, _: Random) -> Recording:
    return recording.edited(range(len(recording.fixes)), speed=0.0)


def sparse_speeds(recording: Recording, random: Random) -> Recording:
    each = random.choice((3, 7))
    return recording.edited(
        (k for k in range(len(recording.fixes)) if k % each), speed=random.choice((None, "nan"))
    )


def garbage_speeds(recording: Recording, random: Random) -> Recording:
    spoiled = _some(recording, random, 0.1)
    return recording.edited(spoiled, speed=random.choice(("abc", "inf", "-", "1e999")))


def absurd_speed(recording: Recording, random: Random) -> Recording:
    return recording.edited([_inside(recording, random)], speed=random.choice((999.0, -999.0)))


def missing_heights(recording: Recording, random: Random) -> Recording:
    height = random.choice(("nan", -9999.0, None, "abc", 1e6))
    return recording.edited(range(len(recording.fixes)), height=height)


def some_heights(recording: Recording, random: Random) -> Recording:
    height = random.choice(("nan", -9999.0, None, 0.0))
    return recording.edited(_some(recording, random, 0.3), height=height)


# --- Times


def before_the_fix(recording: Recording, random: Random) -> Recording:
    count = random.randint(1, max(1, min(20, len(recording.fixes) // 8)))
    begin = random.choice((0.0, 315_964_800.0, START - WEEKS_1024, START + WEEKS_1024))
    first = [moved_by(fix, begin - START) for fix in recording.fixes[:count]]
    return recording.changed((*first, *recording.fixes[count:]), range(count))


def wrong_time(recording: Recording, random: Random) -> Recording:
    k = random.choice((0, _inside(recording, random), len(recording.fixes) - 1))
    least = 3.0 if 0 < k < len(recording.fixes) - 1 else 1e5
    off = random.choice((-1.0, 1.0)) * math.exp(random.uniform(math.log(least), math.log(1e9)))
    fixes = list(recording.fixes)
    fixes[k] = moved_by(fixes[k], off)
    return recording.changed(fixes, [fixes[k].truth])


def unreadable_times(recording: Recording, random: Random) -> Recording:
    return recording.edited(
        _some(recording, random, 0.05), time=random.choice((None, "abc", "nan"))
    )


def same_time(recording: Recording, _: Random) -> Recording:
    every = range(len(recording.fixes))
    return replace(recording.edited(every, time=recording.fixes[0].time), timed=False)


def no_times(recording: Recording, _: Random) -> Recording:
    return replace(recording.edited(range(len(recording.fixes)), time=None), timed=False)


def clock_set_back(recording: Recording, random: Random) -> Recording:
    k = _inside(recording, random)
    back = random.choice((1.0, 2.0, 7.0, 18.0, 60.0, 3600.0))
    fixes = recording.fixes
    return replace(
        recording.changed((*fixes[:k], *(moved_by(fix, -back) for fix in fixes[k:]))), timed=False
    )


def coarse_times(recording: Recording, _: Random) -> Recording:
    fixes = [
        replace(fix, time=float(math.floor(fix.time))) if isinstance(fix.time, float) else fix
        for fix in recording.fixes
    ]
    return replace(recording.changed(fixes), timed=recording.timed and recording.rate_hz >= 2.0)


def auto_pause(recording: Recording, random: Random) -> Recording:
    k, pause = _inside(recording, random), random.choice((600.0, 7200.0))
    fixes = recording.fixes
    paused = recording.changed((*fixes[:k], *(moved_by(fix, pause) for fix in fixes[k:])))
    return replace(paused, added_s=paused.added_s + pause)


# --- Order and repetition


def swapped_records(recording: Recording, random: Random) -> Recording:
    fixes = list(recording.fixes)
    for k in random.sample(range(len(fixes) - 1), min(4, len(fixes) // 6)):
        fixes[k], fixes[k + 1] = fixes[k + 1], fixes[k]
    return recording.changed(fixes)


def late_block(recording: Recording, random: Random) -> Recording:
    fixes, k = list(recording.fixes), _inside(recording, random)
    size = random.randint(1, max(1, min(k, len(fixes) - k, 15)))
    fixes[k - size : k + size] = [*fixes[k : k + size], *fixes[k - size : k]]
    return recording.changed(fixes)


def repeated_records(recording: Recording, random: Random) -> Recording:
    spoiled = set(_some(recording, random, 0.2))
    fixes = [
        fix
        for k, one in enumerate(recording.fixes)
        for fix in ([one, one] if k in spoiled else [one])
    ]
    return recording.changed(fixes)


def repeated_block(recording: Recording, random: Random) -> Recording:
    fixes, k = recording.fixes, _inside(recording, random)
    size = random.randint(2, max(2, min(k, 30)))
    return recording.changed((*fixes[:k], *fixes[k - size : k], *fixes[k:]))


def held_positions(recording: Recording, random: Random) -> Recording:
    """Each position is written several times with times of its own: 10 Hz in 50 or 33 Hz."""
    times = random.choice((3.3, 5.0))
    fixes: list[Fix] = []
    rate = times * recording.rate_hz
    for k, fix in enumerate(recording.fixes):
        for row in range(math.ceil(k * times), math.ceil((k + 1) * times)):
            delay = row / rate - k / recording.rate_hz
            fixes.append(moved_by(fix, round(delay, 3)))
    return recording.changed(fixes)


# --- Positions


def no_fix_first(recording: Recording, random: Random) -> Recording:
    first, count = recording.fixes[0], random.randint(1, 10)
    zero = [
        replace(moved_by(first, (k - count) / recording.rate_hz), truth=-1, degrees=(0.0, 0.0))
        for k in range(count)
    ]
    return recording.changed((*zero, *recording.fixes), [-1])


def no_fix_between(recording: Recording, random: Random) -> Recording:
    k, count = _inside(recording, random), random.randint(1, 3)
    return recording.edited(range(k, k + count), lost=True, degrees=(0.0, 0.0))


def positions_off(recording: Recording, random: Random) -> Recording:
    fixes = list(recording.fixes)
    spacing = max(math.dist((a.east, a.north), (b.east, b.north)) for a, b in pairwise(fixes))
    least = max(5.0, 3.0 * spacing, 12.0 * recording.noise)
    spoiled = random.sample(range(2, len(fixes) - 2), random.randint(1, 3))
    for k in spoiled:
        off = math.exp(random.uniform(math.log(least), math.log(5e6)))
        fixes[k] = _off(fixes[k], off, random.uniform(0.0, 2.0 * math.pi))
    return recording.changed(fixes, [fixes[k].truth for k in spoiled])


def _off(fix: Fix, off: float, angle: float) -> Fix:
    east, north = fix.east + off * math.cos(angle), fix.north + off * math.sin(angle)
    latitude, longitude = fix.latitude_longitude
    latitude += off * math.sin(angle) / 111_200.0
    if abs(latitude) > 90.0:
        latitude = math.copysign(180.0, latitude) - latitude
    longitude += off * math.cos(angle) / 74_000.0
    longitude = (longitude + 180.0) % 360.0 - 180.0
    return replace(fix, east=east, north=north, degrees=(latitude, longitude))


def _inside(recording: Recording, random: Random) -> int:
    count = len(recording.fixes)
    return random.randint(count // 4, 3 * count // 4)


def _some(recording: Recording, random: Random, share: float) -> list[int]:
    count = len(recording.fixes)
    return random.sample(range(count), max(1, int(share * count)))


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A fault, and the formats it applies to; () is each.

    Faults with a common word in `excludes` are not combined: their file has several meanings.
    """

    fault: Fault
    formats: tuple[str, ...] = ()
    excludes: frozenset[str] = frozenset()


def _kind(fault: Fault, formats: tuple[str, ...] = (), excludes: str = "") -> Kind:
    return Kind(fault=fault, formats=formats, excludes=frozenset(excludes.split()))


TIMED = ("csv", "gpx", "nmea", "log")
DATED = ("csv", "gpx", "log")
GEODETIC = ("geodetic csv", "gpx", "nmea", "log", "line")
TIMES = "first single cells clock order pause held block"

KINDS: dict[str, Kind] = {
    "held positions": _kind(held_positions, TIMED, "held"),
    "zero speeds": _kind(zero_speeds, ("csv", "nmea"), "speed"),
    "sparse speeds": _kind(sparse_speeds, ("csv",), "speed"),
    "garbage speeds": _kind(garbage_speeds, ("csv",), "speed"),
    "absurd speed": _kind(absurd_speed, ("csv", "nmea"), "speed"),
    "missing heights": _kind(missing_heights, (), "height"),
    "some heights": _kind(some_heights, (), "height"),
    "auto-pause": _kind(auto_pause, TIMED, "pause clock"),
    "clock set back": _kind(clock_set_back, TIMED, "clock order block"),
    "coarse times": _kind(coarse_times, TIMED, "clock held order block"),
    "wrong time": _kind(wrong_time, DATED, "single"),
    "unreadable times": _kind(unreadable_times, ("csv", "gpx"), "cells order"),
    "same time": _kind(same_time, DATED, TIMES),
    "no times": _kind(no_times, ("csv", "gpx"), TIMES),
    "swapped records": _kind(swapped_records, TIMED, "order"),
    "late block": _kind(late_block, TIMED, "order"),
    "repeated records": _kind(repeated_records),
    "repeated block": _kind(repeated_block, TIMED, "block"),
    "before the fix": _kind(before_the_fix, DATED, "first"),
    "no fix between": _kind(no_fix_between, GEODETIC),
    "positions off": _kind(positions_off),
    "no fix first": _kind(no_fix_first, GEODETIC),
}
"""In the order in which they are applied."""


def spoiled(recording: Recording, names: Iterable[str], seed: int) -> Recording:
    random = Random(seed)
    chosen = set(names)
    for name, kind in KINDS.items():
        if name in chosen:
            recording = kind.fault(recording, random)
    return recording


UNTIMED = ("places csv", "track csv", "kml line", "geojson line")
"""Formats without times."""

NO_EMPTY_CELLS = ("pos csv", "savetxt csv")
"""Formats in which an empty cell has no meaning."""

EMPTYING = ("unreadable times", "no times", "sparse speeds", "missing heights", "some heights")


def combined(names: Iterable[str], form: str) -> list[str]:
    result: list[str] = []
    excluded: frozenset[str] = frozenset()
    for name in names:
        kind = KINDS[name]
        applies = not kind.formats or any(form.endswith(end) for end in kind.formats)
        if form in NO_EMPTY_CELLS and name in EMPTYING:
            continue
        if form in UNTIMED and kind.excludes & {*TIMES.split()}:
            continue
        if name not in result and applies and not kind.excludes & excluded:
            result.append(name)
            excluded |= kind.excludes
    return result
