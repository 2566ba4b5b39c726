"""Holes in the received positions of a source: bridged, or closed by path histories."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import atan2, hypot, inf, remainder, tau
from typing import Final, NamedTuple

from vehicles.geometry.bridges import UnbridgedError, curve_between
from vehicles.geometry.sparse_path import (
    HARDEST_BRAKING,
    Place,
    PlacedPose,
    ReceivedCurve,
    curve_through,
    drivable,
    has_passed,
    received_curve,
)
from vehicles.preview.received.polyline import Polyline
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

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
