"""Least squares for line and arc, and the sums that all shapes share (paper, Section III-A.1).

One equation serves all. Through a point P with unit tangent u and normal n (left), the arc of
curvature κ is the set of points q with

    E(q) = (q − P)·n − κ/2 |q − P|² = 0,

the paper's e(x, y) divided by −2R: exact for every circle, a line for κ = 0, and linear in offset,
slope and κ once P is given. On the curve its gradient has length one, so E is the distance to first
order, and the fit is not biased towards small circles as a fit of e(x, y) is. Coordinates are
centred at the samples and rotated along them, because the paper's equations are ill-conditioned far
from the origin.

A changing curvature adds one more term (`fit_clothoid`); a join divides the samples in two
(`fit_joined`).

E is a linear combination of (x² + y², x, y, 1) for every κ, P and u. The fits therefore need little
more than sums of the products of these four, over all samples (`FitData.total`) and over the first
k (`cumulative_sums`). All arithmetic is elementwise, so no result depends on a linear-algebra
library.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan, cos, inf, sin, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SQUARE: Final = 0
X: Final = 1
Y: Final = 2
ONE: Final = 3  # Row indices of x² + y², x, y and 1 in `FitData`
PAIRS = np.triu_indices(4)  # Pairs of rows of `FitData` with distinct products
DETERMINED: Final = 1e-9  # Below this relative spread the samples do not determine an unknown


@dataclass(slots=True)
class LocalCurve:
    """A curve of one or two pieces (arc spline of Section III-A) in the local frame.

    It passes through P = (x, y) (m), where two pieces join, with tangent `angle` (rad). At P its
    curvature (1/m) changes from `before` to `after`; everywhere it grows by `rate` (1/m²).
    """

    x: float
    y: float
    angle: float
    before: float
    after: float
    rate: float


@dataclass(slots=True)
class FitData:
    """Samples of both sources (Section III-A) in the local frame, in order of travel.

    `rows` are x² + y², x, y and 1 with x along the travel and y to the left (m); `weighted` are the
    rows times `weight` (None if each sample weighs one); `station` is in m. `total[i][j]` is the
    sum of weighted row i times row j.
    """

    rows: Floats
    weighted: Floats
    station: Floats
    weight: Floats | None
    total: list[list[float]]


@dataclass(slots=True)
class LineRegression:
    """Linear regression about the weighted mean: weight, means (m), xx (m²), slope, misfit (m²).

    For the column x² + y², by which an arc (Section III-A) departs from the line: its sums with 1
    and with x about its mean (`square_one`, `square_x`), with itself (`square`), and the part of
    that not explained by 1 and x (`spread`).
    """

    weight: float
    mean_x: float
    mean_y: float
    xx: float
    slope: float
    misfit: float
    square_one: float
    square_x: float
    square: float
    spread: float


class Graph:
    """Curve y = offset + slope x + half (x² + y²) + rate t, and its misfit in y (m²).

    Circle of Section III-A.1 in the local frame; t from `fit_clothoid` makes its curvature change.
    `square` is the squared gradient of its equation, `distance` the misfit in distances from the
    curve instead of in y (m²; J of eq. (5)), infinite if the graph is no curve.
    """

    __slots__ = ("distance", "half", "misfit", "offset", "rate", "slope", "square")

    def __init__(
        self, offset: float, slope: float, half: float, rate: float, misfit: float
    ) -> None:
        self.offset, self.slope, self.half, self.rate = offset, slope, half, rate
        self.misfit = misfit
        square = self.square = 1.0 + slope * slope - 4.0 * half * offset
        self.distance = misfit / square if square > 0.0 else inf


def sum_products(
    away: Floats, ux: float, uy: float, station: Floats, weight: Floats | None
) -> FitData:
    """Sum the products of (x² + y², x, y, 1) over the samples, into which eq. (5) expands.

    `away` (m, shape (2, n)) are east and north relative to the local origin, (ux, uy) is the unit
    vector of the x axis.
    """
    rows = np.empty((4, len(station)))
    by_x, by_y = away * ux, away * uy
    np.add(by_x[0], by_y[1], rows[X])
    np.subtract(by_x[1], by_y[0], rows[Y])
    squares = np.square(rows[X : Y + 1], by_x)
    np.add(squares[0], squares[1], rows[SQUARE])
    rows[ONE] = 1.0
    weighted = rows if weight is None else rows * weight
    total = np.einsum("ik,jk->ij", weighted, rows).tolist()
    return FitData(rows, weighted, station, weight, total)


def cumulative_sums(data: FitData) -> Floats:
    """Sums as in `total` over the first k + 1 samples, for every k, shape (10, n).

    J of eq. (5) expands into these for the samples before a join. `PAIRS` lists the two factors of
    each row.
    """
    left, right = PAIRS
    return np.add.accumulate(data.weighted.take(left, 0) * data.rows.take(right, 0), 1)


def offsets(curve: LocalCurve, data: FitData) -> Floats:
    """Distance of each sample from the curve (m, left positive), to first order.

    The e of Section III-A.1 divided by −2R, left turns having a positive R.
    """
    x, y, rate = curve.x, curve.y, curve.rate
    ux, uy = cos(curve.angle), sin(curve.angle)
    half, half_before = 0.5 * curve.after, 0.5 * curve.before
    # Factors of x² + y², x, y and 1 in the distance to the left of P and in the squared distance.
    left_of_p, square = uy * x - ux * y, x * x + y * y
    if half == half_before and rate == 0.0:
        rows = data.rows  # term by term is faster than einsum
        straight: Floats = rows[SQUARE] * -half
        straight += rows[X] * (2.0 * half * x - uy)
        straight += rows[Y] * (2.0 * half * y + ux)
        straight += left_of_p - half * square
        return straight
    left = (0.0, -uy, ux, left_of_p)
    ahead = (0.0, ux, uy, -ux * x - uy * y)
    seen = np.einsum("ai,ik->ak", (ahead, left, (1.0, -2.0 * x, -2.0 * y, square)), data.rows)
    xi, rho = seen[0], seen[2]  # tuple unpacking takes three times as long
    distances: Floats = seen[1]
    distances -= half * rho
    if half != half_before:
        distances += (half - half_before) * rho * (xi <= 0.0)
    if rate != 0.0:
        bent = cubic(xi, np.abs(rho, rho), 0.5 * (half + half_before))
        bent *= rate
        distances -= bent
    return distances


def cubic(along: Floats, square: Floats, half: float) -> Floats:
    """Distance t (m³) of a clothoid of rate 1 from its circle of curvature 2 `half` (1/m).

    `along` (m) is the distance along the tangent at P, `square` (m²) the squared distance from P.
    At arc length s it is (κs − sin κs)/κ³, about s³/6, as a series in (κρ/2)² where ρ is the chord
    (elementary algebra; the paper has arcs only).
    """
    bend = half * half
    series: Floats = square * (bend * bend * 9.0 / 336.0)
    series += 0.05 * bend
    series *= square
    series += 1.0 / 6.0
    series *= square
    series *= np.sqrt(square)
    departure: Floats = np.copysign(series, along, series)
    return departure


def line_regression(data: FitData) -> LineRegression | None:
    """Linear regression of y on x; None if the samples do not determine a line."""
    (square, square_x, _, square_one), (_, all_xx, all_xy, all_x), of_y, of_one = data.total
    weight = of_one[ONE]
    mean_x, mean_y = all_x / weight, of_y[ONE] / weight
    xx = all_xx - weight * mean_x * mean_x
    if not xx > DETERMINED * all_xx:
        return None
    xy = all_xy - weight * mean_x * mean_y
    yy = of_y[Y] - weight * mean_y * mean_y
    slope = xy / xx
    square_x -= mean_x * square_one
    spread = square - square_one * square_one / weight - square_x * square_x / xx
    return LineRegression(
        weight,
        mean_x,
        mean_y,
        xx,
        slope,
        max(yy - slope * xy, 0.0),
        square_one,
        square_x,
        square,
        spread,
    )


def best_line(line: LineRegression) -> Graph:
    """The line of least squares (linear regression; Section III-A joins two samples)."""
    return Graph(line.mean_y - line.slope * line.mean_x, line.slope, 0.0, 0.0, line.misfit)


def best_arc(data: FitData, line: LineRegression) -> Graph | None:
    """Fit the arc of least squares; None unless three distinct samples determine it.

    Minimises J of eq. (5) with e divided by −2R and multiplied by the gradient of the graph: three
    linear equations as in Section III-A.1.
    """
    spread, square_one, square_x = line.spread, line.square_one, line.square_x
    if not spread > DETERMINED * line.square:
        return None
    cross = data.total[SQUARE][Y] - line.mean_y * square_one - line.slope * square_x
    half = cross / spread
    slope = line.slope - half * square_x / line.xx
    offset = line.mean_y - slope * line.mean_x - half * square_one / line.weight
    arc = Graph(offset, slope, half, 0.0, max(line.misfit - half * cross, 0.0))
    return arc if arc.square > 0.0 else None


def max_abs(values: Floats) -> float:
    sizes = np.abs(values)
    size: float = sizes.item(sizes.argmax())
    return size


def drift(graph: Graph, column: Floats | None, data: FitData) -> float:
    """CUSUM statistic: largest cumulative sum of the (weighted) distances from a graph (m).

    Distances due to noise cancel sooner than those due to another shape. `column` is the term t of
    a clothoid, None for a line or arc.
    """
    rows = data.rows
    away: Floats = rows[SQUARE] * -graph.half
    away -= rows[X] * graph.slope
    away += rows[Y]
    away -= graph.offset
    if column is not None:
        away -= column * graph.rate
    if data.weight is not None:
        away *= data.weight
    return max_abs(np.add.accumulate(away))


def average_graphs(graphs: Sequence[Graph], weights: Sequence[float], total: float) -> LocalCurve:
    """Average graphs by weights that add up to `total` (beyond the paper, which uses one curve).

    Returns a curve whose P is the foot of the local origin (elementary algebra).
    """
    offset = slope = half = rate = 0.0
    for graph, weight in zip(graphs, weights, strict=False):
        if weight > 0.0:
            offset += weight * graph.offset
            slope += weight * graph.slope
            half += weight * graph.half
            rate += weight * graph.rate
    offset, slope, half, rate = offset / total, slope / total, half / total, rate / total
    gradient = sqrt(1.0 + slope * slope - 4.0 * half * offset)
    kappa, algebraic = 2.0 * half / gradient, -offset / gradient
    away = 2.0 * algebraic / (1.0 + sqrt(max(1.0 - 2.0 * kappa * algebraic, 0.0)))
    angle = atan(slope)
    return LocalCurve(away * sin(angle), -away * cos(angle), angle, kappa, kappa, rate / gradient)
