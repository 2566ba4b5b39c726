"""True cross-track errors: distances from the path driven by the lead, or from a known path."""

from array import array
from bisect import bisect_right
from collections import defaultdict, deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from math import cos, hypot, sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from vehicles.geometry.sampled_path import FloatArray, SampledPath
from vehicles.messages import TruePose
from vehicles.schedule import SECOND

MAX_STEP_BACK: Final = 3
"""Number of chords by which a foot point may move backwards from one pose to the next: otherwise it
could leave its branch where the path crosses itself or runs parallel to itself."""

MAX_STEP: Final = 10.0
"""A vehicle that drove further (m) along a known path between two positions is searched at its
distance driven."""

MIN_STEP: Final = 0.01  # Poses of the lead closer together (m) are a standstill

HOLE_NS: Final = SECOND // 10
"""The lead's path is unknown between poses further apart (ns) with missing numbers between them."""

MAX_WAITING: Final = 3000  # Poses of a follower ahead of the lead's path, 60 s at 50 Hz


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


class CrossTrack(NamedTuple):
    """One foot point: station on the lead's path and lateral distance, left positive (m).

    The station is 0 at the lead's first pose and negative on the straight before it.
    """

    vehicle: str
    at_ns: int
    station: float
    lateral: float


@dataclass(slots=True)
class _Follower:
    """The points of a follower without a foot point yet, each with its instant (ns).

    The next foot point is searched from chord `index` on.
    """

    index: int = 0
    waiting: deque[tuple[int, tuple[float, float]]] = field(
        default_factory=lambda: deque(maxlen=MAX_WAITING)
    )


class CrossTrackError:
    """Distances of all followers from the path of `lead`, computed from a stream of true poses.

    The path is the polyline through the lead's poses, without standstills. Followers start behind
    the lead, so an infinite straight precedes its first pose. Its direction is `road_yaw` (rad), or
    the yaw of the first pose if `road_yaw` is None. If the lead's record does not begin at its
    start, as in a part of a log, points on that straight have no foot point. Neither have points of
    `replayed` vehicles: they start where their own drive does. The path takes 5 MB an hour.

    The poses of each vehicle must be in order of time, but vehicles may be interleaved in any
    order: a pose beyond the end of the lead's path is stored until the path reaches it.
    """

    def __init__(
        self,
        lead: str,
        road_yaw: float | None = None,
        replayed: Collection[str] = (),
    ) -> None:
        """`replayed` are names of vehicles; their points are called by them, or by them and `/`."""
        self._lead = lead
        self._replayed = replayed
        self._road_yaw = road_yaw
        self._from_start = True
        self._east, self._north, self._station = array("d"), array("d"), array("d")
        self._is_hole = bytearray()  # of each chord: poses in between were not recorded
        self._newest: TruePose | None = None
        self._followers = defaultdict[str, _Follower](_Follower)

    def add(self, pose: TruePose) -> list[CrossTrack]:
        """Add a pose; return the foot points that have become known.

        Poses next to a hole in the lead's record have none, nor have poses that its path never
        reaches.
        """
        if pose.vehicle != self._lead:
            return self.add_point(pose.vehicle, pose.true_at_ns, pose.east_m, pose.north_m)
        if not self._extend(pose):
            return []
        waiting = [(name, other) for name, other in self._followers.items() if other.waiting]
        return [foot for name, other in waiting for foot in self._feet(name, other)]

    def add_point(self, vehicle: str, at: int, east: float, north: float) -> list[CrossTrack]:
        """Add a point (m) of a follower, or of a named part of it."""
        follower = self._followers[vehicle]
        follower.waiting.append((at, (east, north)))
        return self._feet(vehicle, follower) if self._station else []

    def _extend(self, pose: TruePose) -> bool:
        """Extend the lead's path to `pose`, unless the lead stood still."""
        before, self._newest = self._newest, pose
        is_hole = False
        if before is None:
            self._from_start = pose.distance_m == 0.0
            yaw = pose.yaw_rad
            if self._road_yaw is not None and self._from_start:
                yaw = self._road_yaw
            # The first chord extends backwards to infinity, so its length does not matter.
            self._east.append(pose.east_m - cos(yaw))
            self._north.append(pose.north_m - sin(yaw))
            self._station.append(-1.0)
            station = 0.0
        else:
            step = hypot(pose.east_m - self._east[-1], pose.north_m - self._north[-1])
            if not step > MIN_STEP:
                return False
            station = self._station[-1] + step
            is_hole = pose.seq - before.seq > 1 and pose.true_at_ns - before.true_at_ns > HOLE_NS
        self._east.append(pose.east_m)
        self._north.append(pose.north_m)
        self._station.append(station)
        self._is_hole.append(is_hole)
        return True

    def _feet(self, vehicle: str, follower: _Follower) -> list[CrossTrack]:
        """Foot points of the waiting points, up to the first one beyond the end of the path."""
        feet: list[CrossTrack] = []
        while follower.waiting:
            at, point = follower.waiting[0]
            index, share, lateral = walk(self._east, self._north, follower.index, point)
            follower.index = index
            if share > 1.0 and index == len(self._is_hole) - 1:  # the path does not reach it yet
                break
            follower.waiting.popleft()
            start, end = self._station[index : index + 2]
            station = start + share * (end - start)
            is_before = station < 0.0 and (
                not self._from_start or vehicle.partition("/")[0] in self._replayed
            )
            if not is_before and not self._is_hole[index]:
                feet.append(CrossTrack(vehicle, at, station, lateral))
        return feet
