"""Least squares for line and arc, and what all shapes share (paper, Section III-A.1).

One equation serves all. Through a point P with unit tangent u and normal n (left), the arc of
curvature κ is the set of points q with

    E(q) = (q − P)·n − κ/2 |q − P|² = 0,

the paper's e(x, y) divided by −2R: exact for every circle, a line for κ = 0, and linear in offset,
slope and κ once P is given. On the curve its gradient has length one, so E is the distance to first
order, and the fit is not biased to small circles as one with e(x, y) itself is. Coordinates are
centred at the samples and turned along them (far from the origin the paper's equations are
ill-conditioned).

A curvature that changes adds one more term (`fit_clothoid`), a join divides the samples in two
(`fit_joined`).

E is a combination of (x² + y², x, y, 1) for every κ, P and u. The sums of the products of these
four, over all samples (`FitData.total`) and over the first k (`cumulated`), are therefore nearly
all that is needed of the samples. All is elementwise arithmetic, so that no result depends on a
linear-algebra library.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import atan, cos, inf, sin, sqrt

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SQUARE, X, Y, ONE = range(4)
"""Places of x² + y², x, y and 1 in `FitData`."""
PAIRS = np.triu_indices(4)
"""Rows of `FitData` whose products are different: every one with itself and those after it."""
Factors = tuple[float, float, float, float]
DETERMINED = 1e-9
"""Relative spread below which the samples do not determine an unknown."""


@dataclass(slots=True)
class LocalCurve:
    """A curve of one or two pieces (arc spline of Section III-A) in the local frame.

    It passes P = (x, y) (m), where two pieces join, with tangent `angle` (rad). There its curvature
    (1/m) changes from `before` to `after`, and all along it grows by `rate` (1/m²). `misfit` is its
    weighted sum of squared residuals (m²), `freedom` its number of unknowns: 2 line, 3 arc, 4
    clothoid, line→arc or arc→line, 5 two arcs.
    """

    x: float
    y: float
    angle: float
    before: float
    after: float
    misfit: float
    freedom: int
    rate: float = 0.0


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
class Centred:
    """Linear regression about the weighted mean: weight, means (m), xx (m²), slope, misfit (m²)."""

    weight: float
    mean_x: float
    mean_y: float
    xx: float
    slope: float
    misfit: float


@dataclass(slots=True)
class Graph:
    """Curve y = offset + slope x + half (x² + y²) + rate t, its misfit in y (m²) and freedom.

    Circle of Section III-A.1 in the local frame. With t from `fit_clothoid` its curvature changes;
    graphs may be averaged. `square` is that of the gradient of its equation, `distance` its misfit
    in distances from it instead of in y (m²; J of eq. (5)).
    """

    offset: float
    slope: float
    half: float
    rate: float
    misfit: float
    freedom: int
    square: float = field(init=False)
    distance: float = field(init=False)

    def __post_init__(self) -> None:
        """Work out what is asked for several times; a graph that is no curve is at no distance."""
        self.square = 1.0 + self.slope * self.slope - 4.0 * self.half * self.offset
        self.distance = self.misfit / self.square if self.square > 0.0 else inf


def summed(away: Floats, ux: float, uy: float, station: Floats, weight: Floats | None) -> FitData:
    """Add up the products of (x² + y², x, y, 1) along the samples: what eq. (5) expands to.

    `away` (m, shape (2, n)) is where they are from the local origin, east and north, and (ux, uy)
    the direction of x there, of length one.
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


def cumulated(data: FitData) -> Floats:
    """Sums as in `total` over the first k + 1 samples, for every k, shape (10, n).

    What J of eq. (5) expands to for the samples before a join. `PAIRS` says which row is what: a
    product does not depend on the order of its factors.
    """
    one, other = PAIRS
    return np.add.accumulate(data.weighted.take(one, 0) * data.rows.take(other, 0), 1)


def seen_from(x: float, y: float, angle: float) -> tuple[Factors, Factors, Factors]:
    """Factors of x² + y², x, y and 1 in the distances ahead and to the left of a place, and ρ².

    In the frame of P of Section III-A.1, with ρ the distance from P; elementary algebra.
    """
    ux, uy = cos(angle), sin(angle)
    return (
        (0.0, ux, uy, -ux * x - uy * y),
        (0.0, -uy, ux, uy * x - ux * y),
        (1.0, -2.0 * x, -2.0 * y, x * x + y * y),
    )


def offsets(curve: LocalCurve, data: FitData) -> Floats:
    """Distance of each sample from the curve (m, left positive), to first order.

    The e of Section III-A.1 divided by −2R, left turns having a positive R.
    """
    ahead, left, square = seen_from(curve.x, curve.y, curve.angle)
    half, other = 0.5 * curve.after, 0.5 * curve.before
    if half == other and curve.rate == 0.0:
        away = [own - half * all_round for own, all_round in zip(left, square, strict=True)]
        straight: Floats = np.einsum("i,ik->k", away, data.rows)
        return straight
    seen = np.einsum("ai,ik->ak", (ahead, left, square), data.rows)
    xi, eta, rho = seen[0], seen[1], seen[2]  # unpacked at once it takes three times as long
    found: Floats = eta - half * rho
    if half != other:
        found += (half - other) * rho * (xi <= 0.0)
    if curve.rate != 0.0:
        found -= curve.rate * cubic(xi, np.abs(rho, out=rho), 0.5 * (half + other))
    return found


def cubic(along: Floats, square: Floats, half: float) -> Floats:
    """How far a clothoid of rate 1 leaves its circle, of curvature 2 `half` (1/m): t, in m³.

    `along` (m) is the distance along the tangent at P, `square` (m²) the squared distance from P.
    On the circle at arc length s that is (κs − sin κs)/κ³, about s³/6, as a series in (κρ/2)²
    where ρ is the chord (elementary algebra; the paper has arcs only).
    """
    bend = half * half
    series: Floats = square * (bend * bend * 9.0 / 336.0)
    series += 0.05 * bend
    series *= square
    series += 1.0 / 6.0
    series *= square
    series *= np.sqrt(square)
    return np.copysign(series, along, series)


def centred(data: FitData) -> Centred | None:
    """Line through the samples by linear regression of y on x; None if they determine none."""
    total = data.total
    weight = total[ONE][ONE]
    mean_x, mean_y = total[X][ONE] / weight, total[Y][ONE] / weight
    xx = total[X][X] - weight * mean_x * mean_x
    if not xx > DETERMINED * total[X][X]:
        return None
    xy = total[X][Y] - weight * mean_x * mean_y
    yy = total[Y][Y] - weight * mean_y * mean_y
    slope = xy / xx
    return Centred(weight, mean_x, mean_y, xx, slope, max(yy - slope * xy, 0.0))


def best_line(line: Centred) -> Graph:
    """Give the line of least squares (linear regression; Section III-A joins two samples)."""
    return Graph(line.mean_y - line.slope * line.mean_x, line.slope, 0.0, 0.0, line.misfit, 2)


def best_arc(data: FitData, line: Centred) -> Graph | None:
    """Fit the arc of least squares; None unless three distinct samples determine it.

    Minimises J of eq. (5) with e divided by −2R, times the gradient of the graph: three linear
    equations, as Section III-A.1 says.
    """
    row = data.total[SQUARE]
    cross_x = row[X] - line.mean_x * row[ONE]
    cross = row[Y] - line.mean_y * row[ONE] - line.slope * cross_x
    spread = row[SQUARE] - row[ONE] * row[ONE] / line.weight - cross_x * cross_x / line.xx
    if not spread > DETERMINED * row[SQUARE]:
        return None
    half = cross / spread
    slope = line.slope - half * cross_x / line.xx
    offset = line.mean_y - slope * line.mean_x - half * row[ONE] / line.weight
    found = Graph(offset, slope, half, 0.0, max(line.misfit - half * cross, 0.0), 3)
    return found if found.square > 0.0 else None


def largest(values: Floats) -> float:
    """Largest of the sizes of some values, as of the distances in eq. (5)."""
    sizes = np.abs(values)
    found: float = sizes.item(sizes.argmax())
    return found


def drift(graph: Graph, column: Floats | None, data: FitData) -> float:
    """How far the distances from a graph add up (m, weighted), at most, along the samples.

    Those of noise alone cancel out sooner than those of a curve of another shape (CUSUM statistic).
    `column` is that of the rate, weighted, if there is one.
    """
    equation = (-graph.half, -graph.slope, 1.0, -graph.offset)
    away: Floats = np.einsum("i,ik->k", equation, data.weighted)
    if column is not None:
        away -= graph.rate * column
    return largest(np.add.accumulate(away))


def mean(graphs: Sequence[Graph], weights: Sequence[float]) -> Graph:
    """Mean of graphs by weights of which one is positive (beyond the paper, which takes one)."""
    offset = slope = half = rate = 0.0
    for graph, weight in zip(graphs, weights, strict=True):
        offset += weight * graph.offset
        slope += weight * graph.slope
        half += weight * graph.half
        rate += weight * graph.rate
    total = sum(weights)
    last = graphs[-1]
    return Graph(
        offset / total, slope / total, half / total, rate / total, last.misfit, last.freedom
    )


def as_curve(graph: Graph) -> LocalCurve:
    """Give the graph as a curve from the foot of the local origin (elementary algebra)."""
    square = graph.square
    gradient = sqrt(square)
    kappa, algebraic = 2.0 * graph.half / gradient, -graph.offset / gradient
    away = 2.0 * algebraic / (1.0 + sqrt(max(1.0 - 2.0 * kappa * algebraic, 0.0)))
    angle = atan(graph.slope)
    return LocalCurve(
        away * sin(angle),
        -away * cos(angle),
        angle,
        kappa,
        kappa,
        graph.misfit / square,
        graph.freedom,
        graph.rate / gradient,
    )
