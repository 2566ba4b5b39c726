"""Least squares for line and arc, and the sums that all shapes share (paper, Section III-A.1).

One equation serves all. Through a point P with unit tangent u and normal n (left), the arc of
curvature κ is the set of points q with

    E(q) = (q − P)·n − κ/2 |q − P|² = 0,

the paper's e(x, y) divided by −2R: exact for every circle, a line for κ = 0, and linear in offset,
slope and κ once P is given. On the curve its gradient has length one, so E is the distance to first
order, and the fit is not biased to small circles as one with e(x, y) itself is. Coordinates are
centred at the samples and turned along them (far from the origin the paper's equations are ill-
conditioned).

A curvature that changes adds one more term (`fit_clothoid`), a join divides the samples in two
(`fit_joined`).

E is a combination of (x² + y², x, y, 1) for every κ, P and u. So the fits need little more than the
sums of the products of these four, over all samples (`FitData.total`) and over the first k
(`cumulated`). All is elementwise arithmetic, so no result depends on a linear-algebra library.
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
ONE: Final = 3
"""Places of x² + y², x, y and 1 in `FitData`."""
PAIRS = np.triu_indices(4)
"""Rows of `FitData` with different products: each one with itself and those after it."""
DETERMINED: Final = 1e-9
"""Relative spread below which the samples do not determine an unknown."""


@dataclass(slots=True)
class LocalCurve:
    """A curve of one or two pieces (arc spline of Section III-A) in the local frame.

    It passes P = (x, y) (m), where two pieces join, with tangent `angle` (rad). There its curvature
    (1/m) changes from `before` to `after`, and all along it grows by `rate` (1/m²).
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

    `rows` are x² + y², x, y and 1 with x along the travel, y left (m), `weighted` the same times
    the `weight`, which is None if all weigh one; station (m). `total[i][j]` is the sum of weighted
    row i times row j.
    """

    rows: Floats
    weighted: Floats
    station: Floats
    weight: Floats | None
    total: list[list[float]]


@dataclass(slots=True)
class LineRegression:
    """Linear regression about the weighted mean: weight, means (m), xx (m²), slope, misfit (m²).

    Of x² + y², by which an arc (Section III-A) leaves the line: the sums with 1 and with x about
    its mean (`square_one`, `square_x`), the sum with itself, and its remainder without 1 and x.
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

    Circle of Section III-A.1 in the local frame. With t from `fit_clothoid` its curvature changes;
    graphs may be averaged. `square` is that of the gradient of its equation, `distance` its misfit
    in distances from it instead of in y (m²; J of eq. (5)), infinite for a graph that is no curve.
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
    """Sum the products of (x² + y², x, y, 1) along the samples, into which eq. (5) expands.

    `away` (m, shape (2, n)) are the samples relative to the local origin, east and north, and (ux,
    uy) the unit vector of x there.
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

    Into these J of eq. (5) expands for the samples before a join. `PAIRS` lists the two factors of
    each row.
    """
    one, other = PAIRS
    return np.add.accumulate(data.weighted.take(one, 0) * data.rows.take(other, 0), 1)


def offsets(curve: LocalCurve, data: FitData) -> Floats:
    """Distance of each sample from the curve (m, left positive), to first order.

    The e of Section III-A.1 divided by −2R, left turns having a positive R.
    """
    x, y, rate = curve.x, curve.y, curve.rate
    ux, uy = cos(curve.angle), sin(curve.angle)
    half, other = 0.5 * curve.after, 0.5 * curve.before
    # Factors of x² + y², x, y and 1 in the distance to the left of P, and in its square from P.
    aside, square = uy * x - ux * y, x * x + y * y
    if half == other and rate == 0.0:
        rows = data.rows  # one after the other they take less time than an einsum
        straight: Floats = rows[SQUARE] * -half
        straight += rows[X] * (2.0 * half * x - uy)
        straight += rows[Y] * (2.0 * half * y + ux)
        straight += aside - half * square
        return straight
    left = (0.0, -uy, ux, aside)
    ahead = (0.0, ux, uy, -ux * x - uy * y)
    seen = np.einsum("ai,ik->ak", (ahead, left, (1.0, -2.0 * x, -2.0 * y, square)), data.rows)
    xi, rho = seen[0], seen[2]  # unpacked at once it takes three times as long
    distances: Floats = seen[1]
    distances -= half * rho
    if half != other:
        distances += (half - other) * rho * (xi <= 0.0)
    if rate != 0.0:
        bent = cubic(xi, np.abs(rho, rho), 0.5 * (half + other))
        bent *= rate
        distances -= bent
    return distances


def cubic(along: Floats, square: Floats, half: float) -> Floats:
    """Distance of a clothoid of rate 1 from its circle, of curvature 2 `half` (1/m): t, in m³.

    `along` (m) is the distance along the tangent at P, `square` (m²) the squared distance from P.
    On the circle at arc length s that is (κs − sin κs)/κ³, about s³/6, as a series in (κρ/2)² where
    ρ is the chord (elementary algebra; the paper has arcs only).
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
    """Line through the samples by linear regression of y on x; None if they determine none."""
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

    Minimises J of eq. (5) with e divided by −2R, times the gradient of the graph: three linear
    equations, as in Section III-A.1.
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
    """Largest absolute value."""
    sizes = np.abs(values)
    size: float = sizes.item(sizes.argmax())
    return size


def drift(graph: Graph, column: Floats | None, data: FitData) -> float:
    """Largest cumulative sum of the distances from a graph along the samples (m, weighted).

    The distances of noise cancel sooner than those of a curve of another shape (CUSUM statistic).
    `column` is that of the rate, if there is one.
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
    """Mean of graphs by weights, which add up to `total` (beyond the paper, which takes one).

    As a curve from the foot of the local origin (elementary algebra).
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
