"""Least squares for two pieces with one tangent at the join: line→arc, arc→line, arc→arc.

For a given join P all three are linear in offset, slope and curvatures: the equation of the arc
with a curvature on either side (`arc_fits`). Only the station of the join is searched for: first by
hill climbing over some of the samples from the middle on, then by parabolas through the gains of
the best three. All is plain arithmetic on the sums of products up to a join.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from math import atan, hypot, sqrt
from typing import Final, NamedTuple

import numpy as np

from vehicles.geometry.arc_fits import DETERMINED, LocalCurve, Samples, X, Y

PAIRS = np.triu_indices(4)  # Pairs of rows of `Samples` with distinct products
JOINS: Final = 7  # Largest number of positions at which a join is tried first
PIECE_MIN: Final = 2.0
PIECE_RATIO: Final = 0.15  # Shortest piece beside a join, in m and as a share of the whole
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

    def best(self, misfit_limit: float) -> BestJoin | None:
        """Best line→arc, arc→line or arc→arc, at least three samples away from both ends.

        Starts from joins at some samples. In up to `PASSES` passes the join moves to the maximum of
        a parabola through the gains of the best three joins. None if its predicted misfit exceeds
        `misfit_limit` (m²). Section III-A splits off the longest straight prefix instead.
        """
        stations = self._stations
        margin = max(PIECE_MIN, PIECE_RATIO * (stations[-1] - stations[0]))
        bounds = stations[0] + margin, stations[-1] - margin
        low = max(bisect_left(stations, bounds[0]), 2)
        high = min(bisect_right(stations, bounds[1]), len(stations) - 3)
        if high - low < 2:
            return None
        count = min(JOINS, high - low)
        indices = [low + k * (high - 1 - low) // (count - 1) for k in range(count)]
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
