"""Least squares for line, arc and clothoid (paper, Section III-A.1).

One equation serves all. Through a point P with unit tangent u and normal n (left), the arc of
curvature κ is the set of points q with

    E(q) = (q − P)·n − κ/2 |q − P|² = 0,

the paper's e(x, y) divided by −2R: exact for every circle, a line for κ = 0, and linear in offset,
slope and κ once P is given. On the curve its gradient has length one, so E is the distance to first
order, and the fit is not biased towards small circles as a fit of e(x, y) is. Coordinates are
centred at the samples and rotated along them, because the paper's equations are ill-conditioned far
from the origin. A changing curvature adds one more term.

E is a linear combination of (x² + y², x, y, 1) for every κ, P and u. The fits therefore need little
more than sums of the products of these four, over all samples (`Samples.total`) and over the first
k (`joined_fit`). All arithmetic is elementwise, so no result depends on a linear-algebra library.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import atan, cos, inf, sin, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SQUARE: Final = 0
X: Final = 1
Y: Final = 2
ONE: Final = 3  # Row indices of x² + y², x, y and 1 in `Samples`
DETERMINED: Final = 1e-9  # Below this relative spread the samples do not determine an unknown
RATE_MOST: Final = 0.06
"""Largest rate of curvature (1/m²) that is fitted: at 3 m/s a car with 2.85 m wheelbase then steers
at 0.5 rad/s.
"""
TURN_MOST: Final = 2.2
"""Largest turn (rad) from first to last sample for which a clothoid is fitted: beyond it the series
of `cubic` is too short.
"""


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
class Graph:
    """Curve y = offset + slope x + half (x² + y²) + rate t, and its misfit in y (m²).

    Circle of Section III-A.1 in the local frame; t is the `column` of a clothoid, which makes its
    curvature change. `distance` is the misfit in distances from the curve instead of in y (m²; J of
    eq. (5)), infinite if the graph `is_curve` no longer.
    """

    offset: float
    slope: float
    half: float
    misfit: float
    rate: float = 0.0
    column: Floats | None = None
    is_curve: bool = field(init=False)
    distance: float = field(init=False)

    def __post_init__(self) -> None:
        square = 1.0 + self.slope * self.slope - 4.0 * self.half * self.offset  # of the gradient
        self.is_curve = square > 0.0
        self.distance = self.misfit / square if self.is_curve else inf


class Samples:
    """Samples of all sources (Section III-A) in the local frame, in order of travel.

    `rows` are x² + y², x, y and 1 with x along the travel and y to the left (m); `weighted` are the
    rows times `weight` (None if each sample weighs one); `station` is in m. `total[i][j]` is the
    sum of weighted row i times row j, into which eq. (5) expands.

    The linear regression of y on x about the weighted mean: total weight `count`, means (m), sum of
    squares `xx` (m²), `slope` and `misfit` (m²). For the column x² + y², by which an arc departs
    from the line: its sums with 1 and with x about its mean (`square_one`, `square_x`), and the
    part of its squares not explained by 1 and x (`spread`).
    """

    def __init__(
        self, away: Floats, ux: float, uy: float, station: Floats, weight: Floats | None
    ) -> None:
        """`away` (m, shape (2, n)) are east and north relative to the local origin.

        (ux, uy) is the unit vector of the x axis.
        """
        rows = np.empty((4, len(station)))
        by_x, by_y = away * ux, away * uy
        np.add(by_x[0], by_y[1], rows[X])
        np.subtract(by_x[1], by_y[0], rows[Y])
        squares = np.square(rows[X : Y + 1], by_x)
        np.add(squares[0], squares[1], rows[SQUARE])
        rows[ONE] = 1.0
        self.rows, self.station, self.weight = rows, station, weight
        self.weighted = rows if weight is None else rows * weight
        self.total = np.einsum("ik,jk->ij", self.weighted, rows).tolist()
        (square, square_x, _, square_one), (_, all_xx, all_xy, all_x), of_y, of_one = self.total
        count = self.count = of_one[ONE]
        mean_x = self.mean_x = all_x / count
        mean_y = self.mean_y = of_y[ONE] / count
        xx = self.xx = all_xx - count * mean_x * mean_x
        self.has_direction: bool = xx > DETERMINED * all_xx
        xy = all_xy - count * mean_x * mean_y
        slope = self.slope = xy / xx if self.has_direction else 0.0
        self.misfit = max(of_y[Y] - count * mean_y * mean_y - slope * xy, 0.0)
        self.square_one = square_one
        square_x = self.square_x = square_x - mean_x * square_one
        spread = square - square_one * square_one / count
        self.spread = spread - square_x * square_x / xx if self.has_direction else 0.0

    def line(self) -> Graph:
        """The line of least squares (linear regression; Section III-A joins two samples)."""
        return Graph(self.mean_y - self.slope * self.mean_x, self.slope, 0.0, self.misfit)

    def arc(self) -> Graph | None:
        """Fit the arc of least squares; None unless three distinct samples determine it.

        Minimises J of eq. (5) with e divided by −2R and multiplied by the gradient of the graph:
        three linear equations as in Section III-A.1.
        """
        if not self.spread > DETERMINED * self.total[SQUARE][SQUARE]:
            return None
        cross = self.total[SQUARE][Y] - self.mean_y * self.square_one - self.slope * self.square_x
        half = cross / self.spread
        slope = self.slope - half * self.square_x / self.xx
        offset = self.mean_y - slope * self.mean_x - half * self.square_one / self.count
        arc = Graph(offset, slope, half, max(self.misfit - half * cross, 0.0))
        return arc if arc.is_curve else None

    def clothoid(self, arc: Graph) -> Graph | None:
        """Fit the clothoid of least squares, given the best `arc`.

        Adds one column to the linear regression of the arc (eq. (5)): the distance of the clothoid
        from the arc, to first order in its rate, measured from the local origin, which lies on the
        arc within the noise of a sample. None if the samples do not determine it, or turn too far;
        the rate is clipped to `RATE_MOST`.
        """
        if not abs(2.0 * arc.half) * (self.station.item(-1) - self.station.item(0)) < TURN_MOST:
            return None
        column = cubic(self.rows[X], self.rows[SQUARE], arc.half)
        weighted: Floats = column if self.weight is None else self.weight * column
        of_square, of_x, of_y, of_one = np.einsum("ik,k->i", self.rows, weighted).tolist()
        count, xx, square_x, spread = self.count, self.xx, self.square_x, self.spread
        # Orthogonalise the column to 1, x and x² + y², in this order.
        by_x = of_x - self.mean_x * of_one
        by_square = of_square - self.square_one * of_one / count - square_x * by_x / xx
        whole = float(np.add.reduce(weighted * column))
        left = whole - of_one * of_one / count - by_x * by_x / xx - by_square**2 / spread
        if not left > DETERMINED * whole:
            return None
        cross = of_y - arc.offset * of_one - arc.slope * of_x - arc.half * of_square
        rate = min(max(cross / left, -RATE_MOST), RATE_MOST)
        half = arc.half - rate * by_square / spread
        slope = arc.slope - (rate * by_x + (half - arc.half) * square_x) / xx
        offset = self.mean_y - slope * self.mean_x - half * self.square_one / count
        offset -= rate * of_one / count
        misfit = max(arc.misfit - rate * (2.0 * cross - rate * left), 0.0)
        graph = Graph(offset, slope, half, misfit, rate, column)
        return graph if graph.is_curve else None

    def drift(self, graph: Graph) -> float:
        """CUSUM statistic: largest cumulative sum of the (weighted) distances from a graph (m).

        Distances due to noise cancel sooner than those due to another shape.
        """
        rows = self.rows
        away: Floats = rows[SQUARE] * -graph.half
        away -= rows[X] * graph.slope
        away += rows[Y]
        away -= graph.offset
        if graph.column is not None:
            away -= graph.column * graph.rate
        if self.weight is not None:
            away *= self.weight
        return max_abs(np.add.accumulate(away))

    def offsets(self, curve: LocalCurve) -> Floats:
        """Distance of each sample from the curve (m, left positive), to first order.

        The e of Section III-A.1 divided by −2R, left turns having a positive R.
        """
        x, y, rate, rows = curve.x, curve.y, curve.rate, self.rows
        ux, uy, half = cos(curve.angle), sin(curve.angle), 0.5 * curve.after
        distances: Floats = rows[SQUARE] * -half  # term by term is faster than einsum
        distances += rows[X] * (2.0 * half * x - uy)
        distances += rows[Y] * (2.0 * half * y + ux)
        distances += uy * x - ux * y - half * (x * x + y * y)
        change = half - 0.5 * curve.before
        if change == 0.0 and rate == 0.0:
            return distances
        dx, dy = rows[X] - x, rows[Y] - y
        xi, square = ux * dx + uy * dy, dx * dx + dy * dy
        if change != 0.0:
            distances += change * square * (xi <= 0.0)
        if rate != 0.0:
            distances -= rate * cubic(xi, square, half - 0.5 * change)
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


def max_abs(values: Floats) -> float:
    sizes = np.abs(values)
    size: float = sizes.item(sizes.argmax())
    return size


def average_graphs(graphs: Sequence[Graph], weights: Sequence[float]) -> LocalCurve:
    """Average graphs by weights (beyond the paper, which uses one curve).

    Returns a curve whose P is the foot of the local origin (elementary algebra).
    """
    offset = slope = half = rate = total = 0.0
    for graph, weight in zip(graphs, weights, strict=True):
        offset += weight * graph.offset
        slope += weight * graph.slope
        half += weight * graph.half
        rate += weight * graph.rate
        total += weight
    offset, slope, half, rate = offset / total, slope / total, half / total, rate / total
    gradient = sqrt(1.0 + slope * slope - 4.0 * half * offset)
    kappa, algebraic = 2.0 * half / gradient, -offset / gradient
    away = 2.0 * algebraic / (1.0 + sqrt(max(1.0 - 2.0 * kappa * algebraic, 0.0)))
    angle = atan(slope)
    return LocalCurve(away * sin(angle), -away * cos(angle), angle, kappa, kappa, rate / gradient)
