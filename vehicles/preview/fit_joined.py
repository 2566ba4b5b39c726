"""Least squares for two pieces with one tangent at the join: line→arc, arc→line, arc→arc.

For a given join P all three are linear in offset, slope and curvatures: the equation of the arc
(`fit_arc`) with a curvature on either side. Only the station of the join is searched for: first by
hill climbing over some of the samples from the middle on, then by parabolas through the gains of
the best three. All is plain arithmetic on the sums of products up to a join.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from math import atan, hypot, sqrt
from typing import Final, NamedTuple

from vehicles.preview.fit_arc import (
    DETERMINED,
    FitData,
    LineRegression,
    LocalCurve,
    X,
    Y,
    cumulative_sums,
)

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

Column = tuple[float, float, float, float]
Factors = tuple[float, float, float]  # Factors of x, y and 1 in |q − P|², next to x² + y²


@dataclass(slots=True)
class JoinedFit:
    """Least squares of two pieces (Section III-A) with a join at `station` and (x, y) (m).

    `gains` (m²) are the reductions of the line's squared residuals for `AFTER`, `BEFORE` and
    `BOTH`. `halves` (1/m) are half the curvatures: of `BEFORE`, of `AFTER`, and of `BOTH` before
    and after the join. `shares` are the components along normalised 1 and x of the column before
    the join and of the column after it.
    """

    station: float
    x: float
    y: float
    gains: tuple[float, float, float]
    halves: tuple[float, float, float, float]
    shares: tuple[float, float, float, float]


class BestJoin(NamedTuple):
    """Two pieces of Section III-A, the sum of squared residuals (m²), and 4 or 5 unknowns."""

    curve: LocalCurve
    misfit: float
    freedom: int


class JoinSearch:
    """Search for the best join, a change of curvature of Section III-A anywhere in the samples.

    `stations` (m) are those of `data`, `line` is the regression line. Two arcs must lower the sum
    of squared residuals by `evidence` times the squared noise more than one. The noise is estimated
    from their residuals, within the bounds `noise` (m²).
    """

    def __init__(
        self,
        data: FitData,
        stations: list[float],
        line: LineRegression,
        noise: tuple[float, float],
        evidence: float,
    ) -> None:
        self._least, self._most = noise
        self.noise, self._evidence = self._most, evidence
        self._data, self._line, self._sums = data, line, cumulative_sums(data)
        self._total = self._sums[:, -1].tolist()
        self._stations = stations
        norms = 1.0 / sqrt(line.weight), 1.0 / sqrt(line.xx)
        self._about = line.mean_x, line.mean_y, line.slope, *norms

    def climb(self, indices: Sequence[int]) -> tuple[list[JoinedFit], JoinedFit, int]:
        """Climb from the middle of `indices` (sample indices) to the join with the largest gain.

        Returns up to three joins around it in order of travel, the best one, and its side.
        """
        begin, end = max(len(indices) // 2 - 1, 0), len(indices) // 2 + 2
        tried = [self.at_sample(index) for index in indices[begin:end]]
        while True:
            most = list(map(max, *[joined.gains for joined in tried]))
            side = self.side(most)
            top = [joined.gains[side] for joined in tried].index(most[side])
            if top == 0 and begin > 0:
                begin -= 1
                tried.insert(0, self.at_sample(indices[begin]))
            elif top == len(tried) - 1 and end < len(indices):
                tried.append(self.at_sample(indices[end]))
                end += 1
            else:
                break
        first = min(max(top - 1, 0), max(len(tried) - 3, 0))
        return tried[first : first + 3], tried[top], side

    def side(self, gains: Sequence[float]) -> int:
        """Choose the side to be an arc by the gains (Section III-A), and update the noise."""
        line = self._line
        left = (line.misfit - gains[BOTH]) / max(line.weight - 5.0, 1.0)
        least, most = self._least, self._most
        left = left if left > least else least  # noqa: FURB136 - twice as fast as max
        self.noise = left if left < most else most  # noqa: FURB136 - twice as fast as min
        side = AFTER if gains[AFTER] >= gains[BEFORE] else BEFORE
        return BOTH if gains[BOTH] - self._evidence * self.noise > gains[side] else side

    def least_misfit(self, gain: float, side: int) -> float:
        """Smallest misfit (m², J of eq. (5)) to expect of a join with this predicted gain.

        Two arcs are charged their extra price.
        """
        extra = self._evidence * self.noise if side == BOTH else 0.0
        return self._line.misfit - gain + extra - GAIN_MARGIN * self._most

    def at_sample(self, index: int) -> JoinedFit:
        """Fit two pieces that join at a sample: linear least squares as in Section III-A.1."""
        rows = self._data.rows
        return self._at(index + 1, self._stations[index], rows.item(X, index), rows.item(Y, index))

    def at(self, station: float) -> JoinedFit:
        """Fit two pieces that join at `station` (m): linear least squares as in Section III-A.1.

        The join lies on the line between the samples before and after it.
        """
        stations, rows = self._stations, self._data.rows
        split = min(max(bisect_right(stations, station), 1), len(stations) - 1)
        low, high = stations[split - 1], stations[split]
        share = (station - low) / (high - low) if high > low else 0.0
        x, y = rows.item(X, split - 1), rows.item(Y, split - 1)
        x += share * (rows.item(X, split) - x)
        y += share * (rows.item(Y, split) - y)
        return self._at(split, station, x, y)

    def _at(self, split: int, station: float, x: float, y: float) -> JoinedFit:
        """Fit two pieces that join next to (x, y), after the first `split` samples."""
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
        return JoinedFit(
            station,
            x,
            y,
            (later_half * later_cross, half * cross, both * cross + later_both * later_cross),
            (half, later_half, both, later_both),
            (one, along, later_one, later_along),
        )

    def _column(self, sums: list[float], factors: Factors) -> Column:
        """Products of the column |q − P|² with normalised 1 and x, the residual, and itself."""
        mean_x, mean_y, slope, norm_one, norm_x = self._about
        ss, sx, sy, s1, xx, xy, x1, yy, y1, weight = sums  # s is x² + y²
        a, b, c = factors
        of_square = ss + a * sx + b * sy + c * s1
        of_x = sx + a * xx + b * xy + c * x1
        of_y = sy + a * xy + b * yy + c * y1
        of_one = s1 + a * x1 + b * y1 + c * weight
        of_x_about = of_x - mean_x * of_one
        return (
            of_one * norm_one,
            of_x_about * norm_x,
            of_y - mean_y * of_one - slope * of_x_about,
            of_square + a * of_x + b * of_y + c * of_one,
        )

    def to_curve(self, joined: JoinedFit, side: int) -> BestJoin:
        """Convert two pieces to a curve of the local frame (elementary algebra).

        The assumed join lies d to the left of the tangent, by the noise of a sample; P is its foot.
        There both sides have the same direction, and their gradients differ from the tangent's by
        twice the half curvature times d.
        """
        mean_x, mean_y, line_slope, norm_one, norm_x = self._about
        half, later_half, both, later_both = joined.halves
        before, after = ((0.0, later_half), (half, 0.0), (both, later_both))[side]
        one, along, later_one, later_along = joined.shares
        slope = line_slope - (before * along + after * later_along) * norm_x
        offset = mean_y - slope * mean_x
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
        misfit = max(self._line.misfit - joined.gains[side], 0.0) / (norm * norm)
        return BestJoin(curve, misfit, 5 if side == BOTH else 4)


def best_join(
    search: JoinSearch,
    *,
    indices: Sequence[int],
    bounds: tuple[float, float],
    misfit_limit: float,
    passes: int,
) -> BestJoin | None:
    """Best line→arc, arc→line or arc→arc, starting from joins at the samples `indices`.

    In up to `passes` passes the join moves to the maximum of a parabola through the gains of the
    best three joins, between the stations `bounds`. None if its predicted misfit exceeds
    `misfit_limit` (m²). Section III-A splits off the longest straight prefix instead.
    """
    three, best, side = search.climb(indices)
    top = _top(three, side, bounds)
    predicted = best.gains[side] if top is None else max(best.gains[side], top[1])
    if search.least_misfit(predicted, side) > misfit_limit:
        return None
    for _ in range(passes):
        if top is None:
            break
        moved = search.at(top[0])
        if moved.gains[side] > best.gains[side]:
            best = moved
        if side == BOTH:
            side = search.side(best.gains)
        three = _nearest(best.station, three, moved)
        top = _top(three, side, bounds)
        if top is not None and top[1] - best.gains[side] < NEGLIGIBLE_GAIN * search.noise:
            break
    return search.to_curve(best, side)


def _nearest(station: float, three: list[JoinedFit], moved: JoinedFit) -> list[JoinedFit]:
    """The three joins nearest to `station` (m), in order of travel."""
    four, index = three.copy(), len(three)
    while index > 0 and four[index - 1].station > moved.station:
        index -= 1
    four.insert(index, moved)
    first_is_nearer = station - four[0].station < four[3].station - station
    return four[:3] if first_is_nearer else four[1:]


def _top(
    three: list[JoinedFit], side: int, bounds: tuple[float, float]
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
