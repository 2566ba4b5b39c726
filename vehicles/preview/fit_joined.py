"""Least squares for two pieces with one tangent at the join: line→arc, arc→line, arc→arc.

Given the join P on the curve, all three are linear in offset, slope and curvatures: the equation of
the arc (see `fit_arc`) with a curvature on either side. So joins are tried at some of the samples,
and the best one is refined by Gauss–Newton passes on all unknowns.
"""

from math import atan, cos, hypot, inf, sin, sqrt
from typing import NamedTuple

import numpy as np

from vehicles.preview.fit_arc import (
    DETERMINED,
    ONE,
    SQUARE,
    Centred,
    FitData,
    Floats,
    LocalCurve,
    X,
    Y,
    seen_from,
)

SINGULAR = 1e-12
"""Least share of a diagonal that elimination may leave."""
SETTLED = 0.25
"""A join that moves less than this (m) has settled: what is left is of the order of its square."""
TELLING = 0.5
"""A pass that takes away at least this share of the misfit is followed by another."""
TINY = 1e-30
"""Keeps an undetermined curvature from being zero by zero."""


FLIPPED = np.array([ONE, X, Y, SQUARE])
SIGNED = np.array([[1.0], [-2.0], [-2.0], [1.0]])
"""|q − P|² is the sum of q's rows times P's rows, flipped and signed."""


class Joined(NamedTuple):
    """Two pieces (Section III-A: one change of curvature) and the station of their join (m)."""

    curve: LocalCurve
    station: float


def best_joined(
    data: FitData, line: Centred, joins: slice, evidence: float, noise: tuple[float, float]
) -> Joined:
    """Best line→arc or arc→line with its join near one of the samples `joins`, or best two arcs.

    Two arcs have to lower the sum of squared residuals by `evidence` times the noise squared more;
    that is what they leave, held within `noise` (m²). Each join is tried by linear least squares;
    Section III-A splits off the longest straight prefix instead.
    """
    rows, station = data.rows[:, joins], data.station[joins]
    count = len(station)
    bent = np.empty((2, 4, 4, count))  # sums over the samples after, before the join
    bent[1] = data.sums[:, :, joins]
    np.subtract(data.sums[:, :, -1:], bent[1], out=bent[0])
    # |q − P|² is a combination of the four rows, and so are the sums of its products with them;
    # with 1 and x these are normed, with x and y they are about the line through all samples.
    circle = rows.take(FLIPPED, 0) * SIGNED
    sums = np.einsum("sijk,jk->sik", bent, circle)
    square = np.einsum("sik,ik->sk", sums, circle)
    of_rows = np.einsum("ai,sik->ask", _about(line), sums)
    of, cross = of_rows[:2], of_rows[2]
    spread = np.maximum(square - np.add.reduce(of * of, 0), DETERMINED * square + TINY)
    half = cross / spread
    gain = half * cross
    # The columns of both sides have no sample in common, but 1 and x with both.
    shared = np.add.reduce(np.multiply.reduce(of, 1), 0)
    independent = np.maximum(1.0 - shared * shared / (spread[0] * spread[1]), DETERMINED)
    both = (half + shared * half[::-1] / spread) / independent
    gain_of_both = np.add.reduce(both * cross, 0)
    place = int(gain_of_both.argmax())
    side, k = divmod(int(gain.argmax()), count)
    left = (line.misfit - gain_of_both.item(place)) / max(line.weight - 5.0, 1.0)
    dearer = evidence * min(max(left, noise[0]), noise[1])
    if gain_of_both.item(place) - dearer > gain.item(side, k):
        chosen, half, k, gain = [0, 1], both, place, gain_of_both
    else:
        chosen, gain = [side], gain[side]
    bends, slope, offset = [0.0, 0.0], line.slope, line.mean_y
    for one in chosen:
        h = half.item(one, k)
        bends[one] = 2.0 * h
        slope -= h * of.item(1, one, k) / sqrt(line.xx)
        offset -= h * of.item(0, one, k) / sqrt(line.weight)
    offset -= slope * line.mean_x
    shift, height = _top(gain, k, station)
    px, norm = rows.item(X, k) + shift, hypot(1.0, slope)
    curve = LocalCurve(
        px,
        offset + slope * px,
        atan(slope),
        bends[1] / norm,
        bends[0] / norm,
        max(line.misfit - height, 0.0) / (norm * norm),
        3 + len(chosen),
    )
    return Joined(curve, station.item(k) + shift)


def _about(line: Centred) -> Floats:
    """What is taken of the sums: with 1 and x, each normed, and with the distance from the line."""
    x_norm = 1.0 / sqrt(line.xx)
    away = line.slope * line.mean_x - line.mean_y
    factors = (
        *(0.0, 0.0, 0.0, 1.0 / sqrt(line.weight)),
        *(0.0, x_norm, 0.0, -line.mean_x * x_norm),
        *(0.0, -line.slope, 1.0, away),
    )
    return np.array(factors).reshape(3, 4)


def _top(gain: Floats, best: int, station: Floats) -> tuple[float, float]:
    """Where the parabola through the best gain and its neighbours is highest, and how high.

    How far (m) from the best join. At the edge it may lie up to a step beyond.
    """
    if len(gain) < 3:
        return 0.0, gain.item(best)
    k = min(max(best, 1), len(gain) - 2)
    low, top, high = gain[k - 1 : k + 2].tolist()
    here = station.item(k)
    back, on = here - station.item(k - 1), station.item(k + 1) - here
    fall_back, fall_on = top - low, top - high
    curving = fall_back * on + fall_on * back
    if not (curving > 0.0 and back * on > 0.0):
        return 0.0, gain.item(best)
    rise = fall_back * on * on - fall_on * back * back
    shift = min(max(0.5 * rise / curving, -2.0 * back), 2.0 * on)
    height = top + shift * (rise - shift * curving) / (back * on * (back + on))
    return here + shift - station.item(best), max(height, gain.item(best))


def refined(joined: Joined, data: FitData, passes: int, within: tuple[float, float]) -> LocalCurve:
    """Improve a joined curve by up to `passes` Gauss–Newton passes on all its unknowns.

    The join stays between the stations `within` (m). A piece that is straight stays so. A pass that
    made it worse is taken back by the next one.
    """
    curve, station = joined
    first, last = within
    whole, before, misfit = data.sums[:, :, -1], curve, inf
    for _ in range(passes):
        split = int(data.station.searchsorted(station, "right"))
        sums = np.empty((2, 4, 4))
        sums[0] = data.sums[:, :, split - 1]
        np.subtract(whole, sums[0], out=sums[1])
        *rows, (*_, here) = _normal_equations(curve, sums)
        if not here <= misfit:
            return before
        before, misfit = curve, here
        falls = [row[-1] for row in rows]
        step = solved(rows, first - station, last - station)
        if step is None:
            break
        fall = sum(one * by for one, by in zip(step, falls, strict=True))
        left, turn, *change, along = step
        station += along
        ux, uy = cos(curve.angle), sin(curve.angle)
        curve = LocalCurve(
            curve.x + along * ux - left * uy,
            curve.y + along * uy + left * ux,
            curve.angle + turn,
            curve.before + change[0] if curve.before else 0.0,
            curve.after + change[-1] if curve.after else 0.0,
            curve.misfit,
            curve.freedom,
        )
        if abs(along) < SETTLED and fall < TELLING * here:
            break
    return curve


def _normal_equations(curve: LocalCurve, sums: Floats) -> list[list[float]]:
    """Equations of the Gauss–Newton step, each with its right-hand side, and the misfit (m²) last.

    With (ξ, η) in the frame of P, ρ = ξ² + η², E falls by 1 − κη per shift of P to the left, by ξ
    per turn of u, by ρ/2 per curvature on its side and by −κξ per shift of P along u. Each of these
    and E itself is a combination of x² + y², x, y and 1, whose products are in `sums`, those of
    the samples before the join and of those after it, shape (2, 4, 4).
    """
    ahead, (_, left_x, left_y, left_1), (_, square_x, square_y, square_1) = seen_from(
        curve.x, curve.y, curve.angle
    )
    half = (0.5, 0.5 * square_x, 0.5 * square_y, 0.5 * square_1)
    nothing = (0.0, 0.0, 0.0, 0.0)
    sides = []
    for after, k in enumerate((curve.before, curve.after)):
        columns = [(0.0, -k * left_x, -k * left_y, 1.0 - k * left_1), ahead]
        if curve.before:
            columns.append(nothing if after else half)
        if curve.after:
            columns.append(half if after else nothing)
        columns += (
            (0.0, -k * ahead[1], -k * ahead[2], -k * ahead[3]),
            (-k * 0.5, left_x - k * half[1], left_y - k * half[2], left_1 - k * half[3]),
        )
        sides.append(columns)
    combined = np.array(sides)
    rows: list[list[float]] = np.einsum("sik,skl,sjl->ij", combined, sums, combined).tolist()
    return rows


def solved(rows: list[list[float]], low: float, high: float) -> list[float] | None:
    """Solve symmetric positive equations by Gaussian elimination; None if they are singular.

    Each row ends with its right-hand side. The last unknown is held between `low` and `high`, and
    the others are the best ones for the value that it then has.
    """
    count = len(rows)
    floors = [SINGULAR * row[k] for k, row in enumerate(rows)]
    for k, pivot in enumerate(rows):
        if not pivot[k] > floors[k]:
            return None
        for row in rows[k + 1 :]:
            factor = row[k] / pivot[k]
            for j in range(k + 1, count + 1):
                row[j] -= factor * pivot[j]
    found = [0.0] * count
    for k in range(count - 1, -1, -1):
        row = rows[k]
        value = row[count]
        for j in range(k + 1, count):
            value -= row[j] * found[j]
        found[k] = value / row[k]
        if k == count - 1:
            found[k] = min(max(found[k], low), high)
    return found
