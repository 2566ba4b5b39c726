"""Received samples of one source in order of travel, and the ego's station among them.

The ego's station (arc length) moves only locally from one call to the next. Samples that are close
in the plane but far along the trace (the other leg of a hairpin, the crossing of a figure of eight,
another lap) are therefore never considered.
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
"""Largest number of points that bridge a hole."""
MAX_HOLES: Final = 8
"""Number of the last holes that late samples can still fill."""
DROP_CHUNK: Final = 64
"""Number of samples behind the ego that are dropped at once."""


class _Hole(NamedTuple):
    """A bridged hole: the point before it, the speed (m/s) and instant (ns) after it."""

    before: Point
    speed: float
    end: int


class Trace:
    """The accepted samples of one source, stored in order of travel as in Section III-A.

    `newest` is the newest pose, `sample_count` the number of samples since the line began. `joined`
    is True once no bridge from the ego to the line is needed any more.
    """

    def __init__(self, settings: TraceSettings | None = None) -> None:
        self.settings = settings or TraceSettings()
        self.newest: ReceivedPose | None = None
        self.sample_count = 0
        self.joined = False
        self._line = Polyline()
        self._first_yaw = 0.0
        self._dropped_until = BRIDGE_AT
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
        """Insert a pose in the order of travel (Section III-A).

        `after_hole` bridges the missing stretch by a curve. `at_new_place` starts another line at a
        position to which no car can have driven.
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
            distance = step(line.point(-1), point)
            if distance >= self.settings.spacing:  # else it stands, or the message was repeated
                line.append(point, distance)
                self._changed = True
                if len(line.at) > self.settings.capacity:
                    self._drop_oldest()

    def record_position(self, pose: ReceivedPose) -> None:
        """Record the position of a source that has left the path, without adding a sample.

        Preview data of Section III-A are those of a source that keeps to the path.
        """
        newest = self.newest
        if newest is not None and pose.measured_at > newest.measured_at:
            self.newest = pose

    def _start(self, pose: ReceivedPose) -> None:
        self.newest = pose
        self.sample_count = 1
        self._line = Polyline()
        self._line.append((pose.measured_at, pose.east, pose.north, pose.yaw), 0.0)
        self._first_yaw = pose.yaw
        self._dropped_until = BRIDGE_AT
        self._bridged_from = None
        self.joined = False
        self._ego_station = None
        self._holes.clear()

    def _fill(self, after: Point, speed: float) -> None:
        """Bridge the hole before `after` by a cubic with the positions and headings of both ends.

        The points are about `bridge_spacing` apart, and their instants evenly distributed.
        """
        before = self._line.point(-1)
        length = hypot(after[1] - before[1], after[2] - before[2])
        if length < self.settings.hole:
            return
        spacing = max(self.settings.bridge_spacing, length / MAX_BRIDGE_POINTS)
        try:
            points = curve_between(before[1:4], after[1:4], spacing)
        except UnbridgedError:  # no such curve: keep the straight step
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
        """Insert a late sample into a hole and bridge both sides of the sample."""
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
        self._fill(point, speed)
        self._line.append(point, max(step(self._line.point(-1), point), self.settings.spacing))

    def _insert(self, pose: ReceivedPose) -> None:
        """Insert a late sample, unless its neighbours were dropped or it contradicts them."""
        line, at = self._line, pose.measured_at
        point = (at, pose.east, pose.north, pose.yaw)
        if at <= self._dropped_until:
            return
        hole = next((hole for hole in self._holes if hole.before[0] < at < hole.end), None)
        if hole is not None:
            self._insert_in_hole(hole, point, pose.speed)
            return
        index = bisect_left(line.at, at)
        steps = [0.0, 0.0]
        for side, k in enumerate((index - 1, index)):
            if not 0 <= k < len(line.at) or line.at[k] == BRIDGE_AT:
                continue
            neighbour = line.point(k)
            if not _is_drivable(neighbour, point, pose.speed):
                return
            steps[side] = step(point, neighbour) if side else step(neighbour, point)
            if steps[side] < self.settings.spacing:
                return
        self._changed = True
        self.sample_count += 1
        if index == 0 or line.at[index - 1] == BRIDGE_AT:
            self._begin_earlier(point, index)
            return
        before = line.station[index - 1]
        shift = line.insert(index, point, *steps)
        if self._ego_station is not None and self._ego_station > before:
            self._ego_station += shift

    def _begin_earlier(self, point: Point, bridge_points: int) -> None:
        """Start the line with a late sample that is older than the first received one."""
        start, self._bridged_from = self._bridged_from, None
        self.joined = self._dropped_until != BRIDGE_AT
        self._line.drop(bridge_points)
        self._line.prepend([point])
        self._first_yaw = point[3]
        self._ego_station = None
        if start is not None:
            self.bridge(*start)

    def bridge(self, east: float, north: float) -> None:
        """Join the ego's position to the first sample by a straight line, if that lies ahead.

        The source's path before its first message is unknown, but a convoy starts on a straight.
        With points on it the fit interpolates, instead of extrapolating a few noisy samples
        backwards over 15 to 60 m. Does nothing once `joined`, or before the first sample.
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
        """The received samples of a window (Section III-A), without the bridges over holes."""
        if not self._holes or self._ego_station is None:
            return window
        stations = window.station + self._ego_station
        keep = np.ones(len(stations), dtype=np.bool_)
        for hole in self._holes:
            low, high = self._station_at(hole.before[0]), self._station_at(hole.end)
            keep &= (stations < low + 1e-6) | (stations > high - 1e-6)
        return Window(*(values[keep] for values in window))

    def has_bridge_points(self, window: Window) -> bool:
        """Whether the last `window` contains bridge points (not in Section III-A)."""
        line, ego = self._line, self._ego_station
        if ego is None:
            return False
        if line.at[0] == BRIDGE_AT:
            first = bisect_right(line.at, BRIDGE_AT)
            received_from = line.station[first] if first < len(line.at) else inf
            if window.station.item(0) + ego < received_from - 1e-6:
                return True
        return bool(self._holes) and len(self.without_bridges(window).station) < len(window.station)

    def instants(self, window: Window) -> list[int]:
        """Instants (ns) of the samples of the last `window` (time stamps, Section III-B)."""
        line, ego = self._line, self._ego_station or 0.0
        indices = (bisect_left(line.station, ego + station - 1e-6) for station in window.station)
        return [line.at[min(index, len(line.at) - 1)] for index in indices]

    def _station_at(self, at: int) -> float:
        """Station (m) of the first held point at or after the instant `at` (ns)."""
        return self._line.station[min(bisect_left(self._line.at, at), len(self._line.at) - 1)]

    def window(self, east: float, north: float, behind: float, ahead: float) -> Window:
        """Samples from `behind` to `ahead` (m of travel) of the ego at (east, north).

        The preview data of Section III-A, which sorts by distance and keeps none behind.

        With `behind` > 0 the nearest sample behind the ego is always included: a curve through
        samples ahead is extrapolated to the ego and may pass metres from it. Fewer than
        `min_samples` are supplemented by the next ones on both sides. More than `max_samples` are
        thinned to every second, fourth, … sample, always the same ones while the ego moves.
        """
        ego = self._locate(east, north)
        line = self._line
        first = bisect_left(line.station, ego - behind)
        if behind > 0.0:
            first = min(first, max(bisect_right(line.station, ego) - 1, 0))
        last = bisect_right(line.station, ego + ahead)
        if last - first < self.settings.min_samples:
            first, last = self._widened(ego, first, last)
        stride = 1 << (max(last - first - 1, 0) // self.settings.max_samples).bit_length()
        first += -(first + line.dropped) % stride
        chosen = slice(first, last, stride)
        return Window(
            np.array(line.east[chosen], dtype=np.float64),
            np.array(line.north[chosen], dtype=np.float64),
            np.array(line.station[chosen], dtype=np.float64) - ego,
        )

    def _widened(self, ego: float, first: int, last: int) -> tuple[int, int]:
        """Include the next samples on either side of the ego."""
        index = bisect_left(self._line.station, ego)
        half = self.settings.min_samples // 2
        last = max(last, min(index + half, len(self._line.at)))
        return max(min(first, last - self.settings.min_samples, index - half), 0), last

    def spacing(self, east: float, north: float) -> float | None:
        """Arc length (m) from the ego to the newest pose; None before the first one."""
        if self.newest is None:
            return None
        ego = self._locate(east, north)
        beyond_east = self.newest.east - self._line.east[-1]
        beyond_north = self.newest.north - self._line.north[-1]
        beyond = beyond_east * cos(self.newest.yaw) + beyond_north * sin(self.newest.yaw)
        return self._line.station[-1] + beyond - ego

    def known_ahead(self, east: float, north: float) -> float:
        """Length (m) of the known path ahead of the ego, negative if it ends behind the ego.

        The metres left of the preview of Section III-A; NaN before the first sample.
        """
        return self._line.station[-1] - self._locate(east, north) if self._line.at else nan

    def _locate(self, east: float, north: float) -> float:
        """Move the ego's station to the nearest point within reach of its last station."""
        line, position = self._line, (east, north)
        if self._ego_station is not None and position == self._located_at and not self._changed:
            return self._ego_station
        before, self._located_at, self._changed = self._located_at, position, False
        if len(line.at) < 2:
            first = position if not line.at else (line.east[0], line.north[0])
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
        if len(line.at) > 2 * DROP_CHUNK and line.station[DROP_CHUNK] < stale:
            self._drop_oldest()
        return self._ego_station

    def _drop_oldest(self) -> None:
        self._dropped_until = max(self._dropped_until, self._line.at[DROP_CHUNK - 1])
        self._line.drop(DROP_CHUNK)
        self.joined = True


def _is_drivable(first: Point, second: Point, speed: float) -> bool:
    distance = hypot(second[1] - first[1], second[2] - first[2])
    return drivable(distance, abs(second[0] - first[0]), abs(speed))
