"""True cross-track error: the distance of each vehicle from the path that the lead drove."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from math import cos, hypot, sin
from typing import Final, NamedTuple

from vehicles.messages import TruePose
from vehicles.schedule import SECOND

MAX_STEP_BACK: Final = 3
"""Chords the foot point may move backwards from one pose to the next.

It otherwise only moves forwards, so where a path crosses itself or runs next to itself the foot
stays on its branch.
"""

MIN_STEP: Final = 0.01
"""Poses of the lead closer together than this (m) are standstills and not part of its path."""

HOLE_NS: Final = SECOND // 10
"""Limit (ns) between poses of the lead with missing numbers in between.

A longer interval is a hole in the record: the lead's path there is unknown.
"""

FORGET_EVERY: Final = 500
"""Chords of the lead between two attempts to drop those that all followers have passed."""
MAX_CHORDS: Final = 100_000
"""Chords kept for a follower that stands still or is silent, half an hour at 50 Hz."""

MAX_WAITING: Final = 3000
"""Poses of one follower that wait for the lead, 60 s at 50 Hz; then the oldest are dropped."""


class CrossTrack(NamedTuple):
    """One foot point: its arc length on the lead's path and the distance, left positive (m).

    The station is 0 at the lead's first pose and negative on the straight that leads there.
    """

    vehicle: str
    at_ns: int
    station: float
    lateral: float


class _Chord(NamedTuple):
    """Straight line between two poses of the lead: start, components, length, station (m).

    `guessed` if poses in between were not recorded.
    """

    east: float
    north: float
    along_east: float
    along_north: float
    length: float
    station: float
    is_hole: bool


_Place = tuple[str, int, float, float]
"""A vehicle, an instant (ns), and the point (m, m) whose foot point is sought."""


@dataclass(slots=True)
class _Follower:
    """The places of a follower whose foot points are not known yet.

    The next foot point is searched forwards from chord `index`, and backwards as far as `floor`. A
    follower that is `left_behind` is further back than the stored path.
    """

    index: int = 0
    floor: int = 0
    left_behind: bool = False
    waiting: deque[_Place] = field(default_factory=lambda: deque(maxlen=MAX_WAITING))


class CrossTrackError:
    """Distances of all followers from the path of `lead`, computed as the true poses come in.

    The path is the polyline through the lead's poses, without standstills. Followers start behind
    the lead, so an endless straight leads to its first pose. Its direction is `road_yaw` (rad),
    which differs from the yaw of a lead that starts askew; without it, or if the lead's first pose
    is not its start, it is the yaw of the first pose. Chords that all `followers` have passed are
    dropped, if they are given.

    The poses of each vehicle come in order of time. The order of different vehicles does not
    matter: a pose beyond the end of the lead's path waits.
    """

    def __init__(
        self, lead: str, road_yaw: float | None = None, followers: Iterable[str] = ()
    ) -> None:
        self._lead = lead
        self._road_yaw = road_yaw
        self._chords: list[_Chord] = []
        self._end = (0.0, 0.0)
        self._newest: TruePose | None = None
        self._followers: dict[str, _Follower] = {}
        self._is_awaited = False  # it may be, since places wait
        self.follow(followers)

    def follow(self, points: Iterable[str]) -> None:
        """Keep the path until these points have passed it, too; call it before the first pose."""
        self._followers |= {name: _Follower() for name in points}
        self._forgets = bool(self._followers)

    def add(self, pose: TruePose) -> list[CrossTrack]:
        """Add a pose; returns the foot points that have become known.

        Without poses that the lead's path never reaches and those next to a hole in its record.
        """
        if pose.vehicle != self._lead:
            return self.add_point(pose.vehicle, pose.true_at_ns, pose.east_m, pose.north_m)
        if self._extend(pose) and self._is_awaited:
            waiting = [other for other in self._followers.values() if other.waiting]
            self._is_awaited = bool(waiting)
            return [foot for other in waiting for foot in self._feet(other)]
        return []

    def add_point(self, vehicle: str, at: int, east: float, north: float) -> list[CrossTrack]:
        """Add a place (m) of a follower, or of a part of it that has a name of its own."""
        follower = self._followers.get(vehicle)
        if follower is None:
            follower = self._followers[vehicle] = _Follower()
        place = vehicle, at, east, north
        if follower.waiting or follower.left_behind or not self._chords:
            follower.waiting.append(place)
            self._is_awaited = True
            return self._feet(follower) if self._chords else []
        foot = self._foot(follower, place)
        if foot is None:
            follower.waiting.append(place)
            self._is_awaited = True
            return []
        return [] if self._chords[follower.index].is_hole else [foot]

    def _extend(self, pose: TruePose) -> bool:
        """Lengthen the lead's path to `pose`, unless the lead stood still."""
        before, self._newest = self._newest, pose
        if not self._chords:
            at_start = pose.distance_m == 0.0
            yaw = self._road_yaw if self._road_yaw is not None and at_start else pose.yaw_rad
            # The first chord extends backwards without end, so its length does not matter.
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
            if self._forgets and len(self._chords) % FORGET_EVERY == 0:
                self._forget()
        self._end = (pose.east_m, pose.north_m)
        return True

    def _forget(self) -> None:
        """Drop the chords that all have passed, and the oldest beyond MOST_CHORDS."""
        on_path = [other for other in self._followers.values() if not other.left_behind]
        passed = min((other.floor for other in on_path), default=len(self._chords) - 1)
        count = max(passed, len(self._chords) - MAX_CHORDS)
        del self._chords[:count]
        for other in on_path:
            other.left_behind = other.floor < count
            other.index -= count
            other.floor -= count

    def _feet(self, follower: _Follower) -> list[CrossTrack]:
        """Foot points of the waiting places, up to the first one beyond the end of the path."""
        feet: list[CrossTrack] = []
        if follower.left_behind:
            follower.waiting.clear()
        while follower.waiting:
            foot = self._foot(follower, follower.waiting[0])
            if foot is None:
                break
            follower.waiting.popleft()
            if not self._chords[follower.index].is_hole:
                feet.append(foot)
        return feet

    def _foot(self, follower: _Follower, place: _Place) -> CrossTrack | None:
        """Foot point of `place`; None if it lies beyond the end of the path.

        Searches in the order of travel, then back, and visits each chord once.
        """
        chords, index, floor = self._chords, follower.index, follower.floor
        vehicle, at, place_east, place_north = place
        count = len(chords)
        forwards = True
        while True:
            east, north, along_east, along_north, length, station, _ = chords[index]
            to_east, to_north = place_east - east, place_north - north
            along = (to_east * along_east + to_north * along_north) / length
            if forwards and along > length:
                index += 1
                if index == count:
                    follower.index = index - 1  # the search goes on from here
                    return None
            elif along < 0.0 and index > floor:
                index -= 1
                forwards = False
            else:
                break
        follower.index, follower.floor = index, max(index - MAX_STEP_BACK, 0)
        lateral = (along_east * to_north - along_north * to_east) / length
        return CrossTrack(vehicle, at, station + along, lateral)
