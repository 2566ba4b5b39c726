"""Filling of holes in recorded points, by curves fitted to both sides.

At a hole a local polynomial extrapolates the noise of one side. So each side is fitted separately,
by an arc, or by a line if the points do not require an arc. A cubic with the resulting positions
and headings joins both sides, and points on it fill the hole.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.arc_spline import Piece, PlanePose
from vehicles.geometry.geodesy import wrap_angle

FloatArray = NDArray[np.float64]

HOLE = 5.0  # A step between two points is a hole if it is longer than this (m)..
UNUSUAL = 4.0  # ...and longer than this multiple of the median of the steps nearby
NEARBY = 10  # Number of steps on either side that count as nearby
SIDE = 7  # Minimum number of points to fit a side of a hole, if available

CERTAIN = 3.0
"""A side is an arc if its curvature is at least this many standard deviations from zero."""

MAX_TURN = math.radians(100.0)
"""Sides are not joined if one points further than this (rad) away from the other."""

_CHUNK = 16_384  # steps compared at once, to limit memory

_MIN_STEPS = 8  # Minimum number of steps that fill a hole
_NORMAL = 0.6745 * math.sqrt(20.0)
"""Median size of the third difference of white noise, in standard deviations of the noise: the
difference has 20 times its variance, and half of all normal numbers are within 0.6745."""


class UnbridgedError(ValueError):
    """A hole that cannot be bridged; `before` is the index of the point before it."""

    def __init__(self, text: str, before: int) -> None:
        super().__init__(text)
        self.before = before


@dataclass(frozen=True, slots=True)
class FilledPoints:
    """Points (2, n) with their holes filled (Hermite).

    `indices` has the new index of each original point, `holes` the original index of the point
    before each hole.
    """

    points: FloatArray
    indices: NDArray[np.int64]
    holes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _End:
    """End of one side of a hole (m), and the direction towards the hole (rad)."""

    x: float
    y: float
    yaw: float


def noise_deviation(points: FloatArray) -> float:
    """Standard deviation (m, per axis) of the white noise in `points` (2, n); 0 for too few points.

    From the median of their third difference across the direction of travel, which is insensitive
    to uneven spacing, steady curvature and outliers.
    """
    if points.shape[1] < SIDE:
        return 0.0
    moved = np.any(np.diff(points) != 0.0, axis=0)
    distinct = points[:, np.concatenate((np.ones(1, dtype=bool), moved))]
    if distinct.shape[1] < SIDE:
        return 0.0
    third, course = np.diff(distinct, n=3), distinct[:, 3:] - distinct[:, :-3]
    along = np.maximum(np.hypot(course[0], course[1]), 1e-9)
    across = (third[1] * course[0] - third[0] * course[1]) / along
    return float(np.median(np.abs(across))) / _NORMAL


def step_lengths(points: FloatArray) -> FloatArray:
    """Distance (m) from each of `points` (2, n) to the next."""
    steps = np.diff(points)
    return np.asarray(np.hypot(steps[0], steps[1]))


def distances_along(points: FloatArray) -> FloatArray:
    """Distance (m) along `points` (2, n) from the first to each, shape (n,)."""
    return np.concatenate((np.zeros(1), np.cumsum(step_lengths(points))))


def find_holes(steps: FloatArray) -> NDArray[np.int64]:
    """Indices of the `steps` (m) from point to point that are holes."""
    long = np.flatnonzero(steps > HOLE)
    return np.asarray(long[steps[long] > UNUSUAL * _usual_steps(steps, long)], dtype=np.int64)


def _usual_steps(steps: FloatArray, places: NDArray[np.int64]) -> FloatArray:
    """Median of the `steps` (m) near each of `places`."""
    usual = np.zeros(places.size)
    inner = (places >= NEARBY) & (places < steps.size - NEARBY)
    for k in np.flatnonzero(~inner).tolist():
        place = int(places[k])
        usual[k] = np.median(steps[max(0, place - NEARBY) : place + NEARBY + 1])
    whole = np.flatnonzero(inner)
    for chunk in np.array_split(whole, whole.size // _CHUNK + 1):
        around = steps[places[chunk][:, None] + np.arange(-NEARBY, NEARBY + 1)]
        usual[chunk] = np.partition(around, NEARBY, axis=1)[:, NEARBY]
    return usual


def fill_holes(points: FloatArray, reach: float) -> FilledPoints:
    """Fill the holes in `points` (2, n) with points on cubics (Hermite).

    Each side of a hole is fitted over 2 `reach` (m). Raises UnbridgedError.
    """
    steps = step_lengths(points)
    holes = find_holes(steps).tolist()
    added = np.zeros(points.shape[1], dtype=np.int64)
    parts, begin = [], 0
    for number, hole in enumerate(holes, 1):
        end = holes[number] + 1 if number < len(holes) else points.shape[1]
        before, after = points[:, begin : hole + 1], points[:, hole + 1 : end]
        near = np.delete(steps[max(0, hole - NEARBY) : hole + NEARBY + 1], min(hole, NEARBY))
        spacing = min(float(np.median(near)), steps[hole] / _MIN_STEPS) if near.size else math.inf
        course = _course(points, max(begin - 1, 0), hole + 1)
        beyond = _course(points, min(end, points.shape[1] - 1), hole)
        try:
            bridge = _bridge(
                _end(before, 2.0 * reach, course),
                _end(after[:, ::-1], 2.0 * reach, beyond),
                float(spacing),
            )
        except ValueError as error:
            raise UnbridgedError(f"a hole of {steps[hole]:.1f} m {error}", hole) from error
        parts += [before, bridge]
        added[hole + 1] = bridge.shape[1]
        begin = hole + 1
    indices = np.arange(points.shape[1]) + np.cumsum(added)
    return FilledPoints(np.concatenate([*parts, points[:, begin:]], axis=1), indices, tuple(holes))


def curve_between(before: PlanePose, after: PlanePose, spacing: float) -> FloatArray:
    """Points (2, n) on a cubic (Hermite) between two poses, without both ends.

    About `spacing` (m) apart, at least seven. Raises UnbridgedError if the poses point away from
    each other.
    """
    away = _End(after[0], after[1], after[2] + math.pi)
    try:
        return _bridge(_End(*before), away, spacing)
    except ValueError as error:
        raise UnbridgedError(str(error), 0) from error


def _bridge(before: _End, after: _End, spacing: float) -> FloatArray:
    """Points about `spacing` (m) apart from one side to the other, without both ends.

    The lengths of the cubic's tangents approximate an arc, if both sides are on one.
    """
    dx, dy = after.x - before.x, after.y - before.y
    chord, course = math.hypot(dx, dy), math.atan2(dy, dx)
    arriving = after.yaw + math.pi
    turned = abs(wrap_angle(before.yaw - course)), abs(wrap_angle(arriving - course))
    if max(turned) > MAX_TURN:
        raise ValueError(f"whose sides point {math.degrees(max(turned)):.0f}° away from each other")
    handle = chord / math.cos(0.25 * sum(turned)) ** 2
    count = max(_MIN_STEPS, math.ceil(chord / spacing) if spacing > 0.0 else _MIN_STEPS)
    u = np.arange(1, count) / count
    rest, towards = 1.0 - u, u * u * (3.0 - 2.0 * u)
    leaving, joining = handle * u * rest * rest, -handle * u * u * rest
    return np.stack(
        (
            before.x + towards * dx + leaving * math.cos(before.yaw) + joining * math.cos(arriving),
            before.y + towards * dy + leaving * math.sin(before.yaw) + joining * math.sin(arriving),
        )
    )


def _course(points: FloatArray, start: int, end: int) -> float:
    dx, dy = (points[:, end] - points[:, start]).tolist()
    return math.atan2(dy, dx)


def _end(points: FloatArray, reach: float, direction: float) -> _End:
    """Projection of the last of `points` (2, n) on the arc or line fitted to those within `reach`.

    A single point between two holes has no direction of its own and takes `direction` (rad), the
    direction between the points beyond both holes. Raises ValueError if nothing fits the points.
    """
    away = np.hypot(points[0] - points[0, -1], points[1] - points[1, -1])
    outside = np.flatnonzero(away > reach)
    first = min(int(outside[-1]) + 1 if outside.size else 0, points.shape[1] - SIDE)
    side = points[:, max(first, 0) :]
    x, y = float(side[0, -1]), float(side[1, -1])
    if side.shape[1] == 1:
        return _End(x, y, direction)
    arc = _arc(side)
    foot = arc.at(arc.project(x, y).station)
    if not math.hypot(foot.east - x, foot.north - y) <= reach:  # the fit diverged
        raise ValueError("next to which the points lie in no order")
    return _End(foot.east, foot.north, foot.yaw)


def _arc(side: FloatArray) -> Piece:
    """Fit an arc to points (2, n) by Gauss–Newton, or a line if they do not require an arc."""
    (x0, y0), (x1, y1) = side[:, 0].tolist(), side[:, -1].tolist()
    line = Piece(x0, y0, math.atan2(y1 - y0, x1 - x0), 0.0, 1.0)
    line, _, _ = _refined(line, side, bends=False)
    if side.shape[1] < SIDE:
        return line
    start = Piece(x0, y0, line.yaw, 0.0, 1.0)
    middle = line.project(*side[:, side.shape[1] // 2].tolist())
    length = math.hypot(x1 - x0, y1 - y0)
    if length > 0.0:  # the sagitta of an arc through both ends
        start.curvature = -8.0 * middle.lateral / (length * length)
        start.yaw -= 0.5 * start.curvature * length
    arc, rms, weight = _refined(start, side, bends=True)
    return arc if abs(arc.curvature) * weight > CERTAIN * rms else line


def _refined(piece: Piece, side: FloatArray, *, bends: bool) -> tuple[Piece, float, float]:
    """Fit `piece` to points (2, n); also return the rms residual (m) and curvature weight (m²)."""
    columns: list[FloatArray] = []
    rms, weight = 0.0, 1.0
    for _ in range(6):
        feet = [piece.project(x, y) for x, y in side.T.tolist()]
        left = np.array([foot.lateral for foot in feet])
        along = np.array([foot.station for foot in feet])
        columns = [np.ones(along.size), along, 0.5 * along * along][: 3 if bends else 2]
        (*solved, weight), rest = _least_squares(columns, left)
        rms = math.sqrt(float(np.sum(rest * rest)) / max(left.size - len(columns), 1))
        offset, turn, bend = (*solved, 0.0)[:3]
        piece = Piece(
            piece.east - offset * math.sin(piece.yaw),
            piece.north + offset * math.cos(piece.yaw),
            piece.yaw + turn,
            piece.curvature + bend,
            piece.length,
        )
    return piece, rms, weight


def _least_squares(
    columns: list[FloatArray], values: FloatArray
) -> tuple[tuple[float, ...], FloatArray]:
    """Least-squares factors of `columns`, the last column's weight, and the residuals.

    By Gram–Schmidt orthogonalisation, which needs no linear solver.
    """
    orthogonal: list[FloatArray] = []
    mixed: list[list[float]] = []
    rest, shares = values, []
    norm = 0.0
    for column in columns:
        left, mix = column, []
        for other in orthogonal:
            factor = float(np.sum(left * other)) / float(np.sum(other * other))
            mix.append(factor)
            left = left - factor * other
        norm = float(np.sum(left * left))
        share = float(np.sum(rest * left)) / norm if norm > 0.0 else 0.0
        rest = rest - share * left
        orthogonal.append(left if norm > 0.0 else np.ones_like(left))
        mixed.append(mix)
        shares.append(share)
    for k in range(len(shares) - 1, 0, -1):
        for j in range(k):
            shares[j] -= shares[k] * mixed[k][j]
    return (*shares, math.sqrt(norm)), rest
