"""The path history that a vehicle sends with its pose."""

from bisect import bisect_left
from collections.abc import Callable
from itertools import pairwise
from math import asin, atan2, cos, hypot, inf, remainder, sin, tau
from typing import Final

from vehicles.car.gnss import Fix
from vehicles.geometry.geodesy import LocalPlane
from vehicles.geometry.sampled_path import (
    CHORD_TOLERANCE,
    DEGREE_UNITS,
    NO_HISTORY,
    TIME_UNIT,
    HistoryDeltas,
    Place,
    distance_from_segment,
    drivable,
)
from vehicles.schedule import SECOND

POSITION_ROUNDING: Final = 0.008  # Largest shift (m) of a position by rounding to 1e-7 degrees
TOLERANCE: Final = CHORD_TOLERANCE - 0.0005  # The rest (m) is for the curvature of the earth
SPACING: Final = 0.1  # A fix closer (m) to the last one is skipped, as of a standing car
LONGEST_CHORD: Final = 50.0
CHORDS_IN_LENGTH: Final = 4.0  # A chord is at most this fraction of the history's length
MAX_TAIL: Final = 10  # Fixes after the last possible end of a chord that are examined
LONGEST_GAP: Final = SECOND // 2  # Longer gaps (ns) without an estimate restart it
ESTIMATED_EVERY: Final = SECOND // 5  # Time (ns) from which an estimate is used
TURN_UNITS: Final = 3_600_000_000  # Units of longitude in a turn
_Units = tuple[int, int, int]  # Latitude, longitude (1e-7 deg) and instant (10 ms)


class PathHistory:
    """Chooses few of the measured positions, so that their chords represent the path driven.

    SAE J2945/1, path history: each measured position lies within `CHORD_TOLERANCE` of the chord
    between the chosen positions around it. The directions of chords from the last chosen position
    that keep it form a wedge, which each fix narrows. Once it is empty, the chord ends at the last
    fix that was in the wedge of all fixes before it. The cost of a fix does not depend on its
    length.
    """

    def __init__(self, plane: LocalPlane, length: float, points: int) -> None:
        """Keep up to `points` positions over up to `length` (m); 0 keeps none."""
        self._plane = plane
        self._length, self._points = length, points
        self._longest = min(LONGEST_CHORD, length / CHORDS_IN_LENGTH)
        self._is_on = length > 0.0 and points > 0
        self._newest: Fix | None = None
        self._clear()

    def _clear(self) -> None:
        self._last: Fix | None = None
        self._stations: list[float] = []
        self._chosen: list[_Units] = []
        self._rows: list[_Units] = []  # Differences of the chosen positions, newest first
        self._begin_chord(0.0, 0.0)

    def _begin_chord(self, east: float, north: float) -> None:
        self._east, self._north = east, north
        self._towards = self._reached = 0.0
        self._low, self._high = -inf, inf  # Limits (rad) of the wedge, relative to `_towards`
        self._end: Fix | None = None
        self._tail: list[Fix] = []

    def record(self, fix: Fix, *, on_path: bool) -> None:
        """Take the next fix; the history restarts while the car is not `on_path`."""
        if not self._is_on:
            return
        before, self._newest = self._newest, fix
        last = self._last
        if not on_path or last is None or before is None or _is_apart(before, fix):
            self._clear()
            if on_path:
                self._last = fix
                self._choose(fix)
            return
        east, north = fix.east - last.east, fix.north - last.north
        if east * cos(fix.yaw) + north * sin(fix.yaw) < SPACING:
            return
        self._last = fix
        waiting = [fix]
        while waiting:
            end = self._end
            if end is None or self._may_extend(waiting[-1]):
                self._extend(waiting.pop())
            else:
                self._tail.reverse()
                waiting += self._tail
                self._choose(end)

    def record_missing(
        self, now: int, estimate: Callable[[int], Fix | None], *, on_path: bool
    ) -> None:
        """Take a position by dead reckoning where fixes are missing at `now` (ns)."""
        newest = self._newest
        if newest is None or now - newest.measured_at < ESTIMATED_EVERY:
            return
        own = estimate(now)
        if own is not None:
            own.seq = newest.seq
            self.record(own, on_path=on_path)

    def _may_extend(self, fix: Fix) -> bool:
        """Whether a chord to `fix` or to a later fix may keep the tolerance."""
        if self._low >= self._high or len(self._tail) >= MAX_TAIL:
            return False
        return hypot(fix.east - self._east, fix.north - self._north) <= self._longest

    def _extend(self, fix: Fix) -> None:
        """Note whether the chord can end at `fix`, and narrow the wedge."""
        east, north = fix.east - self._east, fix.north - self._north
        length, direction = hypot(east, north), atan2(north, east)
        has_wedge = self._high < inf
        if not has_wedge:
            self._towards = direction
        angle = remainder(direction - self._towards, tau)
        if length >= self._reached and (
            not has_wedge
            or length * min(sin(angle - self._low), sin(self._high - angle)) >= POSITION_ROUNDING
        ):
            self._end = fix
            self._tail.clear()
        else:
            self._tail.append(fix)
        self._reached = max(self._reached, length)
        if length > TOLERANCE:
            half = asin(TOLERANCE / length)
            self._low, self._high = max(self._low, angle - half), min(self._high, angle + half)

    def _choose(self, fix: Fix) -> None:
        """Make `fix` a chosen position, from which the next chord begins."""
        latitude, longitude, altitude = self._plane.to_geodetic(fix.east, fix.north)
        units = _units(latitude, longitude, fix.measured_at)
        rounded = units[0] / DEGREE_UNITS, units[1] / DEGREE_UNITS
        east, north = self._plane.to_plane(*rounded, altitude)
        station = 0.0
        if self._chosen:
            station = self._stations[-1] + hypot(east - self._east, north - self._north)
            self._rows.insert(0, _differences(units, self._chosen[-1]))
        self._stations.append(station)
        self._chosen.append(units)
        del self._stations[: -self._points], self._chosen[: -self._points]
        del self._rows[self._points :]
        self._begin_chord(east, north)

    def deltas(self) -> HistoryDeltas:
        """The history of the newest fix."""
        newest, end = self._newest, self._end
        if newest is None or end is None:
            return NO_HISTORY
        fixes = [end, *self._tail]
        if fixes[-1] is not newest:
            fixes.append(newest)
        fixes = _chords(fixes)
        length = hypot(end.east - self._east, end.north - self._north)
        for before, fix in pairwise(fixes):
            length += hypot(fix.east - before.east, fix.north - before.north)
        heads = []
        for fix in reversed(fixes):
            latitude, longitude, _ = self._plane.to_geodetic(fix.east, fix.north)
            heads.append(_units(latitude, longitude, fix.measured_at))
        behind = self._stations[-1] + length - self._length
        within = len(self._chosen) - bisect_left(self._stations, behind)
        if within:
            heads.append(self._chosen[-1])
        rows = [_differences(newer, older) for newer, older in pairwise(heads)][: self._points]
        rows += self._rows[: max(min(self._points - len(rows), within - 1), 0)]
        latitudes, longitudes, ages = zip(*rows, strict=True) if rows else NO_HISTORY
        return latitudes, longitudes, ages


def _chords(fixes: list[Fix]) -> list[Fix]:
    """Few of the `fixes`, with the first and the last one, whose chords keep the tolerance."""
    places = [(fix.measured_at, fix.east, fix.north) for fix in fixes]
    chosen, start, last = [fixes[0]], 0, len(fixes) - 1
    while start < last:
        end = last
        while end > start + 1 and _strays(places[start : end + 1]):
            end -= 1
        chosen.append(fixes[end])
        start = end
    return chosen


def _strays(places: list[Place]) -> bool:
    """Whether a place is off the chord from the first to the last by more than the tolerance."""
    for _, east, north in places[1:-1]:
        off = distance_from_segment(places[0], places[-1], east, north)
        if off > TOLERANCE - POSITION_ROUNDING:
            return True
    return False


def _is_apart(before: Fix, fix: Fix) -> bool:
    """Whether the path between two successive fixes is unknown."""
    span = fix.measured_at - before.measured_at
    if fix.seq > before.seq + 1 and span > LONGEST_GAP:
        return True
    moved = hypot(fix.east - before.east, fix.north - before.north)
    speed = fix.speed if fix.speed > before.speed else before.speed
    return not drivable(moved, span, speed)


def _units(latitude: float, longitude: float, at: int) -> _Units:
    return round(latitude * DEGREE_UNITS), round(longitude * DEGREE_UNITS), at // TIME_UNIT


def _differences(newer: _Units, older: _Units) -> _Units:
    """Differences of an older position from a newer one; the age grows."""
    longitude = (older[1] - newer[1] + TURN_UNITS // 2) % TURN_UNITS - TURN_UNITS // 2
    return older[0] - newer[0], longitude, newer[2] - older[2]
