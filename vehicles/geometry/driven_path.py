"""Foot points of a vehicle that drives along a known path."""

from array import array
from bisect import bisect_right
from collections.abc import Sequence
from math import sqrt
from typing import Final

import numpy as np

from vehicles.geometry.sampled_path import FloatArray, SampledPath

MAX_STEP_BACK: Final = 3
"""Number of chords by which a foot point may move backwards from one pose to the next: otherwise it
could leave its branch where the path crosses itself or runs parallel to itself."""

MAX_STEP: Final = 10.0
"""A vehicle that drove further (m) along a known path between two positions is searched at its
distance driven."""


def walk(
    easts: Sequence[float],
    norths: Sequence[float],
    index: int,
    point: tuple[float, float],
) -> tuple[int, float, float]:
    """Foot of a `point` (m) on a polyline, whose chord is searched from chord `index` on.

    Returns the index of its chord, its share of the chord, and the lateral distance (m, left
    positive). Searches forwards, then backwards by up to MAX_STEP_BACK chords, and visits each
    chord once. Both end chords are extended: the share is below 0 or above 1 there.
    """
    last, floor, forwards = len(easts) - 2, max(index - MAX_STEP_BACK, 0), True
    point_east, point_north = point
    while True:
        east, north = easts[index], norths[index]
        along_east, along_north = easts[index + 1] - east, norths[index + 1] - north
        to_east, to_north = point_east - east, point_north - north
        along = to_east * along_east + to_north * along_north
        square = along_east * along_east + along_north * along_north
        if forwards and along > square and index < last:
            index += 1
        elif along < 0.0 and index > floor:
            index -= 1
            forwards = False
        else:
            lateral = (along_east * to_north - along_north * to_east) / sqrt(square)
            return index, along / square, lateral


class PathWalk:
    """Foot points of a vehicle that drives along a path, each searched near the one before.

    So it stays on its branch of a path that crosses or repeats itself. The path counts as a
    polyline through its samples: at a radius of 10 m it is 1 mm off.
    """

    def __init__(self, path: SampledPath, station: float) -> None:
        """`station` (m) is that of the vehicle at distance 0."""
        self._stations = array("d", path.station.tobytes())
        self._east = array("d", path.east.tobytes())
        self._north = array("d", path.north.tobytes())
        self._start, self._distance, self._index = station, -2.0 * MAX_STEP, 0

    def foot(self, east: float, north: float, distance: float) -> tuple[float, float]:
        """Station and offset (m, left positive) of a position (m) after a `distance` driven (m)."""
        if not 0.0 <= distance - self._distance <= MAX_STEP:
            index = bisect_right(self._stations, self._start + distance) - 1
            self._index = min(max(index, 0), len(self._stations) - 2)
        self._distance = distance
        index, share, lateral = walk(self._east, self._north, self._index, (east, north))
        self._index = index
        start, end = self._stations[index : index + 2]
        return start + share * (end - start), lateral

    def feet(self, points: FloatArray, distance: FloatArray) -> FloatArray:
        """`foot` (2, n) of each of `points` (2, n) (m), after distances (n,) driven (m)."""
        rows = zip(*points.tolist(), distance.tolist(), strict=True)
        return np.array([self.foot(*row) for row in rows]).reshape(-1, 2).T
