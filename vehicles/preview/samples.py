"""Points in order of travel, the window of samples around the ego, and reachability checks."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import accumulate, pairwise
from math import cos, hypot, inf, remainder, sin, tau
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.sampled_path import PlacedPose
from vehicles.schedule import SECOND

Floats = NDArray[np.float64]

LONG_STEP: Final = 6.0  # Longer steps (m) are straight: the car may have turned within
LONG_DURATION: Final = SECOND  # Steps that take longer than this (ns), likewise
MAX_SAMPLES: Final = 40  # Largest number of samples in a window
MIN_SAMPLES: Final = 4  # A window with fewer samples is widened, half of them ahead


class Polyline:
    """Points with instant (ns, ascending), position (m) and yaw (rad), and the station (m) of each.

    The length of a step is its component along the mean yaw of its ends, so noise across the road
    does not lengthen the line. Stations stay the same when points are dropped.
    """

    __slots__ = ("at", "dropped", "points", "station")

    def __init__(self) -> None:
        self.at: list[int] = []
        self.points: list[PlacedPose] = []
        self.station: list[float] = []
        self.dropped = 0

    def __len__(self) -> int:
        return len(self.at)

    def point(self, k: int) -> PlacedPose:
        return self.points[k]

    def append(self, point: PlacedPose, step: float) -> None:
        self.station.append(self.station[-1] + step if self.station else 0.0)
        self.points.append(point)
        self.at.append(point[0])

    def insert(self, index: int, point: PlacedPose) -> float:
        """Insert a point between two others, before `index`; return the shift of the rest (m)."""
        station = self.station[index - 1] + step(self.points[index - 1], point)
        shift = station + step(point, self.points[index]) - self.station[index]
        self.station[index:] = [station, *[later + shift for later in self.station[index:]]]
        self.points.insert(index, point)
        self.at.insert(index, point[0])
        return shift

    def prepend(self, points: Sequence[PlacedPose]) -> None:
        """Insert `points` before the first one and restart the stations at 0."""
        self.points[:0] = points
        self.at[:0] = [point[0] for point in points]
        steps = [step(start, end) for start, end in pairwise(self.points)]
        self.station = list(accumulate(steps, initial=0.0))

    def drop(self, count: int) -> None:
        self.dropped += count
        del self.at[:count], self.points[:count], self.station[:count]

    def nearest(self, east: float, north: float, low: float, high: float) -> float:
        """Station (m) from `low` to `high` that is nearest to (east, north).

        Requires at least two points and positive steps. The end segments extend beyond the ends.
        """
        points, stations = self.points, self.station
        last = len(stations) - 2
        first = min(max(bisect_right(stations, low) - 1, 0), last)
        final = min(max(bisect_left(stations, high) - 1, first), last)
        best, station = inf, 0.0
        _, next_east, next_north, _ = points[first]
        for k in range(first, final + 1):
            this_east, this_north = next_east, next_north
            _, next_east, next_north, _ = points[k + 1]
            span_east, span_north = next_east - this_east, next_north - this_north
            off_east, off_north = east - this_east, north - this_north
            share = (off_east * span_east + off_north * span_north) / (
                span_east * span_east + span_north * span_north
            )
            if share < 0.0 and k > 0:
                share = 0.0
            elif share > 1.0 and k < last:
                share = 1.0
            off_east -= share * span_east
            off_north -= share * span_north
            away = off_east * off_east + off_north * off_north
            if away < best:
                best = away
                station = stations[k] + share * (stations[k + 1] - stations[k])
        return min(max(station, low), high)


def step(start: PlacedPose, end: PlacedPose) -> float:
    """Distance (m) along the travel from `start` to a later `end`; negative if that lies behind."""
    at, start_east, start_north, yaw = start
    end_at, end_east, end_north, end_yaw = end
    east, north = end_east - start_east, end_north - start_north
    distance = hypot(east, north)
    if distance > LONG_STEP or end_at - at > LONG_DURATION:
        return distance
    yaw += 0.5 * remainder(end_yaw - yaw, tau)
    return east * cos(yaw) + north * sin(yaw)


class Window(NamedTuple):
    """Samples around the ego in order of travel, arrays of one length (Section III-A, Fig. 3).

    World position (m); `station` (m) is arc length from the ego's projection, negative behind it.
    """

    east: Floats
    north: Floats
    station: Floats


def window_around(line: Polyline, ego: float, behind: float, ahead: float) -> Window:
    """Samples from `behind` to `ahead` (m of travel) of the ego's station (m).

    The preview data of Section III-A, which sorts by distance and keeps none behind.

    With `behind` > 0 the nearest sample behind the ego is always included: a curve through
    samples ahead is extrapolated to the ego and may pass metres from it. Fewer than `MIN_SAMPLES`
    are supplemented by the next ones on both sides. More than `MAX_SAMPLES` are thinned to every
    second, fourth, … sample, always the same ones while the ego moves.
    """
    stations = line.station
    first = bisect_left(stations, ego - behind)
    if behind > 0.0:
        first = min(first, max(bisect_right(stations, ego) - 1, 0))
    last = bisect_right(stations, ego + ahead)
    if last - first < MIN_SAMPLES:
        index, half = bisect_left(stations, ego), MIN_SAMPLES // 2
        last = max(last, min(index + half, len(stations)))
        first = max(min(first, last - MIN_SAMPLES, index - half), 0)
    stride = 1 << (max(last - first - 1, 0) // MAX_SAMPLES).bit_length()
    first += -(first + line.dropped) % stride
    points = line.points[first:last:stride]
    return Window(
        np.array([point[1] for point in points], dtype=np.float64),
        np.array([point[2] for point in points], dtype=np.float64),
        np.array(stations[first:last:stride], dtype=np.float64) - ego,
    )
