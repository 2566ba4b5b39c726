"""Received samples of one source in order of travel, and the ego's station among them.

The ego's station (arc length) moves only locally from one call to the next. Samples that are close
in the plane but far along the trace (the other leg of a hairpin, the crossing of a figure of eight,
another lap) are therefore never considered.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import atan2, ceil, cos, hypot, inf, nan, remainder, sin, tau
from typing import Final, NamedTuple

import numpy as np

from vehicles.geometry.bridges import UnbridgedError, curve_between, curve_through
from vehicles.geometry.geodesy import along
from vehicles.geometry.sampled_path import (
    HARDEST_BRAKING,
    TIME_UNIT,
    PlacedPose,
    distance_from_segment,
    drivable,
)
from vehicles.preview.samples import Polyline, Window, step, window_around
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

# ---- Holes in the received positions of a source: bridged, or closed by path histories


HOLE: Final = 5.0  # Distance (m) from which on a loss of the source is bridged
BRIDGE_SPACING: Final = 1.0  # Distance (m) between the points of a bridge
BRIDGE_LENGTH: Final = 500.0  # Longest bridge (m) from the ego to the first sample
BRIDGE_AT: Final = -1  # Instant of the points of that bridge: before any sample
MAX_BRIDGE_POINTS: Final = 500  # Largest number of points that bridge a hole
HISTORY_TOLERANCE: Final = 0.5
HISTORY_DEVIATIONS: Final = 4.0
"""A path history is ignored if the last sample lies further off it than this distance (m) plus this
number of standard deviations, as stated."""
ASIDE: Final = 10.0  # Largest distance (m) from the ego at which a path history passes it
KEPT_BEHIND: Final = 20  # Number of points behind the ego that are kept of a path history
LEAST_BEND: Final = 1.0 / 500.0  # Bends (1/m) to expect anywhere: the paper's lane change
CERTAIN: Final = 0.5  # Largest deviation (m) of the path from a bridge that a car may cross


class PathHole(NamedTuple):
    """A stretch that no source covers: `length` (m) along the path, least `turn` (rad) within."""

    length: float
    turn: float

    def is_certain(self, bend: float) -> bool:
        """Whether the path is close to any gentle curve over the hole, at curvatures up to `bend`.

        Two curves with the same ends and headings, one bending left first and one right, both with
        curvature κ, are at most κ s²/16 from the curve between them.
        """
        bend = max(bend, LEAST_BEND, self.turn / self.length)
        return bend * self.length**2 / 16.0 <= CERTAIN


class TraceHole(NamedTuple):
    """A hole without received positions, between two instants (ns).

    A curve bridges it, unless no curve joins its ends. `path` is the stretch that the source drove.
    """

    begin: int
    end: int
    path: PathHole


class Stretch(NamedTuple):
    """Received positions without a hole, from `start` to `end` (m from the ego's projection).

    `first` is its first point. The source drove the `hole` unobserved before it; None at the
    beginning of the trace.
    """

    start: float
    end: float
    first: PlacedPose
    hole: PathHole | None


def bridge(before: PlacedPose, after: PlacedPose) -> list[PlacedPose]:
    """Points on a cubic with the positions and headings of both ends.

    They are about `BRIDGE_SPACING` apart, at most `MAX_BRIDGE_POINTS`, with evenly distributed
    instants. Empty if no such curve joins the ends.
    """
    length = hypot(after[1] - before[1], after[2] - before[2])
    spacing = max(BRIDGE_SPACING, length / MAX_BRIDGE_POINTS)
    try:
        return curve_between(before, after, spacing)
    except UnbridgedError:
        return []


def curve_to(
    pose: ReceivedPose, before: PlacedPose, newest_speed: float
) -> tuple[list[PlacedPose], bool, int]:
    """Points of the path history of `pose` after the point `before`, about `BRIDGE_SPACING` apart.

    Also whether they begin at `before` rather than later, and the number of received positions on
    them. No points if `before` lies off the history, or if no car can have driven them;
    `newest_speed` (m/s) is that of the newest pose.
    """
    history, end = pose.path_history(), (pose.measured_at, pose.east, pose.north)
    older = [place for place in history if place[0] <= before[0] + TIME_UNIT]
    inside = [place for place in history[len(older) :] if place[0] < end[0] - TIME_UNIT]
    places = [*inside, end]
    if older:
        tolerance = HISTORY_TOLERANCE + HISTORY_DEVIATIONS * pose.accuracy
        if not distance_from_segment(older[-1], places[0], *before[1:3]) <= tolerance:
            return [], False, 0
        places = [*older, before[:3], *places]
    points = curve_through(places, len(older), BRIDGE_SPACING)[len(older[:1]) :]
    seconds = (end[0] - before[0]) / SECOND  # it may have been faster within the hole
    speed = max(pose.speed, newest_speed) + HARDEST_BRAKING * seconds
    if not all(is_drivable(*pair, speed) for pair in pairwise([before, *points, (*end, pose.yaw)])):
        return [], False, 0
    return points, bool(older), len(inside)


def has_passed(point: PlacedPose, east: float, north: float, yaw: float) -> bool:
    """Whether a vehicle up to `ASIDE` off a path is at or ahead of a `point` of it."""
    _, point_east, point_north, course = point
    forward, left = cos(course), sin(course)
    off_east, off_north = east - point_east, north - point_north
    is_beside = abs(off_north * forward - off_east * left) <= ASIDE
    return is_beside and off_east * forward + off_north * left >= 0.0 and cos(yaw - course) > 0.5


def is_drivable(first: PlacedPose, second: PlacedPose, speed: float) -> bool:
    """Whether a car at `speed` (m/s) can have driven from one point to the other."""
    distance = hypot(second[1] - first[1], second[2] - first[2])
    return drivable(distance, abs(second[0] - first[0]), abs(speed))


# ---- Trace


SPACING: Final = 0.2
"""Least distance (m) of a sample from the previous one: a stopped source repeats its position, and
a fix may lie behind another."""
BACK: Final = 2.0  # Per call the ego's station moves back by at most this (m)..
MARGIN: Final = 2.0  # ...and forward by at most this (m)..
REACH_RATIO: Final = 1.5  # ...plus this ratio of the distance that the ego moved..
REACH: Final = 10.0  # ...and never more than this (m)
MEMORY: Final = 100.0  # Samples further behind the ego (m) are dropped
DROP_CHUNK: Final = 64  # Number of samples that are dropped at once
LONGEST_STEP: Final = SECOND // 8
"""Time (ns) between two samples from which on a path history closes the step: two missing messages
at 20 Hz, and every step of a source that sends at 5 Hz or less."""


class Trace:
    """The accepted samples of one source, stored in order of travel as in Section III-A.

    `newest` is the newest pose, `sample_count` the number of samples since the line began. `joined`
    is True once no bridge from the ego to the line is needed any more.

    A path history sent with a pose closes holes: its positions are received ones, and further
    points follow the curve through them. Holes that no history covers are bridged by a guess.
    """

    def __init__(self, *, closes_holes: bool = True) -> None:
        """Without `closes_holes` path histories are ignored."""
        self._closes_holes = closes_holes
        self.newest: ReceivedPose | None = None
        self._first: ReceivedPose | None = None
        self._beyond = 0.0
        self._located_at: tuple[float, float] | None = None
        self._changed = False
        self._restart()

    def _restart(self) -> None:
        self.sample_count = 0
        self.joined = False
        self._line = Polyline()
        self._ego_station: float | None = None
        self._holes: list[TraceHole] = []
        self._guessed: set[int] = set()  # Instants of the points of bridges over holes
        self._constructed: set[int] = set()  # Instants of other points that were not received

    def __len__(self) -> int:
        return len(self._line.at)

    def add(
        self, pose: ReceivedPose, *, after_hole: bool = False, at_new_place: bool = False
    ) -> None:
        """Insert a pose in the order of travel (Section III-A).

        `after_hole` closes the missing stretch by the pose's history, or bridges it by a curve.
        `at_new_place` starts another line at a position to which no car can have driven.
        """
        newest, point = self.newest, (pose.measured_at, pose.east, pose.north, pose.yaw)
        if newest is None or at_new_place:
            self._restart()
            self._first = None if at_new_place else pose
            self._line.append(point, 0.0)
        elif pose.measured_at <= newest.measured_at:
            self._insert(point, pose.speed)
            return
        else:
            if after_hole or pose.measured_at - newest.measured_at > LONGEST_STEP:
                self._fill(point, pose, newest.speed, bridges=after_hole)
            self._append(point)
        self.sample_count += 1
        self.newest = pose
        _, east, north, _ = self._line.points[-1]
        self._beyond = along(pose.yaw, pose.east - east, pose.north - north)

    def record_position(self, pose: ReceivedPose) -> None:
        """Record the position of a source that has left the path, without adding a sample.

        Preview data of Section III-A are those of a source that keeps to the path.
        """
        newest = self.newest
        if newest is not None and pose.measured_at > newest.measured_at:
            self._beyond += along(pose.yaw, pose.east - newest.east, pose.north - newest.north)
            self.newest = pose

    def _append(self, point: PlacedPose) -> None:
        distance = step(self._line.points[-1], point)
        if distance >= SPACING:  # else it stands, or the message was repeated
            self._line.append(point, distance)
            self._changed = True

    def _insert(self, point: PlacedPose, speed: float) -> None:
        """Insert a late sample between its neighbours, unless it contradicts them.

        A sample before the first one or within a hole is ignored: the path there remains a guess.
        """
        line, at = self._line, point[0]
        index = bisect_left(line.at, at)
        if not 0 < index < len(line.at) or line.at[index - 1] == BRIDGE_AT:
            return
        if any(hole.begin < at < hole.end for hole in self._holes):
            return
        for start, end in (line.points[index - 1], point), (point, line.points[index]):
            if not is_drivable(start, end, speed) or step(start, end) < SPACING:
                return
        self._changed = True
        self.sample_count += 1
        before, shift = line.station[index - 1], line.insert(index, point)
        if self._ego_station is not None and self._ego_station > before:
            self._ego_station += shift

    def _fill(
        self, after: PlacedPose, pose: ReceivedPose, newest_speed: float, *, bridges: bool
    ) -> None:
        """Close the hole before `after` by the history of `pose`; bridge the rest if it `bridges`.

        The bridge is a guess: a cubic, or the straight step if none is possible.
        """
        before = self._line.points[-1]
        if hypot(after[1] - before[1], after[2] - before[2]) < HOLE:
            return
        points, covers, count = list[PlacedPose](), False, 0
        if self._closes_holes:
            points, covers, count = curve_to(pose, before, newest_speed)
        guess, end = list[PlacedPose](), points[0] if points else after
        if bridges and not covers and hypot(end[1] - before[1], end[2] - before[2]) >= HOLE:
            unobserved = self._path_unobserved(end, pose.speed)
            self._holes.append(TraceHole(before[0], end[0], unobserved))
            guess = bridge(before, end)
            self._guessed.update([point[0] for point in guess])
        # The first point of a curve was received, or is next to one that was.
        self._constructed.update([point[0] for point in (*guess, *points[1:])])
        self.sample_count += count
        for point in (*guess, *points):
            self._append(point)

    def _path_unobserved(self, end: PlacedPose, speed: float) -> PathHole:
        """Estimate the stretch from the line to `end`, where the source has `speed` (m/s)."""
        line = self._line
        (at, east, north, yaw), (next_at, next_east, next_north, next_yaw) = line.points[-1], end
        if len(line.at) > 1 and line.at[-2] != BRIDGE_AT:
            driven = line.station[-1] - line.station[-2]
            speed = 0.5 * (speed + driven / ((at - line.at[-2]) / SECOND))
        chord = hypot(next_east - east, next_north - north)
        course = atan2(next_north - north, next_east - east)
        turn = abs(remainder(course - yaw, tau)) + abs(remainder(next_yaw - course, tau))
        return PathHole(max(chord, speed * (next_at - at) / SECOND), turn)

    def bridge(self, east: float, north: float, yaw: float) -> None:
        """Join the ego's pose to the first sample: by its path history, or by a straight line.

        Without a history the source's path before its first message is unknown, but a convoy starts
        on a straight. With points on it the fit interpolates, instead of extrapolating a few noisy
        samples backwards over 15 to 60 m. Does nothing once `joined`, or before the first sample.
        """
        first, self._first = self._first, None
        if first is not None and self._closes_holes:
            self._prepend_history(first, east, north, yaw)
        line = self._line
        if not line.at or self.joined:
            return
        _, first_east, first_north, first_yaw = line.points[0]
        ahead_east, ahead_north = first_east - east, first_north - north
        length, course = hypot(ahead_east, ahead_north), atan2(ahead_north, ahead_east)
        if along(first_yaw, ahead_east, ahead_north) <= BRIDGE_SPACING or length > BRIDGE_LENGTH:
            return
        shares = [k / ceil(length / BRIDGE_SPACING) for k in range(ceil(length / BRIDGE_SPACING))]
        line.prepend(
            [
                (BRIDGE_AT, east + share * ahead_east, north + share * ahead_north, course)
                for share in shares
            ]
        )
        self._constructed.add(BRIDGE_AT)
        self.joined = True
        self._ego_station = None

    def _prepend_history(self, pose: ReceivedPose, east: float, north: float, yaw: float) -> None:
        """Begin the line with the path that the source drove since it was at the ego's pose."""
        end, line = (pose.measured_at, pose.east, pose.north), self._line
        history = [place for place in pose.path_history() if place[0] < end[0]]
        points = curve_through([*history, end], 0, BRIDGE_SPACING)
        passed = [k for k, point in enumerate(points) if has_passed(point, east, north, yaw)]
        if passed:
            points, self.joined = points[max(passed[-1] - KEPT_BEHIND, 0) :], True
        kept = [line.points[0]]
        for point in reversed(points):
            if step(point, kept[-1]) >= SPACING:
                kept.append(point)
        line.prepend(kept[:0:-1])
        self._constructed.update([point[0] for point in kept[1:]])
        self.sample_count += len([at for at, _, _ in history if points and at >= points[0][0]])
        self._ego_station = None

    @property
    def holes(self) -> list[tuple[float, float]]:
        """Begin and end (station, m) of the holes that no received position covers, in order."""
        line = self._line
        return [
            (line.station[bisect_left(line.at, hole.begin)], line.station[end])
            for hole in self._holes
            if (end := bisect_left(line.at, hole.end)) < len(line.at)
        ]

    def instants(self, window: Window) -> list[int]:
        """Instants (ns) of the samples of the last `window` (time stamps, Section III-B)."""
        at, stations, last = self._line.at, self._line.station, len(self._line.at) - 1
        begin = (self._ego_station or 0.0) - 1e-6
        sampled = window.station.tolist()
        return [at[min(bisect_left(stations, begin + station), last)] for station in sampled]

    def without_bridges(self, window: Window) -> Window:
        """The received samples of a window (Section III-A), without the bridges over holes."""
        if not self._guessed:
            return window
        keep = np.array([at not in self._guessed for at in self.instants(window)], dtype=np.bool_)
        return window if keep.all() else Window(*(values[keep] for values in window))

    def longest_bridge(self, window: Window) -> float:
        """Length (m) of the longest bridge in a window of preview data (Section III-A)."""
        ego = self._ego_station or 0.0
        low, high = window.station.item(0) + ego, window.station.item(-1) + ego
        lengths = [end - begin - 1e-6 for begin, end in self.holes if begin < high and end > low]
        return max(lengths, default=0.0)

    def has_bridge_points(self, window: Window) -> bool:
        """Whether the last `window` contains constructed points (not in Section III-A).

        These are points of a bridge, or of the curve along a path history.
        """
        return bool(self._constructed) and not self._constructed.isdisjoint(self.instants(window))

    def window(self, east: float, north: float, behind: float, ahead: float) -> Window:
        """Samples from `behind` to `ahead` (m) of the ego at (east, north), by `window_around`."""
        return window_around(self._line, self._locate(east, north), behind, ahead)

    def spacing(self, east: float, north: float) -> float | None:
        """Arc length (m) from the ego to the newest pose; None before the first one.

        Beyond the line it is the distance that the source has driven since it left the path.
        """
        if self.newest is None:
            return None
        ego = self._locate(east, north)
        return self._line.station[-1] + self._beyond - ego

    def known_ahead(self, east: float, north: float) -> float:
        """Length (m) of the known path ahead of the ego, negative if it ends behind the ego.

        The metres left of the preview of Section III-A; NaN before the first sample.
        """
        return self._line.station[-1] - self._locate(east, north) if self._line.at else nan

    def stretches(self, east: float, north: float) -> list[Stretch]:
        """Received stretches in order of travel, relative to the ego at (east, north)."""
        line, ego = self._line, self._locate(east, north)
        if not line.at:
            return []
        stretches, first, gap = list[Stretch](), 0, None
        at = [station - ego for station in line.station]
        for hole in self._holes:
            last = bisect_right(line.at, hole.begin) - 1
            following = bisect_left(line.at, hole.end)
            if first <= last and following < len(at):  # neither dropped nor without later samples
                start = at[first] if gap else -inf
                stretches.append(Stretch(start, at[last], line.points[first], gap))
                first, gap = following, hole.path
        start = at[first] if gap else -inf
        return [*stretches, Stretch(start, at[-1], line.points[first], gap)]

    def distance_from(self, east: float, north: float, start: float, end: float) -> float:
        """Distance (m) of (east, north) from the line between `start` and `end` (m from the ego).

        Requires a located ego.
        """
        line, ego = self._line, self._ego_station or 0.0
        station = 0.0
        if len(line.at) > 1:
            station = line.nearest(east, north, ego + start, ego + end)
        _, easts, norths, _ = zip(*line.points, strict=True)
        line_east, line_north = (np.interp(station, line.station, row) for row in (easts, norths))
        return hypot(float(line_east) - east, float(line_north) - north)

    def _locate(self, east: float, north: float) -> float:
        """Move the ego's station to the nearest point within reach of its last station."""
        line, position = self._line, (east, north)
        if self._ego_station is not None and position == self._located_at and not self._changed:
            return self._ego_station
        before, self._located_at, self._changed = self._located_at, position, False
        if len(line.at) < 2:
            if not line.at:
                return 0.0
            _, first_east, first_north, yaw = line.points[0]
            return along(yaw, east - first_east, north - first_north)
        low, high = -inf, inf
        if self._ego_station is not None and before is not None:
            reach = MARGIN + REACH_RATIO * hypot(east - before[0], north - before[1])
            low, high = self._ego_station - BACK, self._ego_station + min(reach, REACH)
        self._ego_station = line.nearest(east, north, low, high)
        if len(line.at) > 2 * DROP_CHUNK and line.station[DROP_CHUNK] < self._ego_station - MEMORY:
            line.drop(DROP_CHUNK)
            self._holes = [hole for hole in self._holes if hole.end > line.at[0]]
            self._guessed.intersection_update(line.at)
            self._constructed.intersection_update(line.at)
            self.joined = True
        return self._ego_station


# ---- The known path ahead: what received positions of all sources cover together
#
# A curve over a hole in a trace is a guess: a source that turned within the hole was beside it. A
# follower is blind within a hole, unless positions of the other source cover it.


SAME_PATH: Final = 1.75  # Stretches this close (m, half a lane) join


class KnownPath(NamedTuple):
    """The known path ends `end` (m) ahead of the car, or behind it if negative.

    It ends at a `hole` if received positions continue beyond it.
    """

    end: float
    hole: PathHole | None


def known_path(traces: Sequence[Trace], east: float, north: float) -> KnownPath:
    """The known path ahead of a car at (east, north), from traces with at least one sample.

    A car within a hole has its known path behind it, where the hole begins.
    """
    known = [(trace, part) for trace in traces for part in trace.stretches(east, north)]
    here = [pair for pair in known if pair[1].start <= 0.0 <= pair[1].end]
    here = here or [pair for pair in known if pair[1].end < 0.0]
    here = here or [min(known, key=lambda pair: pair[1].start)]  # before the first sample
    trace, reached = max(here, key=lambda pair: pair[1].end)
    while later := [pair for pair in known if pair[1].end > reached.end]:
        joined = [pair for pair in later if _continues(trace, reached, pair[1])]
        if not joined:
            _, beyond = min(later, key=lambda pair: pair[1].start)
            return KnownPath(reached.end, beyond.hole)
        trace, reached = max(joined, key=lambda pair: pair[1].end)
    return KnownPath(reached.end, None)


def _continues(trace: Trace, reached: Stretch, later: Stretch) -> bool:
    """Whether a stretch of another source begins on a stretch of this `trace`."""
    if later.start > reached.end:
        return False
    _, east, north, _ = later.first
    start = max(reached.start, later.start - SAME_PATH)
    return later.hole is None or trace.distance_from(east, north, start, reached.end) <= SAME_PATH
