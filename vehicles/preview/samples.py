"""The window of samples around the ego, the settings of a trace, and reachability checks."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, inf, remainder, tau
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.geodesy import along
from vehicles.geometry.sampled_path import PlacedPose, drivable
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

# ---- Points in order of travel with their arc length, and projection onto a stretch of them


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


# ---- Samples


Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceSettings:
    """Constants of a trace (m unless stated otherwise), none of them in Section III-A.

    A sample is kept if it lies at least `spacing` beyond the previous one: a stopped source repeats
    its position, and a fix may lie behind another. Per call the ego's station moves back by at most
    `back`, and forward by at most `margin` plus `reach_ratio` (1) times the distance the ego moved,
    never more than `reach`. Samples further behind than `memory` are dropped; at most `capacity`
    are held. A window holds at most `max_samples`. Where messages are rare it is widened to
    `min_samples`, half of them ahead if available. A bridge has a point every `bridge_spacing` and
    is at most `bridge_length` long; a loss of the source over at least `hole` is bridged, too.
    """

    spacing: float = 0.2
    back: float = 2.0
    margin: float = 2.0
    reach: float = 10.0
    reach_ratio: float = 1.5
    memory: float = 100.0
    capacity: int = 20_000
    max_samples: int = 40
    min_samples: int = 4
    bridge_spacing: float = 1.0
    bridge_length: float = 500.0
    hole: float = 5.0


class Window(NamedTuple):
    """Samples around the ego in order of travel, arrays of one length (Section III-A, Fig. 3).

    World position (m); `station` (m) is arc length from the ego's projection, negative behind it.
    """

    east: Floats
    north: Floats
    station: Floats


def reachable(first: ReceivedPose, second: ReceivedPose) -> bool:
    """Whether one car can have been at both positions at their instants."""
    distance = hypot(second.east - first.east, second.north - first.north)
    speed = max(abs(first.speed), abs(second.speed))
    return drivable(distance, abs(second.measured_at - first.measured_at), speed)


def window_around(
    line: Polyline, ego: float, behind: float, ahead: float, settings: TraceSettings
) -> Window:
    """Samples from `behind` to `ahead` (m of travel) of the ego's station (m).

    The preview data of Section III-A, which sorts by distance and keeps none behind.

    With `behind` > 0 the nearest sample behind the ego is always included: a curve through
    samples ahead is extrapolated to the ego and may pass metres from it. Fewer than
    `min_samples` are supplemented by the next ones on both sides. More than `max_samples` are
    thinned to every second, fourth, … sample, always the same ones while the ego moves.
    """
    first = bisect_left(line.station, ego - behind)
    if behind > 0.0:
        first = min(first, max(bisect_right(line.station, ego) - 1, 0))
    last = bisect_right(line.station, ego + ahead)
    if last - first < settings.min_samples:
        first, last = _widened(line, ego, first, last, settings.min_samples)
    stride = 1 << (max(last - first - 1, 0) // settings.max_samples).bit_length()
    first += -(first + line.dropped) % stride
    chosen = slice(first, last, stride)
    return Window(
        np.array(line.east[chosen], dtype=np.float64),
        np.array(line.north[chosen], dtype=np.float64),
        np.array(line.station[chosen], dtype=np.float64) - ego,
    )


def _widened(line: Polyline, ego: float, first: int, last: int, count: int) -> tuple[int, int]:
    """Include the next samples on either side of the ego, `count` in total if there are any."""
    index, half = bisect_left(line.station, ego), count // 2
    last = max(last, min(index + half, len(line.at)))
    return max(min(first, last - count, index - half), 0), last
