"""Curves over holes in recorded points, and through sparse positions.

At a hole a local polynomial extrapolates the noise of one side. So each side is fitted separately,
by an arc, or by a line if there are few points. A cubic with the resulting positions and headings
joins both sides, and points on it fill the hole.
"""

import math
from cmath import phase, polar, rect
from collections.abc import Sequence
from math import atan, atan2, ceil, cos, hypot, remainder, sin, tau
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vehicles.geometry.arc_fits import Samples, average_graphs
from vehicles.geometry.arc_spline import PlanePose
from vehicles.geometry.sampled_path import CHORD_TOLERANCE, FloatArray, Place, PlacedPose

HOLE = 5.0  # A step between two points is a hole if it is longer than this (m)..
UNUSUAL = 4.0  # ...and longer than this multiple of the median of the steps nearby
NEARBY = 10  # Number of steps on either side that count as nearby
SIDE = 7  # Minimum number of points to fit a side of a hole, if available

MAX_TURN = math.radians(100.0)
"""Sides are not joined if one points further than this (rad) away from the other."""

_MIN_STEPS = 8  # Minimum number of steps that fill a hole
_NORMAL = 0.6745 * math.sqrt(20.0)
"""Median size of the third difference of white noise, in standard deviations of the noise: the
difference has 20 times its variance, and half of all normal numbers are within 0.6745."""


class UnbridgedError(ValueError):
    """A hole that cannot be bridged; `before` is the index of the point before it."""

    def __init__(self, text: str, before: int = 0) -> None:
        super().__init__(text)
        self.before = before


def noise_deviation(points: FloatArray) -> float:
    """Standard deviation (m, per axis) of the white noise in `points` (2, n); 0 for too few points.

    From the median of their third difference across the direction of travel, which is insensitive
    to uneven spacing, steady curvature and outliers.
    """
    moved = np.any(np.diff(points, prepend=math.nan) != 0.0, axis=0)
    distinct = points[:, moved]
    if distinct.shape[1] < SIDE:
        return 0.0
    third, course = np.diff(distinct, n=3), distinct[:, 3:] - distinct[:, :-3]
    along = np.maximum(np.hypot(course[0], course[1]), 1e-9)
    across = (third[1] * course[0] - third[0] * course[1]) / along
    return float(np.median(np.abs(across))) / _NORMAL


def step_lengths(points: FloatArray) -> FloatArray:
    """Distance (m) from each of `points` (2, n) to the next."""
    return np.asarray(np.hypot(*np.diff(points)))


def distances_along(points: FloatArray) -> FloatArray:
    """Distance (m) along `points` (2, n) from the first to each, shape (n,)."""
    return np.concatenate((np.zeros(1), np.cumsum(step_lengths(points))))


def find_holes(steps: FloatArray) -> NDArray[np.int64]:
    """Indices of the `steps` (m) from point to point that are holes."""
    long = np.flatnonzero(steps > HOLE)
    padded = np.pad(steps, (NEARBY, NEARBY + 1), constant_values=math.nan)  # none has a window
    nearby = sliding_window_view(padded, 2 * NEARBY + 1)[long]
    return np.asarray(long[steps[long] > UNUSUAL * np.nanmedian(nearby, axis=1)], dtype=np.int64)


def fill_holes(
    points: FloatArray, reach: float
) -> tuple[FloatArray, NDArray[np.int64], tuple[int, ...]]:
    """Fill the holes in `points` (2, n) with points on cubics (Hermite).

    Each side of a hole is fitted over 2 `reach` (m). Returns the points, the new index of each
    original one, and the original index of the point before each hole. Raises UnbridgedError.
    """
    steps = step_lengths(points)
    holes = find_holes(steps).tolist()
    added = np.zeros(points.shape[1], dtype=np.int64)
    parts, begin = [], 0
    for hole, end in zip(
        holes, [*[later + 1 for later in holes[1:]], points.shape[1]], strict=False
    ):
        before, after = points[:, begin : hole + 1], points[:, hole + 1 : end]
        near = np.delete(steps[max(0, hole - NEARBY) : hole + NEARBY + 1], min(hole, NEARBY))
        usual = float(np.median(near)) if near.size else math.inf
        spacing = min(usual, float(steps[hole]) / _MIN_STEPS)
        course = _course(points, hole, hole + 1)
        try:
            x, y, yaw = _end(after[:, ::-1], 2.0 * reach, course + math.pi)
            start, joined = (0, *_end(before, 2.0 * reach, course)), (0, x, y, yaw + math.pi)
            bridge = np.array(curve_between(start, joined, spacing))[:, 1:3].T
        except ValueError as error:
            raise UnbridgedError(f"a hole of {steps[hole]:.1f} m {error}", hole) from error
        parts += [before, bridge]
        added[hole + 1] = bridge.shape[1]
        begin = hole + 1
    indices = np.arange(points.shape[1]) + np.cumsum(added)
    return np.concatenate([*parts, points[:, begin:]], axis=1), indices, tuple(holes)


def curve_between(before: PlacedPose, after: PlacedPose, spacing: float) -> list[PlacedPose]:
    """Poses about `spacing` (m) apart on a cubic (Hermite) between two poses, without both ends.

    The lengths of the tangents approximate an arc, if both poses are on one; instants are evenly
    distributed. Raises UnbridgedError if the poses point away from each other.
    """
    (at, x, y, leaving), (end_at, end_x, end_y, arriving) = before, after
    start, chord = complex(x, y), complex(end_x - x, end_y - y)
    length, course = polar(chord)
    turned = abs(remainder(leaving - course, tau)), abs(remainder(arriving - course, tau))
    if max(turned) > MAX_TURN:
        degrees = math.degrees(max(turned))
        raise UnbridgedError(f"whose sides point {degrees:.0f}° away from each other")
    handle = length / cos(0.25 * sum(turned)) ** 2
    out, into = rect(handle, leaving), rect(handle, arriving)
    poses, count = list[PlacedPose](), ceil(length / spacing)
    for k in range(1, count):
        u, rest = k / count, 1.0 - k / count
        place = start + u * u * (3.0 - 2.0 * u) * chord + u * rest * (rest * out - u * into)
        ahead = 6.0 * u * rest * chord + rest * (1.0 - 3.0 * u) * out + u * (3.0 * u - 2.0) * into
        poses.append((at + (end_at - at) * k // count, place.real, place.imag, phase(ahead)))
    return poses


def _course(points: FloatArray, start: int, end: int) -> float:
    dx, dy = (points[:, end] - points[:, start]).tolist()
    return atan2(dy, dx)


def _end(points: FloatArray, reach: float, direction: float) -> PlanePose:
    """Projection of the last of `points` (2, n) on the curve fitted to those within `reach` (m).

    The curve is an arc, or a line through fewer than SIDE points. A single point takes `direction`
    (rad). Raises ValueError if nothing fits the points.
    """
    away = points - points[:, -1:]
    outside = np.flatnonzero(np.hypot(*away) > reach)
    first = min(int(outside[-1]) + 1 if outside.size else 0, points.shape[1] - SIDE)
    away = away[:, max(first, 0) :]
    x, y = points[:, -1].tolist()
    count = away.shape[1]
    if count == 1:
        return x, y, direction
    yaw = _course(away[:, -SIDE:], 0, -1)
    samples = Samples(away, cos(yaw), sin(yaw), away[0], None)
    arc = samples.arc() if count >= SIDE else None
    curve = average_graphs((arc or samples.line(),), (1.0,))
    if not hypot(curve.x, curve.y) <= reach:  # the fit diverged
        raise ValueError("next to which the points lie in no order")
    east = x + curve.x * cos(yaw) - curve.y * sin(yaw)
    return east, y + curve.x * sin(yaw) + curve.y * cos(yaw), yaw + curve.angle


# ---- A curve through sparse positions whose chords are close to the driven path


NEIGHBOUR_SHARE: Final = 0.3
"""A neighbour nearer than this share of a chord does not determine its direction: its noise would
turn a long chord."""
STEEPEST: Final = 0.5  # Largest slope of a curve against its chord


def curve_through(places: Sequence[Place], first: int, spacing: float) -> list[PlacedPose]:
    """Points about `spacing` (m) apart along a curve from `places[first]` to the last of `places`.

    The curve consists of a cubic (Hermite) per chord. Its directions at the ends are those of the
    circles through three places; they are limited so that the cubic stays within `CHORD_TOLERANCE`
    of its chord. Places before `first` are neighbours only. The point at `first` is included, the
    one at the end is not.
    """
    points: list[PlacedPose] = []
    for k in range(first, len(places) - 1):
        here, there = places[k : k + 2]
        dx, dy = there[1] - here[1], there[2] - here[2]
        chord, course = hypot(dx, dy), atan2(dy, dx)
        if chord == 0.0:
            continue
        leaving = _slope(places[k::-1], chord, course + math.pi)
        arriving = _slope(places[k + 1 :], chord, course)
        if leaving is None:
            leaving = -(arriving or 0.0)
        if arriving is None:
            arriving = -leaving
        most = min(4.0 * CHORD_TOLERANCE / chord, STEEPEST)
        start = (*here, course + atan(min(max(leaving, -most), most)))
        end = (*there, course + atan(min(max(arriving, -most), most)))
        points += [start, *curve_between(start, end, spacing)]
    return points


def _slope(places: Sequence[Place], chord: float, course: float) -> float | None:
    """Slope against a chord (m) of `course` (rad) that ends at the first of `places`.

    The others follow it. The nearest that determines a direction is used; None without any.
    """
    _, east, north = places[0]
    for _, next_east, next_north in places[1:]:
        length = hypot(next_east - east, next_north - north)
        if length >= NEIGHBOUR_SHARE * chord:
            turn = remainder(atan2(next_north - north, next_east - east) - course, tau)
            return turn * chord / (chord + length)
    return None
