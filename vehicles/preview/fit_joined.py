"""Least squares for two pieces with one tangent at the join: line→arc, arc→line, arc→arc.

Given the join P on the curve, all three are linear in offset, slope and curvatures: the equation of
the arc (see `fit_arc`) with a curvature on either side. So only the place of the join is sought: at
some of the samples, and from the best of them by parabolas through what the joins explain. All is
plain arithmetic on the sums of products up to a join.
"""

from collections.abc import Sequence
from math import atan, hypot, sqrt
from typing import NamedTuple

from vehicles.preview.fit_arc import DETERMINED, Centred, FitData, LocalCurve, X, Y, cumulated

SETTLED = 0.5
"""A join has settled where it explains what the parabola foretold, to within this share of the
noise squared: off by its standard error it explains less by one."""
TINY = 1e-30
"""Keeps an undetermined curvature from being zero by zero."""
AFTER, BEFORE, BOTH = range(3)
"""Which side of the join is an arc."""

Column = tuple[float, float, float, float]


class Joined(NamedTuple):
    """Two pieces with a join between, each linear least squares for the join (Section III-A).

    At the `station` and the place (x, y) (m). For `AFTER`, `BEFORE` and `BOTH`: by how much they
    lower the line's squared residuals (`gains`, m²), and half the curvatures before and after the
    join (`halves`, 1/m). `ones` and `along` are what 1 and x, both normed, have of the columns.
    """

    station: float
    x: float
    y: float
    gains: tuple[float, float, float]
    halves: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    ones: tuple[float, float]
    along: tuple[float, float]


class Search:
    """Looks for the best join; a change of curvature of Section III-A, anywhere in the samples."""

    def __init__(self, data: FitData, line: Centred) -> None:
        """`line` is the line of least squares through the samples."""
        self._data, self._line, self._sums = data, line, cumulated(data)
        self._norms = 1.0 / sqrt(line.weight), 1.0 / sqrt(line.xx)

    def at_sample(self, index: int) -> Joined:
        """Fit two pieces that join at a sample: linear least squares as in Section III-A.1."""
        rows = self._data.rows
        station, x, y = self._data.station.item(index), rows.item(X, index), rows.item(Y, index)
        return self._at(index + 1, station, x, y)

    def at(self, station: float) -> Joined:
        """Fit two pieces that join at `station` (m): linear least squares as in Section III-A.1.

        The place lies on the line from the sample before it to the one after it.
        """
        data = self._data
        last = len(data.station) - 1
        split = min(max(int(data.station.searchsorted(station, "right")), 1), last)
        low, high = data.station.item(split - 1), data.station.item(split)
        share = (station - low) / (high - low) if high > low else 0.0
        x, y = data.rows.item(X, split - 1), data.rows.item(Y, split - 1)
        x += share * (data.rows.item(X, split) - x)
        y += share * (data.rows.item(Y, split) - y)
        return self._at(split, station, x, y)

    def _at(self, split: int, station: float, x: float, y: float) -> Joined:
        """Fit two pieces that join beside (x, y), the first `split` samples before that."""
        one, along, cross, square = self._column(self._sums[:, :, split - 1].tolist(), x, y)
        all_one, all_along, all_cross, all_square = self._column(self._data.total, x, y)
        later_one, later_along = all_one - one, all_along - along
        later_cross = all_cross - cross
        spread = _spread(square, one, along)
        later_spread = _spread(all_square - square, later_one, later_along)
        # The columns of both sides have no sample in common, but 1 and x with both.
        shared = one * later_one + along * later_along
        half, later_half = cross / spread, later_cross / later_spread
        rest = max(1.0 - shared * shared / (spread * later_spread), DETERMINED)
        both = (half + shared * later_half / spread) / rest
        later_both = (later_half + shared * half / later_spread) / rest
        return Joined(
            station,
            x,
            y,
            (later_half * later_cross, half * cross, both * cross + later_both * later_cross),
            ((0.0, later_half), (half, 0.0), (both, later_both)),
            (one, later_one),
            (along, later_along),
        )

    def _column(self, sums: list[list[float]], x: float, y: float) -> Column:
        """Sums of products of |q − P|² with 1 and x, normed, with the residual, with itself."""
        line, (norm_one, norm_x) = self._line, self._norms
        by_square, by_x, by_y, by_one = sums
        a, b, c = -2.0 * x, -2.0 * y, x * x + y * y
        of_square = by_square[0] + a * by_x[0] + b * by_y[0] + c * by_one[0]
        of_x = by_square[1] + a * by_x[1] + b * by_y[1] + c * by_one[1]
        of_y = by_square[2] + a * by_x[2] + b * by_y[2] + c * by_one[2]
        of_one = by_square[3] + a * by_x[3] + b * by_y[3] + c * by_one[3]
        of_x_about = of_x - line.mean_x * of_one
        return (
            of_one * norm_one,
            of_x_about * norm_x,
            of_y - line.mean_y * of_one - line.slope * of_x_about,
            of_square + a * of_x + b * of_y + c * of_one,
        )

    def curve(self, joined: Joined, side: int) -> LocalCurve:
        """Give two pieces as a curve of the local frame (elementary algebra).

        What was taken for P lies d to the left of the tangent, by the noise of a sample. Its foot
        is P: there the equations of both sides have one direction, and gradients that differ from
        that of the tangent by twice the half curvature times d.
        """
        line, (norm_one, norm_x) = self._line, self._norms
        before, after = joined.halves[side]
        slope = line.slope - (before * joined.along[0] + after * joined.along[1]) * norm_x
        offset = line.mean_y - slope * line.mean_x
        offset -= (before * joined.ones[0] + after * joined.ones[1]) * norm_one
        norm = hypot(1.0, slope)
        away = (joined.y - offset - slope * joined.x) / norm
        return LocalCurve(
            joined.x + away * slope / norm,
            joined.y - away / norm,
            atan(slope),
            2.0 * before / (norm + 2.0 * before * away),
            2.0 * after / (norm + 2.0 * after * away),
            max(line.misfit - joined.gains[side], 0.0) / (norm * norm),
            5 if side == BOTH else 4,
        )


def _spread(square: float, one: float, along: float) -> float:
    """Square of what is left of a column without its parts along 1 and x."""
    return max(square - one * one - along * along, DETERMINED * square + TINY)


def best_joined(
    data: FitData,
    line: Centred,
    *,
    places: Sequence[int],
    within: tuple[float, float],
    evidence: float,
    noise: tuple[float, float],
    passes: int,
) -> LocalCurve:
    """Best line→arc or arc→line with its join at one of the samples `places`, or best two arcs.

    Two arcs have to lower the sum of squared residuals by `evidence` times the noise squared more;
    that is what they leave, held within `noise` (m²). The join then moves in up to `passes` to
    where a parabola through what the best three explain is highest, but stays between the stations
    `within`. Section III-A splits off the longest straight prefix instead.
    """
    search = Search(data, line)
    tried = [search.at_sample(place) for place in places]
    most = [max(one.gains[side] for one in tried) for side in (AFTER, BEFORE, BOTH)]
    spare, (least, largest) = max(line.weight - 5.0, 1.0), noise
    square = min(max((line.misfit - most[BOTH]) / spare, least), largest)
    side = _side(most, evidence * square)
    place = [one.gains[side] for one in tried].index(most[side])
    best, first = tried[place], min(max(place - 1, 0), max(len(tried) - 3, 0))
    three = tried[first : first + 3]
    for _ in range(passes):
        top = _top(three, side, within)
        if top is None:
            break
        moved = search.at(top[0])
        if moved.gains[side] > best.gains[side]:
            best = moved
        square = min((line.misfit - best.gains[side]) / spare, largest)
        settled = abs(moved.gains[side] - top[1]) < SETTLED * square
        if side == BOTH:
            side = _side(best.gains, evidence * max(square, least))
            settled = settled and side == BOTH
        if settled:
            break
        three = _nearest(best.station, [*three, moved])
    return search.curve(best, side)


def _side(gains: Sequence[float], dearer: float) -> int:
    """Side of the join that is best taken for an arc; both have to explain `dearer` (m²) more."""
    side = AFTER if gains[AFTER] >= gains[BEFORE] else BEFORE
    return BOTH if gains[BOTH] - dearer > gains[side] else side


def _nearest(station: float, tried: list[Joined]) -> list[Joined]:
    """Leave out the join furthest from `station` (m); the others in order of travel."""
    furthest = max(tried, key=lambda one: abs(one.station - station))
    return sorted(one for one in tried if one is not furthest)


def _top(three: list[Joined], side: int, within: tuple[float, float]) -> tuple[float, float] | None:
    """Station (m) where the parabola through what three joins explain is highest, and how high.

    Between the two stations `within`. None if there is no such place, or no three.
    """
    if len(three) < 3:
        return None
    low, middle, high = three
    back, on = middle.station - low.station, high.station - middle.station
    fall_back = middle.gains[side] - low.gains[side]
    fall_on = middle.gains[side] - high.gains[side]
    curving, scale = fall_back * on + fall_on * back, back * on * (back + on)
    if not (curving > 0.0 and scale > 0.0):
        return None
    rise = fall_back * on * on - fall_on * back * back
    shift = min(max(0.5 * rise / curving, within[0] - middle.station), within[1] - middle.station)
    height = middle.gains[side] + shift * (rise - shift * curving) / scale
    return middle.station + shift, height
