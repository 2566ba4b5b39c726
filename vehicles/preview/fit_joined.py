"""Least squares for two pieces with one tangent at the join: line→arc, arc→line, arc→arc.

Given the join P on the curve, all three are linear in offset, slope and curvatures: the equation of
the arc (see `fit_arc`) with a curvature on either side. So only the place of the join is sought: at
some of the samples, uphill from those in the middle, and from the best of them by parabolas through
the squared residuals that the joins explain. All is plain arithmetic on the sums of products up to
a join.
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
"""Predicted improvement, in noise squared, below which a join is not moved again: a join off by its
standard error explains one less.
"""
GAIN_MARGIN: Final = 2.0
"""Improvement, in noise squared, that a join may gain over the parabola's prediction. A join that
would not count even then is not refined.
"""
TINY: Final = 1e-30
"""Avoids zero by zero for an undetermined curvature."""
AFTER: Final = 0
BEFORE: Final = 1
BOTH: Final = 2
"""The side of the join that is an arc."""

Column = tuple[float, float, float, float]
Place = tuple[float, float, float]
"""Factors of x, y and 1 in |q − P|², next to x² + y²."""


@dataclass(slots=True)
class JoinedFit:
    """Two pieces with a join between, each linear least squares for the join (Section III-A).

    At the `station` and the place (x, y) (m). For `AFTER`, `BEFORE` and `BOTH`: the reduction of
    the line's squared residuals (`gains`, m²). `halves` (1/m) are half the curvatures of `BEFORE`
    and of `AFTER`, and those of `BOTH` before and after the join. `shares` are the components along
    1 and x, both normed, of the column before the join, and of that after it.
    """

    station: float
    x: float
    y: float
    gains: tuple[float, float, float]
    halves: tuple[float, float, float, float]
    shares: tuple[float, float, float, float]


class BestJoin(NamedTuple):
    """Two pieces of Section III-A, their sum of squared residuals (m²) and number of unknowns.

    These are 4, or 5 for two arcs.
    """

    curve: LocalCurve
    misfit: float
    freedom: int


class JoinSearch:
    """Search for the best join: a change of curvature of Section III-A, anywhere in the samples.

    `stations` (m) are those of `data`, `line` is that of least squares through the samples. Two
    arcs have to lower the sum of squared residuals by `evidence` times the noise squared more than
    one; the noise is estimated from their residuals, within the bounds `noise` (m²).
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

    def climb(self, places: Sequence[int]) -> tuple[list[JoinedFit], JoinedFit, int]:
        """Best join of Section III-A at samples, up to three around it in order, and its side.

        Tries the samples `places` from the middle on to the join that explains most.
        """
        begin, end = max(len(places) // 2 - 1, 0), len(places) // 2 + 2
        tried = [self.at_sample(place) for place in places[begin:end]]
        while True:
            most = list(map(max, *[joined.gains for joined in tried]))
            side = self.side(most)
            place = [joined.gains[side] for joined in tried].index(most[side])
            if place == 0 and begin > 0:
                begin -= 1
                tried.insert(0, self.at_sample(places[begin]))
            elif place == len(tried) - 1 and end < len(places):
                tried.append(self.at_sample(places[end]))
                end += 1
            else:
                break
        first = min(max(place - 1, 0), max(len(tried) - 3, 0))
        return tried[first : first + 3], tried[place], side

    def side(self, gains: Sequence[float]) -> int:
        """Side of the join that is best taken for an arc, by the gains of each (Section III-A)."""
        line = self._line
        left = (line.misfit - gains[BOTH]) / max(line.weight - 5.0, 1.0)
        least, most = self._least, self._most
        left = left if left > least else least  # noqa: FURB136 - twice as fast as max
        self.noise = left if left < most else most  # noqa: FURB136 - twice as fast as min
        side = AFTER if gains[AFTER] >= gains[BEFORE] else BEFORE
        return BOTH if gains[BOTH] - self._evidence * self.noise > gains[side] else side

    def least_misfit(self, gain: float, side: int) -> float:
        """Least misfit (m², J of eq. (5)) left by a join whose predicted gain is `gain`.

        Two arcs are charged what they cost more than one.
        """
        extra = self._evidence * self.noise if side == BOTH else 0.0
        return self._line.misfit - gain + extra - GAIN_MARGIN * self._most

    def at_sample(self, index: int) -> JoinedFit:
        """Fit two pieces that join at a sample: linear least squares as in Section III-A.1."""
        rows = self._data.rows
        return self._at(index + 1, self._stations[index], rows.item(X, index), rows.item(Y, index))

    def at(self, station: float) -> JoinedFit:
        """Fit two pieces that join at `station` (m): linear least squares as in Section III-A.1.

        The place lies on the line from the sample before it to the one after it.
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
        place = -2.0 * x, -2.0 * y, x * x + y * y
        one, along, cross, square = self._column(self._sums[:, split - 1].tolist(), place)
        later_one, later_along, later_cross, later_square = self._column(self._total, place)
        later_one -= one
        later_along -= along
        later_cross -= cross
        later_square -= square
        # What is left of a column without its parts along 1 and x, squared.
        spread = square - one * one - along * along
        later_spread = later_square - later_one * later_one - later_along * later_along
        spread = max(spread, DETERMINED * square + TINY)
        later_spread = max(later_spread, DETERMINED * later_square + TINY)
        # The columns of both sides have no sample in common, but 1 and x with both.
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

    def _column(self, sums: list[float], place: Place) -> Column:
        """Sums of products of |q − P|² with 1 and x, normed, with the residual, with itself."""
        mean_x, mean_y, slope, norm_one, norm_x = self._about
        ss, sx, sy, s1, xx, xy, x1, yy, y1, weight = sums  # s is x² + y²
        a, b, c = place
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
        """Two pieces as a curve of the local frame (elementary algebra).

        The assumed P lies d to the left of the tangent, by the noise of a sample. Its foot is P:
        there the equations of both sides have one direction, and gradients that differ from that of
        the tangent by twice the half curvature times d.
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
    places: Sequence[int],
    bounds: tuple[float, float],
    misfit_limit: float,
    passes: int,
) -> BestJoin | None:
    """Best line→arc or arc→line with its join at one of the samples `places`, or best two arcs.

    The join then moves in up to `passes` to the maximum of a parabola through the gains of the best
    three, but stays between the stations `bounds`. None if its predicted misfit exceeds
    `misfit_limit` (m²). Section III-A splits off the longest
    straight prefix instead.
    """
    three, best, side = search.climb(places)
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
    """Leave out the join furthest from `station` (m); the others in order of travel."""
    four, place = three.copy(), len(three)
    while place > 0 and four[place - 1].station > moved.station:
        place -= 1
    four.insert(place, moved)
    first_is_nearer = station - four[0].station < four[3].station - station
    return four[:3] if first_is_nearer else four[1:]


def _top(
    three: list[JoinedFit], side: int, bounds: tuple[float, float]
) -> tuple[float, float] | None:
    """Station (m) and height of the maximum of the parabola through the gains of three joins.

    Between the two stations `within`. None if there is no such place, or no three.
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
