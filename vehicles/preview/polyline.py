"""Points in order of travel with their arc length, and projection onto a stretch of them."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import atan2, cos, hypot, inf, remainder, sin, tau
from typing import Final

from vehicles.geometry.bridges import UnbridgedError, curve_between
from vehicles.schedule import SECOND

LONG_STEP: Final = 6.0
"""Steps longer than this (m) are measured straight, because the car may have turned within."""
LONG_DURATION: Final = SECOND
"""Steps that take longer than this (ns), likewise."""

Point = tuple[int, float, float, float]
"""Instant (ns), position (m, m), yaw (rad)."""


class Polyline:
    """Points with instant (ns, ascending), position (m), yaw (rad) and station (m).

    The length of a step is its component along the mean yaw of its ends, so noise across the road
    does not lengthen the line. Stations stay the same when points are dropped.
    """

    __slots__ = ("at", "dropped", "east", "north", "station", "yaw")

    def __init__(self) -> None:
        self.at: list[int] = []
        self.east: list[float] = []
        self.north: list[float] = []
        self.yaw: list[float] = []
        self.station: list[float] = []
        self.dropped = 0

    def __len__(self) -> int:
        return len(self.at)

    def point(self, k: int) -> Point:
        return self.at[k], self.east[k], self.north[k], self.yaw[k]

    def append(self, point: Point, step: float) -> None:
        self.station.append(self.station[-1] + step if self.station else 0.0)
        at, east, north, yaw = point
        self.at.append(at)
        self.east.append(east)
        self.north.append(north)
        self.yaw.append(yaw)

    def insert(self, index: int, point: Point, step: float, next_step: float) -> float:
        """Insert a point before `index` > 0, given the steps (m) to it and from it.

        Returns the shift of later stations (m).
        """
        before = self.station[index - 1]
        shift = 0.0
        if index < len(self):
            shift = before + step + next_step - self.station[index]
            self.station[index:] = [station + shift for station in self.station[index:]]
        self.station.insert(index, before + step)
        at, east, north, yaw = point
        self.at.insert(index, at)
        self.east.insert(index, east)
        self.north.insert(index, north)
        self.yaw.insert(index, yaw)
        return shift

    def prepend(self, points: Sequence[Point]) -> None:
        """Insert `points` before the first one and restart the stations at 0."""
        kept = [self.point(k) for k in range(len(self))]
        dropped = self.dropped
        self.drop(len(kept))
        self.dropped = dropped
        for point in (*points, *kept):
            self.append(point, step(self.point(-1), point) if self.at else 0.0)

    def drop(self, count: int) -> None:
        self.dropped += count
        del self.at[:count], self.east[:count], self.north[:count]
        del self.yaw[:count], self.station[:count]

    def cut(self, count: int) -> list[Point]:
        taken = [self.point(k) for k in range(count, len(self))]
        del self.at[count:], self.east[count:], self.north[count:]
        del self.yaw[count:], self.station[count:]
        return taken

    def nearest(self, east: float, north: float, low: float, high: float) -> float:
        """Station (m) from `low` to `high` that is nearest to (east, north).

        Requires at least two points and positive steps. The end segments extend beyond the ends.
        """
        last = len(self.station) - 2
        first = min(max(bisect_right(self.station, low) - 1, 0), last)
        final = min(max(bisect_left(self.station, high) - 1, first), last)
        best, station = inf, 0.0
        easts, norths, stations = self.east, self.north, self.station
        next_east, next_north = easts[first], norths[first]
        # Only the first segment can begin at `low`, and only the final one end at `high`.
        start, end = 0.0, 1.0
        if not first or low > stations[first]:
            start = (low - stations[first]) / (stations[first + 1] - stations[first])
        for k in range(first, final + 1):
            this_east, this_north = next_east, next_north
            next_east, next_north = easts[k + 1], norths[k + 1]
            if k == final and (k == last or high < stations[k + 1]):
                end = (high - stations[k]) / (stations[k + 1] - stations[k])
            span_east, span_north = next_east - this_east, next_north - this_north
            off_east, off_north = east - this_east, north - this_north
            share = (off_east * span_east + off_north * span_north) / (
                span_east * span_east + span_north * span_north
            )
            share = start if share < start else share  # noqa: FURB136 - twice as fast as max
            share = end if share > end else share  # noqa: FURB136 - twice as fast as min
            start = 0.0
            off_east -= share * span_east
            off_north -= share * span_north
            away = off_east * off_east + off_north * off_north
            if away < best:
                best = away
                station = stations[k] + share * (stations[k + 1] - stations[k])
        return station


def spaced(points: Sequence[Point], spacing: float) -> list[Point]:
    """Those of the `points` that are at least `spacing` (m) apart; the last one is kept."""
    kept = [points[-1]]
    for point in points[-2::-1]:
        if step(point, kept[-1]) >= spacing:
            kept.append(point)
    kept.reverse()
    return kept


def bridge(before: Point, after: Point, spacing: float, most: int) -> list[Point]:
    """Up to `most` points on a cubic with the positions and headings of both ends.

    The points are about `spacing` (m) apart, and their instants evenly distributed. Empty if no
    such curve joins the ends.
    """
    length = hypot(after[1] - before[1], after[2] - before[2])
    try:
        places = curve_between(before[1:4], after[1:4], max(spacing, length / most))
    except UnbridgedError:
        return []
    count, span = places.shape[1], after[0] - before[0]
    ends = [*places.T.tolist(), [after[1], after[2]]]
    points: list[Point] = []
    for k, ((east, north), (next_east, next_north)) in enumerate(pairwise(ends)):
        yaw = atan2(next_north - north, next_east - east)
        points.append((before[0] + span * (k + 1) // (count + 1), east, north, yaw))
    return points


def step(start: Point, end: Point) -> float:
    """Distance (m) along the travel from `start` to a later `end`; negative if that lies behind."""
    east, north = end[1] - start[1], end[2] - start[2]
    distance = hypot(east, north)
    if distance > LONG_STEP or end[0] - start[0] > LONG_DURATION:
        return distance
    yaw = start[3] + 0.5 * remainder(end[3] - start[3], tau)
    return east * cos(yaw) + north * sin(yaw)
