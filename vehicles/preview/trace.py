"""Received samples of one source in order of travel, and the ego's station among them.

The ego's station (arc length) moves only locally from one call to the next. Samples that are close
in the plane but far along the trace (the other leg of a hairpin, the crossing of a figure of eight,
another lap) are therefore never considered.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import atan2, ceil, hypot, inf, nan, remainder, tau
from typing import Final, NamedTuple

import numpy as np

from vehicles.geometry.bridges import UnbridgedError, curve_between
from vehicles.geometry.geodesy import along
from vehicles.geometry.sampled_path import (
    HARDEST_BRAKING,
    Place,
    PlacedPose,
    ReceivedCurve,
    curve_through,
    drivable,
    has_passed,
    received_curve,
)
from vehicles.preview.samples import Polyline, TraceSettings, Window, spaced, step, window_around
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

# ---- Holes in the received positions of a source: bridged, or closed by path histories


BRIDGE_AT: Final = -1  # Instant of bridge points: before any sample
MAX_BRIDGE_POINTS: Final = 500  # Largest number of points that bridge a hole
HISTORY_TOLERANCE: Final = 0.5
HISTORY_DEVIATIONS: Final = 4.0
"""A path history is ignored if the last sample lies further off it than this distance (m) plus this
number of standard deviations, as stated."""
ASIDE: Final = 10.0  # Largest distance (m) from the ego at which a path history passes it
KEPT_BEHIND: Final = 20  # Number of points behind the ego that are kept of a path history
NOTHING_RECEIVED: Final = ReceivedCurve([], covers=False, places=0)


class TraceHole(NamedTuple):
    """A hole without received positions: the point before it, speed (m/s) and instant (ns) after.

    A curve bridges it, unless no curve joins its ends.
    """

    before: PlacedPose
    speed: float
    end: int


class Stretch(NamedTuple):
    """Received positions without a hole, from `start` to `end` (m from the ego's projection).

    `first` is its first point. The source drove about `hole` (m) unobserved before it and turned by
    `turn` (rad) there; 0 at the beginning of the trace.
    """

    start: float
    end: float
    first: PlacedPose
    hole: float
    turn: float


def bridge(before: PlacedPose, after: PlacedPose, spacing: float) -> list[PlacedPose]:
    """Points on a cubic with the positions and headings of both ends.

    They are about `spacing` (m) apart, at most `MAX_BRIDGE_POINTS`, with evenly distributed
    instants. Empty if no such curve joins the ends.
    """
    length = hypot(after[1] - before[1], after[2] - before[2])
    try:
        places = curve_between(before[1:4], after[1:4], max(spacing, length / MAX_BRIDGE_POINTS))
    except UnbridgedError:
        return []
    count, span = places.shape[1], after[0] - before[0]
    ends = [*places.T.tolist(), [after[1], after[2]]]
    points: list[PlacedPose] = []
    for k, ((east, north), (next_east, next_north)) in enumerate(pairwise(ends)):
        yaw = atan2(next_north - north, next_east - east)
        points.append((before[0] + span * (k + 1) // (count + 1), east, north, yaw))
    return points


def curve_to(
    pose: ReceivedPose, before: PlacedPose, newest_speed: float, spacing: float
) -> ReceivedCurve:
    """Curve along the history of `pose` from the point `before` on.

    Its points are about `spacing` (m) apart; `newest_speed` (m/s) is that of the newest pose.
    """
    history = pose.path_history()
    if not history:
        return NOTHING_RECEIVED
    after = pose.measured_at, pose.east, pose.north
    tolerance = HISTORY_TOLERANCE + HISTORY_DEVIATIONS * pose.accuracy
    curve = received_curve(history, before[:3], after, spacing, tolerance)
    seconds = (pose.measured_at - before[0]) / SECOND
    speed = (
        max(pose.speed, newest_speed) + HARDEST_BRAKING * seconds
    )  # it may have been faster within the hole
    for start, end in pairwise([before, *curve.points, (*after, pose.yaw)]):
        if not is_drivable(start, end, speed):
            return NOTHING_RECEIVED
    return curve


def path_past(
    history: Sequence[Place], spacing: float, east: float, north: float, yaw: float
) -> tuple[list[PlacedPose], bool]:
    """Curve through `history` from shortly behind the ego on, and whether it passes the ego.

    All of the curve if it does not; without the last place.
    """
    points = curve_through(history, 0, len(history) - 1, spacing)
    for k in range(len(points) - 1, -1, -1):
        if has_passed(points[k], east, north, yaw, ASIDE):
            return points[max(k - KEPT_BEHIND, 0) :], True
    return points, False


def stretches_of(line: Polyline, holes: Sequence[TraceHole], ego: float) -> list[Stretch]:
    """Received stretches in order of travel, relative to the ego's station (m)."""
    stretches: list[Stretch] = []
    first, length, turn = 0, 0.0, 0.0
    for hole in sorted(holes):
        last = bisect_right(line.at, hole.before[0]) - 1
        following = bisect_left(line.at, hole.end)
        if last < first or following >= len(line.at):  # dropped, or no sample kept after it
            continue
        stretches.append(_stretch(line, first, last, ego, length, turn))
        length, turn = _extent(line, last, following, hole.speed)
        first = following
    stretches.append(_stretch(line, first, len(line.at) - 1, ego, length, turn))
    return stretches


def _stretch(  # noqa: PLR0917 - its fields
    line: Polyline, first: int, last: int, ego: float, hole: float, turn: float
) -> Stretch:
    start = line.station[first] - ego if hole else -inf
    return Stretch(start, line.station[last] - ego, line.point(first), hole, turn)


def _extent(line: Polyline, last: int, following: int, speed: float) -> tuple[float, float]:
    """Distance (m) that the source drove between two points, and its least turn (rad)."""
    _, east, north, yaw = line.point(last)
    at, next_east, next_north, next_yaw = line.point(following)
    span = (at - line.at[last]) / SECOND
    if last and line.at[last - 1] != BRIDGE_AT:
        driven = line.station[last] - line.station[last - 1]
        taken = (line.at[last] - line.at[last - 1]) / SECOND
        speed = 0.5 * (speed + driven / taken) if taken > 0.0 else speed
    chord = hypot(next_east - east, next_north - north)
    course = atan2(next_north - north, next_east - east)
    turn = abs(remainder(course - yaw, tau)) + abs(remainder(next_yaw - course, tau))
    return max(chord, speed * span), turn


def is_drivable(first: PlacedPose, second: PlacedPose, speed: float) -> bool:
    """Whether a car at `speed` (m/s) can have driven from one point to the other."""
    distance = hypot(second[1] - first[1], second[2] - first[2])
    return drivable(distance, abs(second[0] - first[0]), abs(speed))


# ---- Trace


MAX_HOLES: Final = 64  # Largest number of remembered holes and closed stretches
LONGEST_STEP: Final = SECOND // 8
"""Time (ns) between two samples from which on a path history closes the step: two missing messages
at 20 Hz, and every step of a source that sends at 5 Hz or less."""
DROP_CHUNK: Final = 64  # Number of samples behind the ego that are dropped at once


class Trace:
    """The accepted samples of one source, stored in order of travel as in Section III-A.

    `newest` is the newest pose, `sample_count` the number of samples since the line began. `joined`
    is True once no bridge from the ego to the line is needed any more.

    A path history sent with a pose closes holes: its positions are received ones, and further
    points follow the curve through them. Holes that no history covers are bridged by a guess.
    """

    def __init__(self, settings: TraceSettings | None = None, *, closes_holes: bool = True) -> None:
        """Without `closes_holes` path histories are ignored."""
        self.settings = settings or TraceSettings()
        self._closes_holes = closes_holes
        self._first: ReceivedPose | None = None
        self._closed: list[tuple[int, int]] = []
        self.newest: ReceivedPose | None = None
        self._beyond: float | None = None
        self.sample_count = 0
        self.joined = False
        self._line = Polyline()
        self._first_yaw = 0.0
        self._dropped_until = BRIDGE_AT
        self._bridged_from: tuple[float, float, float] | None = None
        self._ego_station: float | None = None
        self._located_at: tuple[float, float] | None = None
        self._changed = False
        self._holes: list[TraceHole] = []

    def __len__(self) -> int:
        return len(self._line.at)

    def add(
        self, pose: ReceivedPose, *, after_hole: bool = False, at_new_place: bool = False
    ) -> None:
        """Insert a pose in the order of travel (Section III-A).

        `after_hole` closes the missing stretch by the pose's history, or bridges it by a curve.
        `at_new_place` starts another line at a position to which no car can have driven.
        """
        newest = self.newest
        if newest is None or at_new_place:
            self._start(pose)
            self._first = None if at_new_place else pose
        elif pose.measured_at <= newest.measured_at:
            self._insert(pose)
        else:
            point = (pose.measured_at, pose.east, pose.north, pose.yaw)
            if after_hole or pose.measured_at - newest.measured_at > LONGEST_STEP:
                self._fill(point, pose, bridges=after_hole)
            self.newest, self._beyond = pose, None
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
        newest, beyond = self.newest, self._beyond
        if newest is not None and pose.measured_at > newest.measured_at:
            if beyond is None:
                beyond = self._beyond_line(newest)
            self.newest, self._beyond = (
                pose,
                beyond + along(pose.yaw, pose.east - newest.east, pose.north - newest.north),
            )

    def _beyond_line(self, pose: ReceivedPose) -> float:
        """Distance (m) of a pose ahead of the last point of the line."""
        return along(pose.yaw, pose.east - self._line.east[-1], pose.north - self._line.north[-1])

    def _start(self, pose: ReceivedPose) -> None:
        self.newest, self._beyond = pose, None
        self.sample_count = 1
        self._line = Polyline()
        self._line.append((pose.measured_at, pose.east, pose.north, pose.yaw), 0.0)
        self._first_yaw = pose.yaw
        self._dropped_until = BRIDGE_AT
        self._bridged_from = None
        self.joined = False
        self._ego_station = None
        self._holes.clear()
        self._closed.clear()

    @property
    def holes(self) -> list[tuple[float, float]]:
        """Begin and end (station, m) of the holes that no received position covers, in order."""
        return [
            (self._station_at(hole.before[0]), self._station_at(hole.end)) for hole in self._holes
        ]

    def _fill(self, after: PlacedPose, pose: ReceivedPose, *, bridges: bool) -> None:
        """Close the hole before `after` by the history of `pose`; bridge the rest if it `bridges`.

        A curve closes or bridges a hole, with points about `bridge_spacing` apart.
        """
        before = self._line.point(-1)
        length = hypot(after[1] - before[1], after[2] - before[2])
        if length < self.settings.hole:
            return
        curve = NOTHING_RECEIVED
        if self._closes_holes:
            newest_speed = 0.0 if self.newest is None else self.newest.speed
            curve = curve_to(pose, before, newest_speed, self.settings.bridge_spacing)
        if bridges and not curve.covers:
            self._bridge(before, curve.points[0] if curve.points else after, pose.speed)
        if not curve.points:
            return
        self._closed = [*self._closed[1 - MAX_HOLES :], (curve.points[0][0], after[0])]
        self.sample_count += curve.places
        for point in curve.points:
            distance = step(self._line.point(-1), point)
            if distance >= self.settings.spacing:
                self._line.append(point, distance)

    def _bridge(self, before: PlacedPose, after: PlacedPose, speed: float) -> None:
        """Bridge a hole by a guess: a cubic, or the straight step if none is possible."""
        if hypot(after[1] - before[1], after[2] - before[2]) < self.settings.hole:
            return
        self._holes = [*self._holes[1 - MAX_HOLES :], TraceHole(before, speed, after[0])]
        for point in bridge(before, after, self.settings.bridge_spacing):
            last = self._line.point(-1)
            self._line.append(point, hypot(point[1] - last[1], point[2] - last[2]))

    def _insert_in_hole(self, hole: TraceHole, point: PlacedPose, pose: ReceivedPose) -> None:
        """Insert a late sample into a hole and close or bridge both sides of the sample."""
        line, before = self._line, hole.before
        first, last = bisect_right(line.at, before[0]), bisect_left(line.at, hole.end)
        if not 0 < first <= last < len(line.at) or not is_drivable(
            before, point, max(hole.speed, pose.speed)
        ):
            return
        self._holes.remove(hole)
        station, tail = line.station[last], line.cut(last)
        line.cut(first)
        self._fill(point, pose, bridges=True)
        self._append(point)
        self._bridge(point, tail[0], pose.speed)
        self._append(tail[0])
        shift = line.station[-1] - station
        for later in tail[1:]:
            line.append(later, step(line.point(-1), later))
        if self._ego_station is not None and self._ego_station > station:
            self._ego_station += shift
        self._changed = True

    def _append(self, point: PlacedPose) -> None:
        self._line.append(point, max(step(self._line.point(-1), point), self.settings.spacing))

    def _insert(self, pose: ReceivedPose) -> None:
        """Insert a late sample, unless its neighbours were dropped or it contradicts them."""
        line, at = self._line, pose.measured_at
        point = (at, pose.east, pose.north, pose.yaw)
        if at <= self._dropped_until:
            return
        hole = next((hole for hole in self._holes if hole.before[0] < at < hole.end), None)
        if hole is not None:
            self._insert_in_hole(hole, point, pose)
            return
        index = bisect_left(line.at, at)
        steps = [0.0, 0.0]
        for side, k in enumerate((index - 1, index)):
            if not 0 <= k < len(line.at) or line.at[k] == BRIDGE_AT:
                continue
            neighbour = line.point(k)
            if not is_drivable(neighbour, point, pose.speed):
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

    def _begin_earlier(self, point: PlacedPose, bridge_points: int) -> None:
        """Start the line with a late sample that is older than the first received one."""
        start, self._bridged_from = self._bridged_from, None
        self.joined = self._dropped_until != BRIDGE_AT
        self._line.drop(bridge_points)
        self._line.prepend([point])
        self._first_yaw = point[3]
        self._ego_station = None
        if start is not None:
            self.bridge(*start)

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
        ahead_east, ahead_north = line.east[0] - east, line.north[0] - north
        length = hypot(ahead_east, ahead_north)
        distance = along(self._first_yaw, ahead_east, ahead_north)
        if distance <= self.settings.bridge_spacing or length > self.settings.bridge_length:
            return
        count = ceil(length / self.settings.bridge_spacing)
        shares = [k / count for k in range(count)]
        course = atan2(ahead_north, ahead_east)
        line.prepend(
            [
                (BRIDGE_AT, east + share * ahead_east, north + share * ahead_north, course)
                for share in shares
            ]
        )
        self._bridged_from = (east, north, yaw)
        self.joined = True
        self._ego_station = None

    def _prepend_history(self, pose: ReceivedPose, east: float, north: float, yaw: float) -> None:
        """Begin the line with the path that the source drove since it was at the ego's pose."""
        history = [place for place in pose.path_history() if place[0] < pose.measured_at]
        line = self._line
        if not history or line.at[0] != pose.measured_at:  # an older pose was received since
            return
        places = [*history, (pose.measured_at, pose.east, pose.north)]
        kept, passes = path_past(places, self.settings.bridge_spacing, east, north, yaw)
        if not kept:  # all places are equal
            return
        self.joined = self.joined or passes
        line.prepend(spaced([*kept, line.point(0)], self.settings.spacing)[:-1])
        self._first_yaw = line.yaw[0]
        self.sample_count += len([place for place in history if place[0] >= kept[0][0]])
        self._closed.append((kept[0][0], pose.measured_at))
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
        line, ego = self._line, self._ego_station
        if ego is None:
            return False
        if line.at[0] == BRIDGE_AT:
            first = bisect_right(line.at, BRIDGE_AT)
            received_from = line.station[first] if first < len(line.at) else inf
            if window.station.item(0) + ego < received_from - 1e-6:
                return True
        if self._holes and len(self.without_bridges(window).station) < len(window.station):
            return True
        low, high = window.station.item(0) + ego, window.station.item(-1) + ego
        for begin, end in self._closed:
            if self._station_at(begin) < high and self._station_at(end) > low:
                return True
        return False

    def instants(self, window: Window) -> list[int]:
        """Instants (ns) of the samples of the last `window` (time stamps, Section III-B)."""
        line, ego = self._line, self._ego_station or 0.0
        indices = (bisect_left(line.station, ego + station - 1e-6) for station in window.station)
        return [line.at[min(index, len(line.at) - 1)] for index in indices]

    def _station_at(self, at: int) -> float:
        return self._line.station[min(bisect_left(self._line.at, at), len(self._line.at) - 1)]

    def window(self, east: float, north: float, behind: float, ahead: float) -> Window:
        """Samples from `behind` to `ahead` (m) of the ego at (east, north), by `window_around`."""
        ego = self._locate(east, north)
        return window_around(self._line, ego, behind, ahead, self.settings)

    def spacing(self, east: float, north: float) -> float | None:
        """Arc length (m) from the ego to the newest pose; None before the first one.

        Beyond the line it is the distance that the source has driven since it left the path.
        """
        if self.newest is None:
            return None
        ego = self._locate(east, north)
        beyond = self._beyond
        if beyond is None:
            beyond = self._beyond_line(self.newest)
        return self._line.station[-1] + beyond - ego

    def known_ahead(self, east: float, north: float) -> float:
        """Length (m) of the known path ahead of the ego, negative if it ends behind the ego.

        The metres left of the preview of Section III-A; NaN before the first sample.
        """
        return self._line.station[-1] - self._locate(east, north) if self._line.at else nan

    def stretches(self, east: float, north: float) -> list[Stretch]:
        """Received stretches in order of travel, relative to the ego at (east, north)."""
        if not self._line.at:
            return []
        ego = self._locate(east, north)
        return stretches_of(self._line, self._holes, ego)

    def distance_from(self, east: float, north: float, start: float, end: float) -> float:
        """Distance (m) of (east, north) from the line between `start` and `end` (m from the ego).

        Requires a located ego.
        """
        ego = self._ego_station or 0.0
        return self._line.distance_from(east, north, ego + start, ego + end)

    def _locate(self, east: float, north: float) -> float:
        """Move the ego's station to the nearest point within reach of its last station."""
        line, position = self._line, (east, north)
        if self._ego_station is not None and position == self._located_at and not self._changed:
            return self._ego_station
        before, self._located_at, self._changed = self._located_at, position, False
        if len(line.at) < 2:
            first = position if not line.at else (line.east[0], line.north[0])
            off_east, off_north = east - first[0], north - first[1]
            return along(self._first_yaw, off_east, off_north)
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
        self._holes = [hole for hole in self._holes if hole.end > self._dropped_until]
        self._closed = [span for span in self._closed if span[1] > self._dropped_until]
        self.joined = True


# ---- The known path ahead: what received positions of all sources cover together
#
# A curve over a hole in a trace is a guess: a source that turned within the hole was beside it. A
# follower is blind within a hole, unless positions of the other source cover it.


LEAST_BEND: Final = 1.0 / 500.0  # Bends (1/m) to expect anywhere: the paper's lane change
CERTAIN: Final = 0.5  # Largest deviation (m) of the path from a bridge that a car may cross
SAME_PATH: Final = 1.75  # Stretches this close (m, half a lane) join


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
    here = [(trace, part) for trace, part in known if part.start <= 0.0 <= part.end]
    if not here:
        behind = [pair for pair in known if pair[1].end < 0.0]
        here = [max(behind, key=lambda pair: pair[1].end)] if behind else []
    if not here:  # the car is before the first sample
        here = [min(known, key=lambda pair: pair[1].start)]
    trace, reached = max(here, key=lambda pair: pair[1].end)
    while True:
        later = [pair for pair in known if pair[1].end > reached.end]
        joined = [pair for pair in later if _continues(trace, reached, pair[1])]
        if not joined:
            break
        trace, reached = max(joined, key=lambda pair: pair[1].end)
    if not later:
        return KnownPath(reached.end, None)
    _, beyond = min(later, key=lambda pair: pair[1].start)
    return KnownPath(reached.end, PathHole(beyond.hole, beyond.turn))


def _continues(trace: Trace, reached: Stretch, later: Stretch) -> bool:
    """Whether a stretch of another source begins on a stretch of this `trace`."""
    if later.start > reached.end:
        return False
    _, east, north, _ = later.first
    start = max(reached.start, later.start - SAME_PATH)
    return later.hole == 0.0 or trace.distance_from(east, north, start, reached.end) <= SAME_PATH
