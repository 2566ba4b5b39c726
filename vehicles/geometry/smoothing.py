"""Paths from recorded points.

Recorded points are noisy, unevenly spaced, and repeated where the car stood. They are merged to at
most one per MERGE_DISTANCE, or per three standard deviations of their noise, and their holes are
filled (see `bridges`). x(t) and y(t), t being the chord length, are smoothed by local cubics every
0.25 m. Station, yaw and curvature are those of circular arcs through the smoothed points, not the
cubics' derivatives. So they are consistent with the positions, and a vehicle that steers by yaw and
curvature stays on the points.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from vehicles.geometry.bridges import (
    UnbridgedError,
    distances_along,
    fill_holes,
    noise_deviation,
    step_lengths,
)
from vehicles.geometry.driven_path import PathWalk
from vehicles.geometry.sampled_path import SAMPLING, FloatArray, SampledPath

# ---- Local cubic regression (Cleveland, 1979), in O(points in reach) per location
#
# At each location a cubic is fitted to the points within reach, and its value there is the result.
# Points are weighted by (1 - u²)³, u being their distance in units of the reach. The bias is small
# for slowly changing curvature: a circle of radius R moves by 0.0009 reach⁴ / R³ towards its
# centre. At equal bias this kernel passes 12 % less noise to the second derivative than the usual
# (1 - |u|³)³, and 44 % less to the third.


NEIGHBOURS = 7  # Minimum number of points per local cubic (4 unknowns)
SLOPE = 0.5  # Rate (m/m) at which the reach widens towards sparse points

_PLACES_AT_ONCE = 256  # locations smoothed at once, to limit memory


def local_cubic(t: FloatArray, values: FloatArray, at: FloatArray, reach: float) -> FloatArray:
    """Smooth `values` (k, n) given at `t` (n,); return shape (k, m), at locations `at` (m,).

    Local regression (Cleveland, 1979). `t` increases strictly, n >= NEIGHBOURS; `at` is nearly
    evenly spaced. Near an end of `t` the kernel extends further to the other side; where points are
    sparse it extends to NEIGHBOURS of them. It widens gradually, since a step would cause a corner.
    """
    reaches = _reaches(t, at, reach)
    chunks = [slice(k, k + _PLACES_AT_ONCE) for k in range(0, at.size, _PLACES_AT_ONCE)]
    return np.concatenate([_fit(t, values, at[c], reaches[c]) for c in chunks], axis=1)


def _reaches(t: FloatArray, at: FloatArray, reach: float) -> FloatArray:
    """Reach of the kernel at each location."""
    short = np.maximum(0.0, reach - (at - t[0])) + np.maximum(0.0, reach - (t[-1] - at))
    right, step = np.searchsorted(t, at), float(at[1] - at[0])
    # With points on both sides if there are any, so that the cubic does not extrapolate.
    first = np.clip(right - np.array([[3], [4]]), 0, t.size - NEIGHBOURS)
    sparse = np.min(np.maximum(at - t[first], t[first + NEIGHBOURS - 1] - at), axis=0)
    slope = SLOPE * step * np.arange(at.size)
    from_left = np.maximum.accumulate(sparse + slope) - slope
    from_right = np.maximum.accumulate((sparse - slope)[::-1])[::-1] + slope
    needed = np.maximum(reach + short, np.maximum(from_left, from_right))
    # A smooth upper bound: the maximum within 2 `cells`, averaged twice.
    cells = math.ceil(0.25 * reach / step)
    highest = np.pad(needed, 2 * cells, mode="edge")
    highest = np.max(sliding_window_view(highest, 4 * cells + 1), axis=1)
    for _ in range(2):
        sums = np.cumsum(np.pad(highest, (cells + 1, cells), mode="edge"))
        highest = (sums[2 * cells + 1 :] - sums[: -2 * cells - 1]) / (2 * cells + 1)
    return np.asarray(highest)


def _fit(t: FloatArray, values: FloatArray, at: FloatArray, reaches: FloatArray) -> FloatArray:
    """Weighted least squares in polynomials orthogonal under each kernel (Forsythe, 1957).

    Their three-term recurrence needs no linear solver and stays accurate at the ends, where the
    kernel is one-sided. Row i of each array belongs to at[i], its columns to the points in reach.
    """
    first = np.searchsorted(t, at - reaches)
    last = np.searchsorted(t, at + reaches, side="right")
    index = first[:, None] + np.arange(int(np.max(last - first)))
    inside = index < last[:, None]
    index = np.minimum(index, t.size - 1)
    u = (t[index] - at[:, None]) / reaches[:, None]
    fall = 1.0 - np.minimum(u * u, 1.0)
    weight = np.where(inside, fall * fall * fall, 0.0)  # a power would depend on the processor
    reached = values[:, index]
    smoothed = np.zeros((values.shape[0], at.size))
    polynomial, previous = np.ones_like(u), np.zeros_like(u)
    here, here_before = np.ones(at.size), np.zeros(at.size)  # their values at u = 0
    norm_before = np.full(at.size, np.inf)
    for _ in range(4):
        weighted = weight * polynomial
        square = weighted * polynomial
        norm = np.sum(square, axis=1)
        smoothed += np.sum(weighted * reached, axis=2) / norm * here
        shift, ratio = np.sum(square * u, axis=1) / norm, norm / norm_before
        following = (u - shift[:, None]) * polynomial - ratio[:, None] * previous
        here, here_before = -shift * here - ratio * here_before, here
        polynomial, previous, norm_before = following, polynomial, norm
    return smoothed


# ---- Smoothing


MERGE_DISTANCE = 0.25  # Points this close (m) to the first one are merged to their mean

MERGED_NOISE = 3.0
"""Points within this many standard deviations of their noise are also merged: closer points seem
to move back and forth."""

MIN_POINTS = 8  # Minimum number of distinct points of a path
CLOSING_DISTANCE = 10.0  # A closed drive returns to within this distance (m) of its first point
SEAM_BLEND = 20.0  # Distance (m) before and after the seam that is blended
MIN_PROGRESS = 0.5  # Smoothed points that advance less per metre double back


Sections = tuple[tuple[int, int], ...]  # Indices of the first and the last point of each section


class NoPathError(ValueError):
    """Points that do not form a path.

    `point` is the index of the worst cause, `sections` are those without which there may be a path.
    """

    def __init__(self, text: str, point: int, sections: Sections) -> None:
        super().__init__(text)
        self.point = point
        self.sections = sections


class Hole(NamedTuple):
    """A hole in a recorded drive (Section V-D): index of the point before it, and length (m)."""

    point: int
    length: float


class SmoothedPath(NamedTuple):
    """A path and its deviations (m) from its source points, such as a run of Section V-D."""

    path: SampledPath
    deviation_rms: float  # At the given points
    deviation_max: float  # Also at the points that fill holes
    points_used: int  # Those of a closed drive past its start belong to the next lap
    stations: FloatArray  # Of the points used (m)
    start: float  # Station of the first point, the length of the lead-in (m)
    lap_length: float  # Of one lap of a closed path, else of the whole record (m)
    holes: tuple[Hole, ...]  # Those that were filled
    half_width: float  # Reach of the smoothing (m)
    noise: float  # Standard deviation of the points' white noise (m, per axis)


class _Record(NamedTuple):
    """Distinct points x, y (m), shape (2, n), at chord lengths t (m), which end at `end` (m)."""

    t: FloatArray
    points: FloatArray
    end: float


def smooth_path(
    east: ArrayLike,
    north: ArrayLike,
    half_width: float,
    *,
    closed: bool = False,
    laps: int = 1,
    lead_in: float = 0.0,
    noise: float = 0.0,
) -> SmoothedPath:
    """Make a path from recorded points (m) by local regression; see the module for the method.

    `half_width` (m) is the reach of the regression. If it equals the smallest radius, the path
    moves inwards by 0.1 % of that radius. A wider one removes more noise: white noise s (m) in
    points d (m) apart causes noise of s * 20 d^0.5 / half_width^2.5 in the curvature (1/m). A
    `closed` drive has `laps` laps, whose ends are blended over SEAM_BLEND. The assumed noise is at
    least `noise` (m, standard deviation per axis). `lead_in` (m) is a straight before the first
    point of lap one, smoothed with the path so that the curvature has no step. Raises ValueError if
    the points do not form a path, and NoPathError if a single point is the cause.
    """
    given = np.array((east, north), dtype=float)
    if not np.isfinite(given).all():
        raise ValueError("a path needs finite coordinates")
    noise = max(noise, noise_deviation(given))
    record, numbers, holes = _merged(given, half_width, noise)
    if closed:
        record = _closed(record, half_width)
    used = int(np.searchsorted(numbers, record.t.size))
    cells = math.ceil(record.end / SAMPLING)
    grid = record.end * np.arange(cells * (laps if closed else 1) + 1) / cells
    data = record
    if closed:  # one more lap before and after them
        t = np.concatenate([record.t + record.end * turn for turn in range(-1, laps + 1)])
        data = _Record(t, np.tile(record.points, laps + 2), record.end * laps)
    led_in = math.ceil(lead_in / SAMPLING)
    if led_in:
        data = _led_in(data, half_width, lead_in)
        grid = np.concatenate((lead_in * np.arange(-led_in, 0) / led_in, grid))
    smoothed = local_cubic(data.t, data.points, grid, half_width)
    _check_progress(smoothed, grid, record.t[numbers[:used]])
    path = _path(smoothed)
    at_points = np.interp(record.t, grid, path.station)
    stations = at_points[numbers[:used]]
    offsets = np.abs(PathWalk(path, 0.0).feet(given[:, :used], stations)[1])
    everywhere = np.abs(PathWalk(path, 0.0).feet(record.points, at_points)[1])
    return SmoothedPath(
        path=path,
        deviation_rms=math.sqrt(float(np.mean(offsets * offsets))),
        deviation_max=float(max(np.max(offsets), np.max(everywhere, initial=0.0))),
        points_used=used,
        stations=stations,
        start=float(path.station[led_in]),
        lap_length=float(path.station[led_in + cells] - path.station[led_in]),
        holes=tuple(hole for hole in holes if hole.point < used - 1),
        half_width=half_width,
        noise=noise,
    )


def _merged(
    given: FloatArray, half_width: float, noise: float
) -> tuple[_Record, NDArray[np.int64], tuple[Hole, ...]]:
    """Merge the points (2, n); return also the index of each in the record, and the holes."""
    distance = max(MERGE_DISTANCE, MERGED_NOISE * noise)
    means = given
    if distance > MERGE_DISTANCE:  # a single outlier among noisy points must not begin a group
        padded = np.pad(given, ((0, 0), (2, 2)), mode="edge")
        means = sliding_window_view(padded, 5, axis=1).mean(axis=2)
    begins = np.zeros(given.shape[1], dtype=bool)
    moved = np.flatnonzero(np.any(np.diff(given, prepend=math.nan) != 0.0, axis=0))
    at_x, at_y = math.inf, math.inf
    for k, x, y in zip(moved.tolist(), *means[:, moved].tolist(), strict=True):
        if not math.hypot(x - at_x, y - at_y) <= distance:
            at_x, at_y, begins[k] = x, y, True
    members = np.cumsum(begins) - 1
    count = np.bincount(members)
    if count.size < MIN_POINTS:
        raise ValueError(
            f"a path needs at least {MIN_POINTS} points {distance:.3g} m apart, found {count.size}"
        )
    points = np.stack([np.bincount(members, row) for row in given]) / count
    last_of = np.cumsum(count) - 1
    try:
        filled, indices, before_holes = fill_holes(points, half_width)
    except UnbridgedError as error:
        before = int(last_of[error.before])
        raise NoPathError(str(error), before, ((before, before + 1),)) from error
    steps = step_lengths(points)
    holes = tuple(Hole(int(last_of[k]), float(steps[k])) for k in before_holes)
    t = distances_along(filled)
    return _Record(t, filled, float(t[-1])), indices[members], holes


def _closed(record: _Record, half_width: float) -> _Record:
    """Cut one lap out of a drive that returns to its start.

    The lap ends where the drive crosses the line through its first point, perpendicular to its
    direction there. The lateral offset is divided between both ends.
    """
    t, points, _ = record
    _, (tx, ty) = _start(record, half_width)
    dx, dy = points - points[:, :1]
    along, across, gap = dx * tx + dy * ty, dy * tx - dx * ty, np.hypot(dx, dy)
    near = gap <= CLOSING_DISTANCE
    away = int(np.argmin(near))
    crossing = (along[:-1] < 0.0) & (along[1:] >= 0.0)
    crossing &= np.diff(along) > 0.5 * np.diff(t)  # within 60 deg of the initial direction
    shares = np.clip(-along[:-1] / np.where(crossing, np.diff(along), 1.0), 0.0, 1.0)
    crossing &= np.abs(across[:-1] + shares * np.diff(across)) <= CLOSING_DISTANCE
    crossed = np.flatnonzero(crossing[away:])
    if near.all() or not (crossed.size or near[-1]):
        raise ValueError(f"the drive does not close: it ends {gap[-1]:.1f} m from its first point")
    if not crossed.size:
        return _Record(t, points, float(t[-1] + gap[-1]))
    k = away + int(crossed[0])
    end = float(t[k] + shares[k] * (t[k + 1] - t[k]))
    four = np.arange(4) + min(max(k - 1, 0), t.size - 4)
    missed = _cubic_at(t[four].tolist(), across[four].tolist(), end)
    t, blend = t[: k + 1], min(SEAM_BLEND, 0.5 * end)
    shift = 0.5 * missed * (_ramp(1.0 - t / blend) - _ramp(1.0 - (end - t) / blend))
    return _Record(t, points[:, : k + 1] + np.stack((-ty * shift, tx * shift)), end)


def _cubic_at(t: list[float], values: list[float], at: float) -> float:
    """Value of the cubic through four `values` at `t`, in Lagrange's form."""
    return sum(
        values[i] * math.prod((at - t[j]) / (t[i] - t[j]) for j in range(4) if j != i)
        for i in range(4)
    )


def _ramp(u: FloatArray) -> FloatArray:
    """Smoothstep: 0 below 0, 1 above 1."""
    u = np.clip(u, 0.0, 1.0)
    return u * u * (3.0 - 2.0 * u)


def _led_in(record: _Record, half_width: float, length: float) -> _Record:
    """Replace the points before t = 0 by points on the tangent, about as dense as the record."""
    origin, tangent = _start(record, half_width)
    kept = record.t >= 0.0
    t, points = record.t[kept], record.points[:, kept]
    spacing = float(t[-1]) / (t.size - 1)
    before = -spacing * np.arange(math.ceil((length + half_width) / spacing), 0, -1)
    straight = origin[:, None] + before * tangent[:, None]
    return _Record(
        np.concatenate((before, t)), np.concatenate((straight, points), axis=1), record.end
    )


def _start(record: _Record, half_width: float) -> tuple[FloatArray, FloatArray]:
    """Smoothed position (m) and direction (unit vector) at t = 0."""
    places = np.array((0.0, SAMPLING, 2.0 * SAMPLING))
    here, near, far = local_cubic(record.t, record.points, places, half_width).T
    # One-sided second-order difference: there may be no points before t = 0.
    ahead = 4.0 * near - far - 3.0 * here
    return here, ahead / np.hypot(*ahead)


def _check_progress(points: FloatArray, t: FloatArray, given: FloatArray) -> None:
    """Raise NoPathError where smoothed points (2, m) at `t` (m,) stop or double back.

    `given` (n,) are the chord lengths t of the given points.
    """
    progress = step_lengths(points) / np.diff(t)
    slowest = int(np.argmin(progress))
    if progress[slowest] < MIN_PROGRESS:
        x, y = points[:, slowest].tolist()
        point = min(int(np.searchsorted(given, t[slowest])), given.size - 1)
        sections = sections_where(progress < MIN_PROGRESS, t[:-1], given)
        raise NoPathError(
            f"the points double back near east {x:.1f} m, north {y:.1f} m", point, sections
        )


def sections_where(marked: NDArray[np.bool_], at: FloatArray, given: FloatArray) -> Sections:
    """Return the sections of points at `given` (n,) around each run of `marked` places `at` (m,).

    Both increase along the path.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], marked, [False]))))
    first = np.searchsorted(given, at[edges[::2]], side="right") - 1
    last = np.searchsorted(given, at[edges[1::2] - 1])
    within = np.clip((first, last), 0, given.size - 1)
    return tuple(zip(*within.tolist(), strict=True))


def _path(points: FloatArray) -> SampledPath:
    """Join smoothed points (2, m) by arcs, which define station, yaw and curvature."""
    chords, (dx, dy) = step_lengths(points), np.diff(points).tolist()
    # The C library's arc tangent: NumPy's depends on the machine.
    course = np.unwrap(np.fromiter(map(math.atan2, dy, dx), dtype=float, count=len(dx)))
    # The course of a chord is the yaw at its middle: turns are differences of courses.
    turns = np.pad(np.diff(course), 1, mode="edge")
    halves = 0.5 * (turns[1:] + turns[:-1])
    arcs = chords * (1.0 + halves * halves / 24.0)
    station = np.concatenate((np.zeros(1), np.cumsum(arcs)))
    around = np.concatenate((arcs[:1], 0.5 * (arcs[1:] + arcs[:-1]), arcs[-1:]))
    yaw = np.concatenate(([course[0] - 0.5 * turns[0]], course + 0.5 * turns[1:]))
    return SampledPath(station, points[0], points[1], yaw, turns / around)
