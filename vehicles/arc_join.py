"""Least squares for a line and an arc with one tangent at the join (see `arc_shapes`).

Given the join P on the curve, line→arc and arc→line are linear in offset, slope and curvature: the
equation of the arc with κ = 0 on one side. So joins are tried at some of the samples, and the best
one is refined by Gauss–Newton passes on all four unknowns.
"""

from math import atan, cos, hypot, sin, sqrt
from typing import NamedTuple

import numpy as np

from vehicles.arc_shapes import DETERMINED, ONE, SQUARE, Centred, Floats, Samples, Shape, X, Y

SINGULAR = 1e-12
"""Least share of a diagonal that elimination may leave."""
SETTLED = 0.05
"""A join that moves less than this (m) has settled: what is left is of the order of its square."""
TINY = 1e-30
"""Keeps an undetermined curvature from being zero by zero."""


FLIPPED = np.array([ONE, X, Y, SQUARE])
SIGNED = np.array([[1.0], [-2.0], [-2.0], [1.0]])
"""|q − P|² is the sum of q's rows times P's rows, flipped and signed."""


class Joined(NamedTuple):
    """A line→arc or arc→line (Section III-A: one change of curvature), station of its join (m)."""

    shape: Shape
    station: float


def best_joined(samples: Samples, line: Centred, joins: slice) -> Joined:
    """Best line→arc or arc→line with its join near one of the samples `joins`.

    Each join is tried with the arc after it and with the arc before it, by linear least squares.
    A search of our own; Section III-A splits off the longest straight prefix instead.
    """
    rows, station = samples.rows[:, joins], samples.station[joins]
    count = len(station)
    bent = np.empty((2, 4, 4, count))  # sums over the arc's samples: after, before the join
    bent[1] = samples.sums[:, :, joins]
    np.subtract(samples.sums[:, :, -1:], bent[1], out=bent[0])
    # |q − P|² is a combination of the four rows, and so are the sums of its products with them;
    # with 1 and x these are normed, with x and y they are about the line through all samples.
    circle = rows.take(FLIPPED, 0) * SIGNED
    sums = np.einsum("sijk,jk->sik", bent, circle)
    square = np.einsum("sik,ik->sk", sums, circle)
    of_one, of_x, cross = np.einsum("ri,sik->rsk", _about(line), sums)
    spread = square - of_one * of_one - of_x * of_x
    half = cross / np.maximum(spread, DETERMINED * square + TINY)
    gain = half * cross
    best = int(gain.argmax())
    side, k = divmod(best, count)
    h, top = half.item(best), gain.item(best)
    slope = line.slope - h * of_x.item(best) / sqrt(line.xx)
    offset = line.mean_y - slope * line.mean_x - h * of_one.item(best) / sqrt(line.weight)
    shift = _top(gain[side], k, station)
    px = rows.item(X, k) + shift
    kappa = 2.0 * h / hypot(1.0, slope)
    before, after = (kappa, 0.0) if side else (0.0, kappa)
    misfit = max(line.misfit - top, 0.0) / (1.0 + slope * slope)
    shape = Shape(px, offset + slope * px, atan(slope), before, after, misfit, 4)
    return Joined(shape, station.item(k) + shift)


def _about(line: Centred) -> Floats:
    """What is taken of the sums: with 1 and x, each normed, and with the distance from the line."""
    x_norm = 1.0 / sqrt(line.xx)
    return np.array(
        [
            (0.0, 0.0, 0.0, 1.0 / sqrt(line.weight)),
            (0.0, x_norm, 0.0, -line.mean_x * x_norm),
            (0.0, -line.slope, 1.0, line.slope * line.mean_x - line.mean_y),
        ]
    )


def _top(gain: Floats, best: int, station: Floats) -> float:
    """How far (m) from the best join the parabola through its gain and two others' is highest.

    At the edge it may lie up to a step beyond.
    """
    if len(gain) < 3:
        return 0.0
    k = min(max(best, 1), len(gain) - 2)
    low, top, high = gain[k - 1 : k + 2].tolist()
    here = station.item(k)
    back, on = here - station.item(k - 1), station.item(k + 1) - here
    fall_back, fall_on = top - low, top - high
    bend = fall_back * on + fall_on * back
    if not bend > 0.0:
        return 0.0
    shift = 0.5 * (fall_back * on * on - fall_on * back * back) / bend
    return float(here + min(max(shift, -2.0 * back), 2.0 * on) - station.item(best))


def refined(joined: Joined, samples: Samples, passes: int, within: tuple[float, float]) -> Shape:
    """Improve a joined shape by up to `passes` Gauss–Newton passes on all four unknowns.

    The join stays between the stations `within` (m).
    """
    shape, station = joined
    first, last = within
    whole = samples.sums[:, :, -1]
    total = whole.tolist()
    for done in range(passes):
        split = int(samples.station.searchsorted(station, "right"))
        sums = samples.sums[:, :, split - 1]
        bent = (sums if shape.before else whole - sums).tolist()
        rows = _normal_equations(shape, bent, total)
        step = solved(rows, first - station, last - station)
        if step is None:
            break
        left, turn, bend, along = step
        station += along
        ux, uy = cos(shape.angle), sin(shape.angle)
        shape = Shape(
            shape.x + along * ux - left * uy,
            shape.y + along * uy + left * ux,
            shape.angle + turn,
            shape.before + bend if shape.before else 0.0,
            shape.after + bend if shape.after else 0.0,
            shape.misfit,
            4,
        )
        if done and abs(along) < SETTLED:
            break
    return shape


def _normal_equations(
    shape: Shape, bent: list[list[float]], total: list[list[float]]
) -> list[list[float]]:
    """Equations of the Gauss–Newton step, each with its right-hand side.

    With (ξ, η) in the frame of P, ρ = ξ² + η², E falls by 1 − κη per shift of P to the left, by ξ
    per turn of u, by ρ/2 per curvature and by −κξ per shift of P along u; on the line by 1, ξ, 0
    and 0. `bent` are the sums over the arc's samples, `total` over all.
    """
    ux, uy = cos(shape.angle), sin(shape.angle)
    px, py = shape.x, shape.y
    k = shape.before + shape.after
    half = 0.5 * k
    rho = (1.0, -2.0 * px, -2.0 * py, px * px + py * py)
    xi = (0.0, ux, uy, -(ux * px + uy * py))
    eta = (0.0, -uy, ux, uy * px - ux * py)
    of_rho, of_xi, of_eta = _times(bent, rho), _times(bent, xi), _times(bent, eta)
    all_xi, all_eta = _times(total, xi), _times(total, eta)
    rr, rx, ry = _dot(rho, of_rho), _dot(rho, of_xi), _dot(rho, of_eta)
    xx, xy, yy = _dot(xi, of_xi), _dot(xi, of_eta), _dot(eta, of_eta)
    square = of_rho[ONE] - k * ry
    left_turn = all_xi[ONE] - k * xy
    left_left = total[ONE][ONE] - k * (2.0 * of_eta[ONE] - k * yy)
    left_along = -k * (of_xi[ONE] - k * xy)
    turn_turn, turn_rest = _dot(xi, all_xi), _dot(xi, all_eta) - half * rx
    return [
        [left_left, left_turn, 0.5 * square, left_along, all_eta[ONE] - k * yy - half * square],
        [left_turn, turn_turn, 0.5 * rx, -k * xx, turn_rest],
        [0.5 * square, 0.5 * rx, 0.25 * rr, -half * rx, 0.5 * (ry - half * rr)],
        [left_along, -k * xx, -half * rx, k * k * xx, -k * (xy - half * rx)],
    ]


Vector = tuple[float, float, float, float]


def _times(matrix: list[list[float]], vector: Vector) -> Vector:
    a, b, c, d = vector
    m0, m1, m2, m3 = matrix
    return (
        a * m0[0] + b * m0[1] + c * m0[2] + d * m0[3],
        a * m1[0] + b * m1[1] + c * m1[2] + d * m1[3],
        a * m2[0] + b * m2[1] + c * m2[2] + d * m2[3],
        a * m3[0] + b * m3[1] + c * m3[2] + d * m3[3],
    )


def _dot(one: Vector, other: Vector) -> float:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2] + one[3] * other[3]


def solved(
    rows: list[list[float]], low: float, high: float
) -> tuple[float, float, float, float] | None:
    """Solve four symmetric positive equations by Gaussian elimination; None if they are singular.

    Each row ends with its right-hand side. The last unknown is held between `low` and `high`, and
    the others are the best ones for the value that it then has.
    """
    (a0, b0, c0, d0, e0), (_, b1, c1, d1, e1), (_, _, c2, d2, e2), (_, _, _, d3, e3) = rows
    if not a0 > 0.0:
        return None
    floor_b, floor_c, floor_d = SINGULAR * b1, SINGULAR * c2, SINGULAR * d3
    factor = b0 / a0
    b1, c1, d1, e1 = b1 - factor * b0, c1 - factor * c0, d1 - factor * d0, e1 - factor * e0
    factor = c0 / a0
    c2, d2, e2 = c2 - factor * c0, d2 - factor * d0, e2 - factor * e0
    factor = d0 / a0
    d3, e3 = d3 - factor * d0, e3 - factor * e0
    if not b1 > floor_b:
        return None
    factor = c1 / b1
    c2, d2, e2 = c2 - factor * c1, d2 - factor * d1, e2 - factor * e1
    factor = d1 / b1
    d3, e3 = d3 - factor * d1, e3 - factor * e1
    if not c2 > floor_c:
        return None
    factor = d2 / c2
    d3, e3 = d3 - factor * d2, e3 - factor * e2
    if not d3 > floor_d:
        return None
    w = min(max(e3 / d3, low), high)
    z = (e2 - d2 * w) / c2
    y = (e1 - c1 * z - d1 * w) / b1
    return (e0 - b0 * y - c0 * z - d0 * w) / a0, y, z, w
