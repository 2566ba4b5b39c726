"""Parts of the lead's path that its convoy has yet to drive, where the path meets itself; SI units.

Followers drive the lead's path one after the other and do not look for crossing traffic. At a
crossing, or where a closed path begins again, two cars can therefore meet only if the lead comes
there a second time before its last car has passed it once. The lead waits for that.
"""

from bisect import bisect_left
from collections import deque
from math import floor, inf, pi
from typing import Final, NamedTuple

import numpy as np

from vehicles.car.outline import outline_of
from vehicles.car.parameters import VehicleParameters
from vehicles.driver.convoy.lane import Lane
from vehicles.geometry.sampled_path import SampledPath

STEP: Final = 1.0  # Distance (m) between the positions of the last car that are checked
LEAST_TURN: Final = 0.9 * pi  # A path whose direction (rad) varies less does not meet itself


class ReservedEntry(NamedTuple):
    """Station (m) of the path that the lead must not enter, infinite if there is none.

    It moves at `rate` times the speed of the last car: 1 behind the car on the same road, 0 before
    a crossing that the car has not passed.
    """

    station: float
    rate: float


FREE: Final = ReservedEntry(inf, 0.0)


def entries(
    path: SampledPath, lane: Lane, car: VehicleParameters, station: float, until: float
) -> list[float]:
    """Stations (m) up to `until` (m) at which a path later meets a `car` at `station` (m)."""
    place = path.at(station)
    body = outline_of(car, place.east, place.north, place.yaw)
    return lane.contacts(body, station + 2.0 * lane.reach(body), until)


def shortest_loop(
    path: SampledPath, lead: VehicleParameters, last: VehicleParameters, end: float, most: float
) -> float:
    """Length (m) of the shortest loop of a path up to `end` (m), infinite above `most` (m).

    A lead cannot drive around it while the spacings to all its followers up to the `last`, and the
    one that it keeps to that car ahead, add up to more. On a closed path it is the lap.
    """
    if np.ptp(path.yaw) < LEAST_TURN:
        return inf
    lane, rear = Lane(path, lead), 0.5 * last.length - last.body_offset
    shortest = inf
    for station in np.arange(float(path.station[0]), end, STEP).tolist():
        found = entries(path, lane, last, station, min(station + most, end))
        if found:
            shortest = min(shortest, found[0] + rear - station)
    return shortest


class ReservedPath:
    """The first part of the path ahead that the convoy must drive before the lead may enter it."""

    def __init__(self, path: SampledPath, lane: Lane, last: VehicleParameters) -> None:
        self._path, self._lane, self._car = path, lane, last
        self._end = float(path.station[-1])
        self._checked: deque[tuple[float, list[float]]] = deque()
        self._next: float | None = None

    def entry(self, last: float, station: float) -> ReservedEntry:
        """First entry from the lead's `station` (m) on, the last car being at `last` (m)."""
        checked = self._checked
        self._check(last, station)
        while len(checked) > 1 and checked[1][0] <= last:
            checked.popleft()
        firsts = [_first_from(station, found) for _, found in checked]
        first = min(firsts, default=inf)
        if first == inf:
            return FREE
        moved = min(firsts[1:], default=inf) - first
        if moved > 2.0 * STEP:  # the last car has yet to pass a crossing
            return ReservedEntry(first, 0.0)
        share = min(max((last - checked[0][0]) / STEP, 0.0), 1.0)
        return ReservedEntry(first + share * moved, min(moved / STEP, 1.0))

    def _check(self, last: float, station: float) -> None:
        """Find the entries of positions from the `last` car to the lead at `station` (m)."""
        if self._next is None:
            self._next = STEP * floor(last / STEP)
        while self._next <= station:
            found = entries(self._path, self._lane, self._car, self._next, self._end)
            self._checked.append((self._next, found))
            self._next += STEP


def _first_from(station: float, stations: list[float]) -> float:
    """First of increasing `stations` (m) that is at or after `station` (m), infinite without."""
    index = bisect_left(stations, station)
    return stations[index] if index < len(stations) else inf
