"""Least squares for line, arc, clothoid and two joined pieces (paper, Section III-A.1).

One equation serves all. Through a point P with unit tangent u and normal n (left), the arc of
curvature κ is the set of points q with

    E(q) = (q − P)·n − κ/2 |q − P|² = 0,

the paper's e(x, y) divided by −2R: exact for every circle, a line for κ = 0, and linear in offset,
slope and κ once P is given. On the curve its gradient has length one, so E is the distance to first
order, and the fit is not biased towards small circles as a fit of e(x, y) is. Coordinates are
centred at the samples and rotated along them, because the paper's equations are ill-conditioned far
from the origin. A changing curvature adds one more term; a join divides the samples in two.

E is a linear combination of (x² + y², x, y, 1) for every κ, P and u. The fits therefore need little
more than sums of the products of these four, over all samples (`Samples.total`) and over the first
k (`JoinSearch`). All arithmetic is elementwise, so no result depends on a linear-algebra library.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from math import atan, cos, hypot, inf, sin, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SQUARE: Final = 0
X: Final = 1
Y: Final = 2
ONE: Final = 3  # Row indices of x² + y², x, y and 1 in `Samples`
PAIRS = np.triu_indices(4)  # Pairs of rows of `Samples` with distinct products
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


class Graph:
    """Curve y = offset + slope x + half (x² + y²) + rate t, and its misfit in y (m²).

    Circle of Section III-A.1 in the local frame; t is the `column` of a clothoid, which makes its
    curvature change. `distance` is the misfit in distances from the curve instead of in y (m²; J of
    eq. (5)), infinite if the graph `is_curve` no longer.
    """

    __slots__ = ("column", "distance", "half", "is_curve", "misfit", "offset", "rate", "slope")

    def __init__(  # noqa: PLR0917 - its fields
        self,
        offset: float,
        slope: float,
        half: float,
        misfit: float,
        rate: float = 0.0,
        column: Floats | None = None,
    ) -> None:
        self.offset, self.slope, self.half, self.rate = offset, slope, half, rate
        self.misfit, self.column = misfit, column
        square = 1.0 + slope * slope - 4.0 * half * offset  # squared gradient of its equation
        self.is_curve = square > 0.0
        self.distance = misfit / square if self.is_curve else inf


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


# ---- Least squares for two pieces with one tangent at the join: line→arc, arc→line, arc→arc
#
# For a given join P all three are linear in offset, slope and curvatures: the equation of the arc
# with a curvature on either side. Only the station of the join is searched for: first by hill
# climbing over some of the samples from the middle on, then by parabolas through the gains of the
# best three. All is plain arithmetic on the sums of products up to a join.


PASSES: Final = 6  # Largest number of times that the best join is refined
NEGLIGIBLE_GAIN: Final = 0.05
"""Below this predicted gain, in squared noise, a join is not moved again. A join displaced by its
standard error loses a gain of one.
"""
GAIN_MARGIN: Final = 2.0
"""Gain, in squared noise, that a join may have beyond the prediction of the parabola. A join that
has no weight even then is not refined.
"""
TINY: Final = 1e-30  # Avoids 0/0 for an undetermined curvature
AFTER: Final = 0
BEFORE: Final = 1
BOTH: Final = 2  # Side of the join that is an arc

Factors = tuple[float, float, float]  # Factors of x, y and 1 in |q − P|², next to x² + y²


class Join(NamedTuple):
    """Least squares of two pieces (Section III-A) with a join at `station` and (x, y) (m).

    `gains` (m²) are the reductions of the line's squared residuals for `AFTER`, `BEFORE` and
    `BOTH`, `halves` (1/m) half the curvatures before and after the join for each. `shares` are the
    components along normalised 1 and x of the column before the join and of the column after it.
    """

    station: float
    x: float
    y: float
    gains: tuple[float, float, float]
    halves: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    shares: tuple[float, float, float, float]


class BestJoin(NamedTuple):
    """Two pieces of Section III-A, the sum of squared residuals (m²), and 4 or 5 unknowns."""

    curve: LocalCurve
    misfit: float
    freedom: int


class JoinSearch:
    """Search for the best join, a change of curvature of Section III-A anywhere in the samples.

    Two arcs must lower the sum of squared residuals by `evidence` times the squared noise more than
    one. The noise is estimated from their residuals, within the bounds `noise` (m²).
    """

    def __init__(self, samples: Samples, noise: tuple[float, float], evidence: float) -> None:
        self._least, self._most = noise
        self._noise, self._evidence = self._most, evidence
        self._samples = samples
        self._stations: list[float] = samples.station.tolist()
        left, right = PAIRS
        products = samples.weighted.take(left, 0) * samples.rows.take(right, 0)
        self._sums = np.add.accumulate(products, 1)  # over the first k + 1 samples, shape (10, n)
        self._total = self._sums[:, -1].tolist()
        self._norms = 1.0 / sqrt(samples.count), 1.0 / sqrt(samples.xx)

    def best(
        self, indices: Sequence[int], bounds: tuple[float, float], misfit_limit: float
    ) -> BestJoin | None:
        """Best line→arc, arc→line or arc→arc, starting from joins at the samples `indices`.

        In up to `PASSES` passes the join moves to the maximum of a parabola through the gains of
        the best three joins, between the stations `bounds`. None if its predicted misfit exceeds
        `misfit_limit` (m²). Section III-A splits off the longest straight prefix instead.
        """
        three, best, side = self._climb(indices)
        top = _top(three, side, bounds)
        gain = best.gains[side] if top is None else max(best.gains[side], top[1])
        gain -= self._evidence * self._noise if side == BOTH else 0.0
        if self._samples.misfit - gain - GAIN_MARGIN * self._most > misfit_limit:
            return None
        for _ in range(PASSES):
            if top is None:
                break
            moved = self._at(top[0])
            if moved.gains[side] > best.gains[side]:
                best = moved
            if side == BOTH:
                side = self._side(best.gains)
            four = sorted([*three, moved])
            first_is_nearer = best.station - four[0].station < four[3].station - best.station
            three = four[:3] if first_is_nearer else four[1:]
            top = _top(three, side, bounds)
            if top is not None and top[1] - best.gains[side] < NEGLIGIBLE_GAIN * self._noise:
                break
        return self._curve(best, side)

    def _climb(self, indices: Sequence[int]) -> tuple[list[Join], Join, int]:
        """Climb from the middle of `indices` (sample indices) to the join with the largest gain.

        Returns up to three joins around it in order of travel, the best one, and its side.
        """
        stations = [self._stations[index] for index in indices]
        begin, end = max(len(stations) // 2 - 1, 0), len(stations) // 2 + 2
        tried = [self._at(station) for station in stations[begin:end]]
        while True:
            most = list(map(max, *[joined.gains for joined in tried]))
            side = self._side(most)
            top = [joined.gains[side] for joined in tried].index(most[side])
            if top == 0 and begin > 0:
                begin -= 1
                tried.insert(0, self._at(stations[begin]))
            elif top == len(tried) - 1 and end < len(stations):
                tried.append(self._at(stations[end]))
                end += 1
            else:
                break
        first = min(max(top - 1, 0), max(len(tried) - 3, 0))
        return tried[first : first + 3], tried[top], side

    def _side(self, gains: Sequence[float]) -> int:
        """Choose the side to be an arc by the gains (Section III-A), and update the noise."""
        samples = self._samples
        left = (samples.misfit - gains[BOTH]) / max(samples.count - 5.0, 1.0)
        self._noise = min(max(left, self._least), self._most)
        side = AFTER if gains[AFTER] >= gains[BEFORE] else BEFORE
        return BOTH if gains[BOTH] - self._evidence * self._noise > gains[side] else side

    def _at(self, station: float) -> Join:
        """Fit two pieces that join at `station` (m): linear least squares as in Section III-A.1.

        The join lies on the line between the samples before and after it.
        """
        stations, rows = self._stations, self._samples.rows
        split = min(max(bisect_right(stations, station), 1), len(stations) - 1)
        low, high = stations[split - 1], stations[split]
        share = (station - low) / (high - low) if high > low else 0.0
        x, y = rows.item(X, split - 1), rows.item(Y, split - 1)
        x += share * (rows.item(X, split) - x)
        y += share * (rows.item(Y, split) - y)
        factors = -2.0 * x, -2.0 * y, x * x + y * y
        one, along, cross, square = self._column(self._sums[:, split - 1].tolist(), factors)
        later_one, later_along, later_cross, later_square = self._column(self._total, factors)
        later_one -= one
        later_along -= along
        later_cross -= cross
        later_square -= square
        # Squared norms of the columns after removing their components along 1 and x.
        spread = square - one * one - along * along
        later_spread = later_square - later_one * later_one - later_along * later_along
        spread = max(spread, DETERMINED * square + TINY)
        later_spread = max(later_spread, DETERMINED * later_square + TINY)
        # The columns share no sample, but overlap through their components along 1 and x.
        shared = one * later_one + along * later_along
        half, later_half = cross / spread, later_cross / later_spread
        rest = max(1.0 - shared * shared / (spread * later_spread), DETERMINED)
        both = (half + shared * later_half / spread) / rest
        later_both = (later_half + shared * half / later_spread) / rest
        return Join(
            station,
            x,
            y,
            (later_half * later_cross, half * cross, both * cross + later_both * later_cross),
            ((0.0, later_half), (half, 0.0), (both, later_both)),
            (one, along, later_one, later_along),
        )

    def _column(self, sums: list[float], factors: Factors) -> tuple[float, float, float, float]:
        """Products of the column |q − P|² with normalised 1 and x, the residual, and itself."""
        samples, (norm_one, norm_x) = self._samples, self._norms
        ss, sx, sy, s1, xx, xy, x1, yy, y1, weight = sums  # s is x² + y²
        a, b, c = factors
        of_square = ss + a * sx + b * sy + c * s1
        of_x = sx + a * xx + b * xy + c * x1
        of_y = sy + a * xy + b * yy + c * y1
        of_one = s1 + a * x1 + b * y1 + c * weight
        of_x_about = of_x - samples.mean_x * of_one
        return (
            of_one * norm_one,
            of_x_about * norm_x,
            of_y - samples.mean_y * of_one - samples.slope * of_x_about,
            of_square + a * of_x + b * of_y + c * of_one,
        )

    def _curve(self, joined: Join, side: int) -> BestJoin:
        """Convert two pieces to a curve of the local frame (elementary algebra).

        The assumed join lies d to the left of the tangent, by the noise of a sample; P is its foot.
        There both sides have the same direction, and their gradients differ from the tangent's by
        twice the half curvature times d.
        """
        samples, (norm_one, norm_x) = self._samples, self._norms
        before, after = joined.halves[side]
        one, along, later_one, later_along = joined.shares
        slope = samples.slope - (before * along + after * later_along) * norm_x
        offset = samples.mean_y - slope * samples.mean_x
        offset -= (before * one + after * later_one) * norm_one
        norm = hypot(1.0, slope)
        away = (joined.y - offset - slope * joined.x) / norm
        curve = LocalCurve(
            joined.x + away * slope / norm,
            joined.y - away / norm,
            atan(slope),
            2.0 * before / (norm + 2.0 * before * away),
            2.0 * after / (norm + 2.0 * after * away),
            0.0,
        )
        misfit = max(samples.misfit - joined.gains[side], 0.0) / (norm * norm)
        return BestJoin(curve, misfit, 5 if side == BOTH else 4)


def _top(
    three: Sequence[Join], side: int, bounds: tuple[float, float]
) -> tuple[float, float] | None:
    """Maximum of the parabola through the gains of three joins: station (m) and height.

    Between the stations `bounds`. None if there is no maximum, or fewer than three joins.
    """
    if len(three) < 3:
        return None
    low, middle, high = three
    station, gain = middle.station, middle.gains[side]
    back, on = station - low.station, high.station - station
    fall_back, fall_on = gain - low.gains[side], gain - high.gains[side]
    curving, scale = fall_back * on + fall_on * back, back * on * (back + on)
    if not (curving > 0.0 and scale > 0.0):
        return None
    rise = fall_back * on * on - fall_on * back * back
    shift = min(max(0.5 * rise / curving, bounds[0] - station), bounds[1] - station)
    return station + shift, gain + shift * (rise - shift * curving) / scale
