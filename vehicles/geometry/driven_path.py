"""True cross-track error: the distance of each vehicle from the path driven by the lead."""

from collections import deque
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from math import cos, hypot, sin
from typing import Final, NamedTuple

from vehicles.messages import TruePose
from vehicles.schedule import SECOND

MAX_STEP_BACK: Final = 3
"""Limit of chords by which the foot point may move backwards from one pose to the next.

Otherwise it moves forwards only, so that it stays on its branch where the path crosses itself or
runs parallel to itself.
"""

MIN_STEP: Final = 0.01  # Poses of the lead closer together (m) are a standstill

HOLE_NS: Final = SECOND // 10
"""Longest interval (ns) between poses of the lead with missing sequence numbers.

A longer interval is a hole in the record, where the lead's path is unknown.
"""

DROP_EVERY: Final = 500  # Chords of the lead between attempts to drop passed ones
MAX_CHORDS: Final = 100_000  # Kept for a silent follower: half an hour at 50 Hz
MAX_WAITING: Final = 3000  # Poses of a follower ahead of the lead's path, 60 s at 50 Hz


class CrossTrack(NamedTuple):
    """One foot point: station on the lead's path and lateral distance, left positive (m).

    The station is 0 at the lead's first pose and negative on the straight before it.
    """

    vehicle: str
    at_ns: int
    station: float
    lateral: float


class _Chord(NamedTuple):
    """Straight line between two poses of the lead: start, components, length, station (m).

    `is_hole`: poses in between were not recorded.
    """

    east: float
    north: float
    along_east: float
    along_north: float
    length: float
    station: float
    is_hole: bool


_Point = tuple[str, int, float, float]  # Vehicle, instant (ns), point (m, m)


@dataclass(slots=True)
class _Follower:
    """The points of a follower without a foot point yet.

    The next foot point is searched forwards from chord `index`, and backwards as far as `floor`. A
    follower that is `left_behind` is behind the stored path.
    """

    index: int = 0
    floor: int = 0
    left_behind: bool = False
    waiting: deque[_Point] = field(default_factory=lambda: deque(maxlen=MAX_WAITING))


class CrossTrackError:
    """Distances of all followers from the path of `lead`, computed from a stream of true poses.

    The path is the polyline through the lead's poses, without standstills. Followers start behind
    the lead, so an infinite straight precedes its first pose. Its direction is `road_yaw` (rad), or
    the yaw of the first pose if `road_yaw` is None. If the lead's record does not begin at its
    start, as in a part of a log, points on that straight have no foot point. If `followers` are
    given, chords that all of them have passed are dropped. Points of `replayed` vehicles have no
    foot point on that straight: they start where their own drive does.

    The poses of each vehicle must be in order of time, but vehicles may be interleaved in any
    order: a pose beyond the end of the lead's path is stored until the path reaches it.
    """

    def __init__(
        self,
        lead: str,
        road_yaw: float | None = None,
        followers: Iterable[str] = (),
        replayed: Collection[str] = (),
    ) -> None:
        """`replayed` are names of vehicles; their points are called by them, or by them and `/`."""
        self._lead = lead
        self._replayed = replayed
        self._road_yaw = road_yaw
        self._from_start = True
        self._chords: list[_Chord] = []
        self._end = (0.0, 0.0)
        self._newest: TruePose | None = None
        self._followers: dict[str, _Follower] = {}
        self._has_waiting = False
        self.follow(followers)

    def follow(self, names: Iterable[str]) -> None:
        """Keep the path until these points have also passed it; call before the first pose."""
        self._followers |= {name: _Follower() for name in names}
        self._drops_chords = bool(self._followers)

    def add(self, pose: TruePose) -> list[CrossTrack]:
        """Add a pose; return the foot points that have become known.

        Poses next to a hole in the lead's record have none, nor have poses that its path never
        reaches.
        """
        if pose.vehicle != self._lead:
            return self.add_point(pose.vehicle, pose.true_at_ns, pose.east_m, pose.north_m)
        if self._extend(pose) and self._has_waiting:
            waiting = [other for other in self._followers.values() if other.waiting]
            self._has_waiting = bool(waiting)
            return [foot for other in waiting for foot in self._feet(other)]
        return []

    def add_point(self, vehicle: str, at: int, east: float, north: float) -> list[CrossTrack]:
        """Add a point (m) of a follower, or of a named part of it."""
        follower = self._followers.get(vehicle)
        if follower is None:
            follower = self._followers[vehicle] = _Follower()
        point = vehicle, at, east, north
        if follower.waiting or follower.left_behind or not self._chords:
            follower.waiting.append(point)
            self._has_waiting = True
            return self._feet(follower) if self._chords else []
        foot = self._foot(follower, point)
        if foot is None:
            follower.waiting.append(point)
            self._has_waiting = True
            return []
        return [foot] if self._counts(follower, foot) else []

    def _counts(self, follower: _Follower, foot: CrossTrack) -> bool:
        """Whether the lead's path is known beside the foot point."""
        if foot.station < 0.0 and (
            not self._from_start or foot.vehicle.partition("/")[0] in self._replayed
        ):
            return False
        return not self._chords[follower.index].is_hole

    def _extend(self, pose: TruePose) -> bool:
        """Extend the lead's path to `pose`, unless the lead stood still."""
        before, self._newest = self._newest, pose
        if not self._chords:
            self._from_start = pose.distance_m == 0.0
            yaw = pose.yaw_rad
            if self._road_yaw is not None and self._from_start:
                yaw = self._road_yaw
            # The first chord extends backwards to infinity, so its length does not matter.
            along_east, along_north = cos(yaw), sin(yaw)
            east, north = pose.east_m - along_east, pose.north_m - along_north
            self._chords.append(_Chord(east, north, along_east, along_north, 1.0, -1.0, False))
        else:
            east, north = self._end
            along_east, along_north = pose.east_m - east, pose.north_m - north
            step = hypot(along_east, along_north)
            if not step > MIN_STEP:
                return False
            last = self._chords[-1]
            station = last.station + last.length
            hole = (
                before is not None
                and pose.seq - before.seq > 1
                and pose.true_at_ns - before.true_at_ns > HOLE_NS
            )
            self._chords.append(_Chord(east, north, along_east, along_north, step, station, hole))
            if self._drops_chords and len(self._chords) % DROP_EVERY == 0:
                self._drop_chords()
        self._end = (pose.east_m, pose.north_m)
        return True

    def _drop_chords(self) -> None:
        """Drop the chords that all followers have passed, and the oldest beyond MAX_CHORDS."""
        on_path = [other for other in self._followers.values() if not other.left_behind]
        passed = min((other.floor for other in on_path), default=len(self._chords) - 1)
        count = max(passed, len(self._chords) - MAX_CHORDS)
        del self._chords[:count]
        for other in on_path:
            other.left_behind = other.floor < count
            other.index -= count
            other.floor -= count

    def _feet(self, follower: _Follower) -> list[CrossTrack]:
        """Foot points of the waiting points, up to the first one beyond the end of the path."""
        feet: list[CrossTrack] = []
        if follower.left_behind:
            follower.waiting.clear()
        while follower.waiting:
            foot = self._foot(follower, follower.waiting[0])
            if foot is None:
                break
            follower.waiting.popleft()
            if self._counts(follower, foot):
                feet.append(foot)
        return feet

    def _foot(self, follower: _Follower, point: _Point) -> CrossTrack | None:
        """Foot point of `point`; None if it is beyond the end of the path.

        Searches forwards, then backwards, and visits each chord once.
        """
        chords, index, floor = self._chords, follower.index, follower.floor
        vehicle, at, point_east, point_north = point
        count = len(chords)
        forwards = True
        while True:
            east, north, along_east, along_north, length, station, _ = chords[index]
            to_east, to_north = point_east - east, point_north - north
            along = (to_east * along_east + to_north * along_north) / length
            if forwards and along > length:
                index += 1
                if index == count:
                    follower.index = index - 1  # the next search continues here
                    return None
            elif along < 0.0 and index > floor:
                index -= 1
                forwards = False
            else:
                break
        follower.index, follower.floor = index, max(index - MAX_STEP_BACK, 0)
        lateral = (along_east * to_north - along_north * to_east) / length
        return CrossTrack(vehicle, at, station + along, lateral)
