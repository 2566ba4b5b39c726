"""Points in order of travel with their arc length, and projection onto a stretch of them."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from math import hypot, inf, remainder, tau
from typing import Final

from vehicles.geometry.geodesy import along
from vehicles.geometry.sparse_path import PlacedPose
from vehicles.schedule import SECOND

LONG_STEP: Final = 6.0  # Longer steps (m) are straight: the car may have turned within
LONG_DURATION: Final = SECOND  # Steps that take longer than this (ns), likewise


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

    def point(self, k: int) -> PlacedPose:
        return self.at[k], self.east[k], self.north[k], self.yaw[k]

    def append(self, point: PlacedPose, step: float) -> None:
        self.station.append(self.station[-1] + step if self.station else 0.0)
        at, east, north, yaw = point
        self.at.append(at)
        self.east.append(east)
        self.north.append(north)
        self.yaw.append(yaw)

    def insert(self, index: int, point: PlacedPose, step: float, next_step: float) -> float:
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

    def prepend(self, points: Sequence[PlacedPose]) -> None:
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

    def cut(self, count: int) -> list[PlacedPose]:
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

    def distance_from(self, east: float, north: float, low: float, high: float) -> float:
        """Distance (m) of (east, north) from the line between the stations `low` and `high` (m)."""
        if len(self.at) < 2:
            return hypot(east - self.east[0], north - self.north[0])
        station = self.nearest(east, north, low, high)
        index = min(max(bisect_right(self.station, station) - 1, 0), len(self.at) - 2)
        share = station - self.station[index]
        share /= self.station[index + 1] - self.station[index]
        off_east = self.east[index] + share * (self.east[index + 1] - self.east[index]) - east
        off_north = self.north[index] + share * (self.north[index + 1] - self.north[index]) - north
        return hypot(off_east, off_north)


def spaced(points: Sequence[PlacedPose], spacing: float) -> list[PlacedPose]:
    """Those of the `points` that are at least `spacing` (m) apart; the last one is kept."""
    kept = [points[-1]]
    for point in points[-2::-1]:
        if step(point, kept[-1]) >= spacing:
            kept.append(point)
    kept.reverse()
    return kept


def step(start: PlacedPose, end: PlacedPose) -> float:
    """Distance (m) along the travel from `start` to a later `end`; negative if that lies behind."""
    east, north = end[1] - start[1], end[2] - start[2]
    distance = hypot(east, north)
    if distance > LONG_STEP or end[0] - start[0] > LONG_DURATION:
        return distance
    yaw = start[3] + 0.5 * remainder(end[3] - start[3], tau)
    return along(yaw, east, north)
