"""Received samples of one source in their order of travel, and the ego's station among them.

The ego's place on the trace is a station (arc length) that moves only locally from one call to the
next. Whatever lies close by in the plane but far along the trace (the other leg of a hairpin, the
crossing of a figure of eight, an earlier or later lap) is therefore never considered.
"""

from bisect import bisect_left, bisect_right
from itertools import pairwise
from math import atan2, ceil, cos, hypot, inf, nan, sin
from typing import Final, NamedTuple

import numpy as np

from vehicles.geometry.bridges import UnbridgedError, curve_between
from vehicles.preview.polyline import Point, Polyline, step
from vehicles.preview.samples import TraceSettings, Window, drivable
from vehicles.received_pose import ReceivedPose

BRIDGE_AT: Final = -1
"""Instant of bridge points: before any sample."""
MAX_BRIDGE_POINTS: Final = 500
"""Limit of the points that bridge a hole."""
MAX_HOLES: Final = 8
"""Holes that are remembered, for late samples that belong there."""
FORGET_CHUNK: Final = 64
"""Number of samples behind the ego that are dropped at once."""


class _Hole(NamedTuple):
    """A bridged gap in a trace: the point before it, the speed (m/s) and instant (ns) after it."""

    before: Point
    speed: float
    end: int


class Trace:
    """The samples of one source, received and stored as in Section III-A.

    Poses are judged before they come here; the trace brings them into the order of travel. `newest`
    is the newest pose, `sample_count` that of the samples since the line began, and `joined`
    whether no bridge from the ego's place is needed any more: it exists, or the ego is on the trace
    already.
    """

    def __init__(self, settings: TraceSettings | None = None) -> None:
        self.settings = settings or TraceSettings()
        self.newest: ReceivedPose | None = None
        self.sample_count = 0
        self.joined = False
        self._line = Polyline()
        self._first_yaw = 0.0
        self._forgotten_at = BRIDGE_AT
        self._bridged_from: tuple[float, float] | None = None
        self._ego_station: float | None = None
        self._located_at: tuple[float, float] | None = None
        self._changed = False
        self._holes: list[_Hole] = []

    def __len__(self) -> int:
        return len(self._line.at)

    def add(
        self, pose: ReceivedPose, *, after_hole: bool = False, at_new_place: bool = False
    ) -> None:
        """Insert a pose at its place in the order of travel (Section III-A).

        `after_hole` bridges the missing stretch by a curve; `at_new_place`, to which no car can
        have driven, another line begins.
        """
        newest = self.newest
        if newest is None or at_new_place:
            self._start(pose)
        elif pose.measured_at <= newest.measured_at:
            self._insert(pose)
        else:
            point = (pose.measured_at, pose.east, pose.north, pose.yaw)
            if after_hole:
                self._fill(point, pose.speed)
            self.newest = pose
            self.sample_count += 1
            line = self._line
            on = step(line.point(-1), point)
            if on >= self.settings.spacing:  # else it stands, or the message came twice
                line.append(point, on)
                self._changed = True
                if len(line.at) > self.settings.capacity:
                    self._forget()

    def record_position(self, pose: ReceivedPose) -> None:
        """Record the position of a source whose path is not one to follow.

        Preview data of Section III-A are those of a source that keeps to the path.
        """
        newest = self.newest
        if newest is not None and pose.measured_at > newest.measured_at:
            self.newest = pose

    def _start(self, pose: ReceivedPose) -> None:
        """Begin the line at a pose and drop all earlier points."""
        self.newest = pose
        self.sample_count = 1
        self._line = Polyline()
        self._line.append((pose.measured_at, pose.east, pose.north, pose.yaw), 0.0)
        self._first_yaw = pose.yaw
        self._forgotten_at = BRIDGE_AT
        self._bridged_from = None
        self.joined = False
        self._ego_station = None
        self._holes.clear()

    def _fill(self, after: Point, speed: float) -> None:
        """Insert points before `after`, on a cubic with the places and headings of both sides.

        They are about a bridge's spacing apart, and their instants are evenly distributed.
        """
        before = self._line.point(-1)
        length = hypot(after[1] - before[1], after[2] - before[2])
        if length < self.settings.hole:
            return
        spacing = max(self.settings.bridge_spacing, length / MAX_BRIDGE_POINTS)
        try:
            points = curve_between(before[1:4], after[1:4], spacing)
        except UnbridgedError:  # a straight line it is
            return
        count = points.shape[1]
        span = after[0] - before[0]
        ends = [*points.T.tolist(), [after[1], after[2]]]
        for k, ((east, north), (next_east, next_north)) in enumerate(pairwise(ends)):
            yaw = atan2(next_north - north, next_east - east)
            point = (before[0] + span * (k + 1) // (count + 1), east, north, yaw)
            last = self._line.point(-1)
            self._line.append(point, hypot(east - last[1], north - last[2]))
        self._holes = [*self._holes[1 - MAX_HOLES :], _Hole(before, speed, after[0])]

    def _insert_in_hole(self, hole: _Hole, point: Point, speed: float) -> None:
        """Insert a late sample into a hole and bridge both sides of it again."""
        line, before = self._line, hole.before
        first, last = bisect_right(line.at, before[0]), bisect_left(line.at, hole.end)
        if not 0 < first < last < len(line.at) or not _is_drivable(
            before, point, max(hole.speed, speed)
        ):
            return
        self._holes.remove(hole)
        station, tail = line.station[last], line.cut(last)
        line.cut(first)
        self._append(point, speed)
        self._append(tail[0], speed)
        shift = line.station[-1] - station
        for later in tail[1:]:
            line.append(later, step(line.point(-1), later))
        if self._ego_station is not None and self._ego_station > station:
            self._ego_station += shift
        self._changed = True

    def _append(self, point: Point, speed: float) -> None:
        """Add a sample at the end of the line, and a bridge to it where the step is long."""
        self._fill(point, speed)
        on = step(self._line.point(-1), point)
        self._line.append(point, max(on, self.settings.spacing))

    def _insert(self, pose: ReceivedPose) -> None:
        """Insert a late sample at its place, if that place is still held and it fits there."""
        line, at = self._line, pose.measured_at
        point = (at, pose.east, pose.north, pose.yaw)
        if at <= self._forgotten_at:
            return
        hole = next((one for one in self._holes if one.before[0] < at < one.end), None)
        if hole is not None:
            self._insert_in_hole(hole, point, pose.speed)
            return
        place = bisect_left(line.at, at)
        steps = [0.0, 0.0]
        for side, k in enumerate((place - 1, place)):
            if not 0 <= k < len(line.at) or line.at[k] == BRIDGE_AT:
                continue
            beside = line.point(k)
            if not _is_drivable(beside, point, pose.speed):
                return
            steps[side] = step(point, beside) if side else step(beside, point)
            if steps[side] < self.settings.spacing:
                return
        self._changed = True
        self.sample_count += 1
        if place == 0 or line.at[place - 1] == BRIDGE_AT:
            self._begin_earlier(point, place)
            return
        before = line.station[place - 1]
        shift = line.insert(place, point, *steps)
        if self._ego_station is not None and self._ego_station > before:
            self._ego_station += shift

    def _begin_earlier(self, point: Point, place: int) -> None:
        """Start the trace with a late sample older than the first received one."""
        start, self._bridged_from = self._bridged_from, None
        self.joined = self._forgotten_at != BRIDGE_AT
        self._line.drop(place)
        self._line.prepend([point])
        self._first_yaw = point[3]
        self._ego_station = None
        if start is not None:
            self.bridge(*start)

    def bridge(self, east: float, north: float) -> None:
        """Join the ego's place to the first sample by a straight line, if that lies ahead of it.

        A convoy forms up on a straight lead-in, and a source's path before its first message is
        unknown: points on the straight line let the fit interpolate, where a few noisy samples 15
        to 60 m ahead would be extrapolated backwards. Does nothing once a bridge exists, once
        samples behind the ego were dropped, or before a sample is held.
        """
        line = self._line
        if not line.at or self.joined:
            return
        ahead_east, ahead_north = line.east[0] - east, line.north[0] - north
        along = ahead_east * cos(self._first_yaw) + ahead_north * sin(self._first_yaw)
        length = hypot(ahead_east, ahead_north)
        if along <= self.settings.bridge_spacing or length > self.settings.bridge_length:
            return
        count = ceil(length / self.settings.bridge_spacing)
        shares = [k / count for k in range(count)]
        yaw = atan2(ahead_north, ahead_east)
        line.prepend(
            [
                (BRIDGE_AT, east + share * ahead_east, north + share * ahead_north, yaw)
                for share in shares
            ]
        )
        self._bridged_from = (east, north)
        self.joined = True
        self._ego_station = None

    def without_bridges(self, window: Window) -> Window:
        """The received samples of a window (Section III-A), without bridges over holes."""
        if not self._holes or self._ego_station is None:
            return window
        stations = window.station + self._ego_station
        keep = np.ones(len(stations), dtype=np.bool_)
        for hole in self._holes:
            low, high = self._station_at(hole.before[0]), self._station_at(hole.end)
            keep &= (stations < low + 1e-6) | (stations > high - 1e-6)
        return Window(*(values[keep] for values in window))

    def has_bridge_points(self, window: Window) -> bool:
        """Whether the window cut out last contains points of a bridge (not in Section III-A)."""
        line, here = self._line, self._ego_station
        if here is None:
            return False
        if line.at[0] == BRIDGE_AT:
            first = bisect_right(line.at, BRIDGE_AT)
            received_from = line.station[first] if first < len(line.at) else inf
            if window.station.item(0) + here < received_from - 1e-6:
                return True
        return bool(self._holes) and len(self.without_bridges(window).station) < len(window.station)

    def instants(self, window: Window) -> list[int]:
        """Instants (ns) of the samples of the window cut out last (time stamps, Section III-B)."""
        here = self._ego_station or 0.0
        places = (bisect_left(self._line.station, here + on - 1e-6) for on in window.station)
        return [self._line.at[min(place, len(self._line.at) - 1)] for place in places]

    def _station_at(self, at: int) -> float:
        """Station (m) of the first held point from the instant `at` (ns) on."""
        return self._line.station[min(bisect_left(self._line.at, at), len(self._line.at) - 1)]

    def window(self, east: float, north: float, behind: float, ahead: float) -> Window:
        """Cut out the samples from `behind` to `ahead` (m of travel) of the ego at (east, north).

        The preview data of Section III-A, which sorts by distance and keeps none behind.

        If any behind count, the newest of them does, however far behind it lies: a curve determined
        by samples ahead only is extrapolated to the ego, and may pass metres from it. Where fewer
        than `least_samples` lie there, the next ones on both sides are included. Thinned to every
        second, fourth, … sample until at most `window_samples` are left. The same ones are left out
        while the ego moves, so thinning does not shake the fit.
        """
        here = self._locate(east, north)
        line = self._line
        first = bisect_left(line.station, here - behind)
        if behind > 0.0:
            first = min(first, max(bisect_right(line.station, here) - 1, 0))
        last = bisect_right(line.station, here + ahead)
        if last - first < self.settings.min_samples:
            first, last = self._widened(here, first, last)
        stride = 1 << (max(last - first - 1, 0) // self.settings.max_samples).bit_length()
        first += -(first + line.dropped) % stride
        chosen = slice(first, last, stride)
        return Window(
            np.array(line.east[chosen], dtype=np.float64),
            np.array(line.north[chosen], dtype=np.float64),
            np.array(line.station[chosen], dtype=np.float64) - here,
        )

    def _widened(self, here: float, first: int, last: int) -> tuple[int, int]:
        """Include the next samples on either side of the ego where too few lie in the window."""
        place = bisect_left(self._line.station, here)
        half = self.settings.min_samples // 2
        last = max(last, min(place + half, len(self._line.at)))
        return max(min(first, last - self.settings.min_samples, place - half), 0), last

    def gap(self, east: float, north: float) -> float | None:
        """Arc length (m) from the ego at (east, north) to the source's newest place.

        For keeping gaps. None before the first sample. The caller adds the distance driven since
        then.
        """
        if self.newest is None:
            return None
        here = self._locate(east, north)
        beyond_east = self.newest.east - self._line.east[-1]
        beyond_north = self.newest.north - self._line.north[-1]
        beyond = beyond_east * cos(self.newest.yaw) + beyond_north * sin(self.newest.yaw)
        return self._line.station[-1] + beyond - here

    def known_ahead(self, east: float, north: float) -> float:
        """Known path (m) ahead of the ego at (east, north): negative where it ends behind.

        The metres left of the preview of Section III-A; NaN before the first sample.
        """
        return self._line.station[-1] - self._locate(east, north) if self._line.at else nan

    def _locate(self, east: float, north: float) -> float:
        """Move the ego's station to the nearest place within reach of where it was."""
        line, place = self._line, (east, north)
        if self._ego_station is not None and place == self._located_at and not self._changed:
            return self._ego_station
        before, self._located_at, self._changed = self._located_at, place, False
        if len(line.at) < 2:
            first = place if not line.at else (line.east[0], line.north[0])
            off_east, off_north = east - first[0], north - first[1]
            return off_east * cos(self._first_yaw) + off_north * sin(self._first_yaw)
        low, high = -inf, inf
        if self._ego_station is not None and before is not None:
            moved = hypot(east - before[0], north - before[1])
            reach = self.settings.margin + self.settings.reach_ratio * moved
            low = self._ego_station - self.settings.back
            high = self._ego_station + min(reach, self.settings.reach)
        self._ego_station = line.nearest(east, north, low, high)
        stale = self._ego_station - self.settings.memory
        if len(line.at) > 2 * FORGET_CHUNK and line.station[FORGET_CHUNK] < stale:
            self._forget()
        return self._ego_station

    def _forget(self) -> None:
        self._forgotten_at = max(self._forgotten_at, self._line.at[FORGET_CHUNK - 1])
        self._line.drop(FORGET_CHUNK)
        self.joined = True


def _is_drivable(one: Point, other: Point, speed: float) -> bool:
    """Whether a late pose can lie beside a point of its line, for a car at `speed` (m/s)."""
    distance = hypot(other[1] - one[1], other[2] - one[2])
    return drivable(distance, abs(other[0] - one[0]), abs(speed))
