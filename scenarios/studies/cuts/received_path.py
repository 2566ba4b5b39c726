"""Path that a follower received, from deliveries and true positions; independent of its estimates.

Stations (m) are along the path that the lead drove. A received position of the lead, or of a
predecessor on the lead's path, makes its station known, with those that its path history covers. So
is the road on which the convoy starts. Between known stations that the lead passed at most `HOLE_S`
apart the path is known.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.driver.degradation.settings import Braking
from vehicles.driver.degradation.stopping import stopping_distance
from vehicles.schedule import SECOND

Numbers = NDArray[np.float64]

HOLE_S: Final = 0.5
"""Longest part of the lead's drive (s) between received positions that counts as known."""
HOLE_M: Final = 2.0
"""The same at low speed (m)."""
NOTICED_S: Final = 0.5
"""Silence after which a follower has to brake."""
ON_PATH_M: Final = 0.3
"""Largest lateral error of a car that is on the lead's path."""
HARDEST: Final = Braking(6.0, 12.0)
BIN_M: Final = 0.5
BEHIND_M: Final = 300.0
"""Length of the straight road behind the start of the lead."""


class StationTrack(NamedTuple):
    """Station, lateral error (m) and speed (m/s) of one car, by instant (ns)."""

    at: Numbers
    station: Numbers
    lateral: Numbers
    speed: Numbers

    def on_path(self, from_at: int, to_at: int) -> Numbers:
        """Stations of an interval at which the car was on the lead's path, at least one sample."""
        first = np.searchsorted(self.at, from_at)
        last = max(int(np.searchsorted(self.at, to_at, side="right")), int(first) + 1)
        return self.station[first:last][np.abs(self.lateral[first:last]) < ON_PATH_M]


class Delivery(NamedTuple):
    """A delivered pose: instants (ns) of reception and measurement, and its oldest position."""

    received_at: int
    sender: str
    measured_at: int
    since: int


class ReceivedPath:
    """Known path of one follower while its deliveries are replayed."""

    def __init__(self, lead: StationTrack) -> None:
        length = float(np.max(lead.station)) + 2.0 * BEHIND_M
        self._is_known = np.zeros(int(length / BIN_M), dtype=bool)
        self._is_known[: int(BEHIND_M / BIN_M) + 1] = True
        stations = BIN_M * np.arange(len(self._is_known)) - BEHIND_M
        speed = np.interp(stations, np.maximum.accumulate(lead.station), lead.speed)
        self._hole = np.maximum(HOLE_M, HOLE_S * speed)

    def add(self, stations: Numbers) -> None:
        self._is_known[((stations + BEHIND_M) / BIN_M).astype(int)] = True

    def ahead(self, station: float) -> float:
        """Known path (m) ahead of a car, negative if it ended behind."""
        here = int((station + BEHIND_M) / BIN_M)
        known = np.flatnonzero(self._is_known)
        place = int(np.searchsorted(known, here, side="right"))
        end = int(known[place - 1])
        if (here - end) * BIN_M > self._hole[here]:
            return (end - here) * BIN_M
        for further in known[place:].tolist():
            if (further - end) * BIN_M > self._hole[end]:
                break
            end = further
        return end * BIN_M - BEHIND_M - station


def judge_departures(
    departures: Sequence[int],
    follower: StationTrack,
    tracks: Mapping[str, StationTrack],
    deliveries: Sequence[Delivery],
) -> list[bool]:
    """Judge for each departure (ns) whether the received path sufficed to stop before.

    It did if the car left its lane within the known path, or if that was longer than the braking
    distance `NOTICED_S` after it last grew. Until the car is back on the lead's path, its
    departures belong to the same drive beyond the known path. `tracks` are those of all cars, the
    lead first.
    """
    path = ReceivedPath(next(iter(tracks.values())))
    waiting, left = sorted(deliveries, reverse=True), sorted(departures, reverse=True)
    verdicts: list[bool] = []
    end = grew_at = -np.inf
    could_stop = is_beyond = False
    for at, station, lateral, speed in zip(*(values.tolist() for values in follower), strict=True):
        if not left:
            break
        while waiting and waiting[-1].received_at <= at:
            pose = waiting.pop()
            path.add(tracks[pose.sender].on_path(pose.since, pose.measured_at))
        known = path.ahead(station)
        is_beyond = known < 0.0 or (is_beyond and abs(lateral) > ON_PATH_M)
        if not is_beyond:
            if station + known > end + BIN_M:
                end, grew_at, could_stop = station + known, at, False
            if at < grew_at + NOTICED_S * SECOND:
                could_stop = known >= stopping_distance(speed, 0.0, HARDEST)
        while left and left[-1] <= at:
            left.pop()
            verdicts.append(could_stop or not is_beyond)
    return verdicts
