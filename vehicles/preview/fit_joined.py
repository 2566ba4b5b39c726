"""Least squares for a line and an arc with one tangent at the join (see `fit_arc`).

Given the join P on the curve, line→arc and arc→line are linear in offset, slope and curvature: the
equation of the arc with κ = 0 on one side. So joins are tried at some of the samples, and the best
one is refined by Gauss–Newton passes on all four unknowns.
"""

from math import atan, cos, hypot, sin, sqrt
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
)

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

    curve: LocalCurve
    station: float


def best_joined(data: FitData, line: Centred, joins: slice) -> Joined:
    """Best line→arc or arc→line with its join near one of the samples `joins`.

    Each join is tried with the arc after it and with the arc before it, by linear least squares.
    Section III-A splits off the longest straight prefix instead.
    """
    rows, station = data.rows[:, joins], data.station[joins]
    count = len(station)
    bent = np.empty((2, 4, 4, count))  # sums over the arc's samples: after, before the join
    bent[1] = data.sums[:, :, joins]
    np.subtract(data.sums[:, :, -1:], bent[1], out=bent[0])
    # |q − P|² is a combination of the four rows, and so are the sums of its products with them;
    # with 1 and x these are normed, with x and y they are about the line through all samples.
    circle = rows.take(FLIPPED, 0) * SIGNED
    sums = np.einsum("sijk,jk->sik", bent, circle)
    square = np.einsum("sik,ik->sk", sums, circle)
    of_one, of_x, cross = np.add.reduce(_about(line) * sums, 2)
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
    curve = LocalCurve(px, offset + slope * px, atan(slope), before, after, misfit, 4)
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
    return np.array(factors).reshape(3, 1, 4, 1)


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
    curving = fall_back * on + fall_on * back
    if not curving > 0.0:
        return 0.0
    shift = 0.5 * (fall_back * on * on - fall_on * back * back) / curving
    return float(here + min(max(shift, -2.0 * back), 2.0 * on) - station.item(best))


def refined(joined: Joined, data: FitData, passes: int, within: tuple[float, float]) -> LocalCurve:
    """Improve a joined curve by up to `passes` Gauss–Newton passes on all four unknowns.

    The join stays between the stations `within` (m).
    """
    curve, station = joined
    first, last = within
    whole = data.sums[:, :, -1]
    total = whole.tolist()
    for done in range(passes):
        split = int(data.station.searchsorted(station, "right"))
        sums = data.sums[:, :, split - 1]
        bent = (sums if curve.before else whole - sums).tolist()
        rows = _normal_equations(curve, bent, total)
        step = solved(rows, first - station, last - station)
        if step is None:
            break
        left, turn, change, along = step
        station += along
        ux, uy = cos(curve.angle), sin(curve.angle)
        curve = LocalCurve(
            curve.x + along * ux - left * uy,
            curve.y + along * uy + left * ux,
            curve.angle + turn,
            curve.before + change if curve.before else 0.0,
            curve.after + change if curve.after else 0.0,
            curve.misfit,
            4,
        )
        if done and abs(along) < SETTLED:
            break
    return curve


def _normal_equations(
    curve: LocalCurve, bent: list[list[float]], total: list[list[float]]
) -> list[list[float]]:
    """Equations of the Gauss–Newton step, each with its right-hand side.

    With (ξ, η) in the frame of P, ρ = ξ² + η², E falls by 1 − κη per shift of P to the left, by ξ
    per turn of u, by ρ/2 per curvature and by −κξ per shift of P along u; on the line by 1, ξ, 0
    and 0. `bent` are the sums over the arc's samples, `total` over all.
    """
    ux, uy = cos(curve.angle), sin(curve.angle)
    px, py = curve.x, curve.y
    p, q = ux * px + uy * py, ux * py - uy * px  # ξ = ux x + uy y − p, η = ux y − uy x − q
    k = curve.before + curve.after
    half = 0.5 * k
    # Of all samples: Σξ, Ση, Σξ², Σξη.
    _, (_, xx, xy, x1), (_, _, yy, y1), (_, _, _, all_1) = total
    all_xi, all_eta = ux * x1 + uy * y1 - p * all_1, ux * y1 - uy * x1 - q * all_1
    xi_x, xi_y = ux * xx + uy * xy - p * x1, ux * xy + uy * yy - p * y1
    turn_turn = ux * xi_x + uy * xi_y - p * all_xi
    turn_off = ux * xi_y - uy * xi_x - q * all_xi
    # Of the arc's: the same, and with ρ = s − 2 px x − 2 py y + r, where s = x² + y².
    (ss, sx, sy, s1), (_, xx, xy, x1), (_, _, yy, y1), (_, _, _, one) = bent
    fx, fy, r = 2.0 * px, 2.0 * py, px * px + py * py
    of_xi, of_eta = ux * x1 + uy * y1 - p * one, ux * y1 - uy * x1 - q * one
    xi_x, xi_y = ux * xx + uy * xy - p * x1, ux * xy + uy * yy - p * y1
    eta_x, eta_y = ux * xy - uy * xx - q * x1, ux * yy - uy * xy - q * y1
    xi_xi = ux * xi_x + uy * xi_y - p * of_xi
    xi_eta = ux * xi_y - uy * xi_x - q * of_xi
    eta_eta = ux * eta_y - uy * eta_x - q * of_eta
    of_rho = s1 - fx * x1 - fy * y1 + r * one
    rho_x, rho_y = sx - fx * xx - fy * xy + r * x1, sy - fx * xy - fy * yy + r * y1
    rho_rho = ss - fx * sx - fy * sy + r * s1 - fx * rho_x - fy * rho_y + r * of_rho
    rho_xi = ux * rho_x + uy * rho_y - p * of_rho
    rho_eta = ux * rho_y - uy * rho_x - q * of_rho
    square = of_rho - k * rho_eta
    left_turn = all_xi - k * xi_eta
    left_left = all_1 - k * (2.0 * of_eta - k * eta_eta)
    left_along = -k * (of_xi - k * xi_eta)
    left_off = all_eta - k * eta_eta - half * square
    return [
        [left_left, left_turn, 0.5 * square, left_along, left_off],
        [left_turn, turn_turn, 0.5 * rho_xi, -k * xi_xi, turn_off - half * rho_xi],
        [
            0.5 * square,
            0.5 * rho_xi,
            0.25 * rho_rho,
            -half * rho_xi,
            0.5 * (rho_eta - half * rho_rho),
        ],
        [left_along, -k * xi_xi, -half * rho_xi, k * k * xi_xi, -k * (xi_eta - half * rho_xi)],
    ]


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
