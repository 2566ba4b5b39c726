"""Least squares for line, arc, line→arc and arc→line, in closed form (paper, Section III-A-1).

One equation serves all. Through a point P with unit tangent u and normal n (left), the arc of
curvature κ is the set of points q with

    E(q) = (q − P)·n − κ/2 |q − P|² = 0,

the paper's e(x, y) divided by −2R: exact for every circle, a line for κ = 0, and linear in offset,
slope and κ once P is given. On the curve its gradient has length one, so E is the distance to first
order and the least-squares fit is not biased towards small circles as with e(x, y) itself.
Coordinates are centred at the samples and turned along them, which makes the equations well
conditioned (far from the origin the paper's are not). A join is tried on a small grid: given the
join, a line→arc is this very equation with κ = 0 before it. The best is refined by two
Gauss–Newton passes on all four unknowns. All sums are elementwise, so results do not depend on a
linear-algebra library.
"""

from math import atan, cos, hypot, inf, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_sum = np.add.reduce


class Shape(NamedTuple):
    """A curve of one or two pieces in the local frame.

    It passes the join P = (x, y) (m) with tangent `angle` (rad), bends with curvature `before` and
    `after` it (1/m). `misfit` is its weighted sum of squared residuals (m²), `freedom` its number
    of unknowns: 2 line, 3 arc, 4 line→arc or arc→line.
    """

    x: float
    y: float
    angle: float
    before: float
    after: float
    misfit: float
    freedom: int


class Samples(NamedTuple):
    """Samples in the local frame, in order of travel.

    x along the travel, y left, both centred (m); station (m); weights, scaled so that their sum
    is the number of equally weighted samples that would say as much.
    """

    x: Floats
    y: Floats
    station: Floats
    weight: Floats


def offsets(shape: Shape, samples: Samples) -> Floats:
    """Distance of each sample from the curve (m, left positive)."""
    ux, uy = cos(shape.angle), sin(shape.angle)
    dx, dy = samples.x - shape.x, samples.y - shape.y
    xi, eta = dx * ux + dy * uy, dy * ux - dx * uy
    kappa = np.where(xi > 0.0, shape.after, shape.before)
    algebraic = eta - 0.5 * kappa * (xi * xi + eta * eta)
    radicand = np.maximum(1.0 - 2.0 * kappa * algebraic, 0.0)
    return 2.0 * algebraic / (1.0 + np.sqrt(radicand))


def line_and_arc(samples: Samples) -> tuple[Shape, Shape | None]:
    """Best line and best arc; None instead of an arc that the samples do not determine."""
    x, y, _, weight = samples
    sum_w = float(_sum(weight))
    wx = weight * x
    sum_xx = float(_sum(wx * x))
    slope = float(_sum(wx * y)) / sum_xx
    rest = y - slope * x
    w_rest = weight * rest
    misfit = float(_sum(w_rest * rest))
    line = Shape(0.0, 0.0, atan(slope), 0.0, 0.0, misfit / (1.0 + slope * slope), 2)
    phi = x * x + y * y
    w_phi = weight * phi
    sum_p, sum_xp, sum_pp = float(_sum(w_phi)), float(_sum(w_phi * x)), float(_sum(w_phi * phi))
    spread = sum_pp - sum_p * sum_p / sum_w - sum_xp * sum_xp / sum_xx
    if spread <= 1e-9 * sum_pp:
        return line, None
    cross = float(_sum(w_rest * phi))
    half = cross / spread
    tilt = slope - half * sum_xp / sum_xx
    offset = -half * sum_p / sum_w
    return line, _arc(offset, tilt, half, max(misfit - half * cross, 0.0))


def _arc(offset: float, slope: float, half: float, misfit: float) -> Shape | None:
    """Convert the circle y = offset + slope x + half (x² + y²) to a shape at the origin."""
    square = 1.0 + slope * slope - 4.0 * half * offset
    if square <= 0.0:
        return None
    gradient = sqrt(square)
    kappa, algebraic = 2.0 * half / gradient, -offset / gradient
    away = 2.0 * algebraic / (1.0 + sqrt(max(1.0 - 2.0 * kappa * algebraic, 0.0)))
    angle = atan(slope)
    return Shape(away * sin(angle), -away * cos(angle), angle, kappa, kappa, misfit / square, 3)


def best_joined(samples: Samples, joins: Floats) -> Shape | None:
    """Best line→arc or arc→line with its join at one of the stations `joins` (m)."""
    x, y, station, weight = samples
    count = len(joins)
    sum_w = float(_sum(weight))
    wx = weight * x
    sum_xx = float(_sum(wx * x))
    slope = float(_sum(wx * y)) / sum_xx
    rest = y - slope * x
    join_x, join_y = np.interp(joins, station, x), np.interp(joins, station, y)
    dx, dy = x - join_x[:, None], y - join_y[:, None]
    phi = np.empty((2 * count, len(x)))
    whole = dx * dx + dy * dy
    np.multiply(whole, station > joins[:, None], out=phi[:count])
    np.subtract(whole, phi[:count], out=phi[count:])
    w_phi = weight * phi
    sum_p, sum_xp = _sum(w_phi, 1), _sum(w_phi * x, 1)
    cross, sum_pp = _sum(w_phi * rest, 1), _sum(w_phi * phi, 1)
    spread = sum_pp - sum_p * sum_p / sum_w - sum_xp * sum_xp / sum_xx
    sound = spread > 1e-9 * sum_pp
    half = np.where(sound, cross, 0.0) / np.where(sound, spread, 1.0)
    tilt = slope - half * sum_xp / sum_xx
    misfit = (float(_sum(weight * rest * rest)) - half * cross) / (1.0 + tilt * tilt)
    best = int(np.argmin(np.where(sound, misfit, inf)))
    if not sound[best]:
        return None
    k, a, h = best % count, float(tilt[best]), float(half[best])
    px = float(join_x[k])
    py = a * px - h * float(sum_p[best]) / sum_w
    kappa = 2.0 * h / hypot(1.0, a)
    before, after = (0.0, kappa) if best < count else (kappa, 0.0)
    return Shape(px, py, atan(a), before, after, max(float(misfit[best]), 0.0), 4)


def refined(shape: Shape, samples: Samples, passes: int = 2) -> Shape:
    """Improve a two-piece `shape` by Gauss–Newton passes on offset, angle, curvature and join.

    The join stays within the samples, and the result is never worse than what was given.
    """
    first, last = float(samples.x[0]), float(samples.x[-1])
    moved = shape
    for _ in range(passes):
        step = _step(moved, samples)
        if step is None:
            break
        left, turn, bend, along = step
        reach = 0.25 * (last - first)
        along = min(max(along, -reach), reach)
        ux, uy = cos(moved.angle), sin(moved.angle)
        moved = moved._replace(
            x=moved.x + along * ux - left * uy,
            y=moved.y + along * uy + left * ux,
            angle=moved.angle + turn,
            before=moved.before + bend if moved.before else 0.0,
            after=moved.after + bend if moved.after else 0.0,
        )
        if not first < moved.x < last:
            return shape
    rest = offsets(moved, samples)
    misfit = float(_sum(samples.weight * rest * rest))
    return moved._replace(misfit=misfit) if misfit < shape.misfit else shape


def _step(shape: Shape, samples: Samples) -> list[float] | None:
    """Gauss–Newton step (left m, turn rad, bend 1/m, along m).

    With (ξ, η) in the frame of P, E changes by −(1 − κη) per shift of P to the left, by −ξ per
    turn of u, by −(ξ² + η²)/2 per curvature and by κξ per shift of P along u.
    """
    ux, uy = cos(shape.angle), sin(shape.angle)
    dx, dy = samples.x - shape.x, samples.y - shape.y
    xi, eta = dx * ux + dy * uy, dy * ux - dx * uy
    bent = xi > 0.0 if shape.before == 0.0 else xi <= 0.0
    kappa = (shape.after + shape.before) * bent
    half_square = 0.5 * (xi * xi + eta * eta)
    rows = np.empty((5, len(xi)))
    rows[0] = 1.0 - kappa * eta
    rows[1] = xi
    rows[2] = half_square * bent
    rows[3] = -kappa * xi
    rows[4] = eta - kappa * half_square
    sums = _sum((rows * samples.weight)[:, None, :] * rows, 2).tolist()
    return solved(sums[:4])


def solved(rows: list[list[float]]) -> list[float] | None:
    """Solve a symmetric positive system whose `rows` end with the right-hand side.

    By elimination; None if it is singular.
    """
    size = len(rows)
    rows = [list(row) for row in rows]
    scale = [row[k] for k, row in enumerate(rows)]
    for k, pivot_row in enumerate(rows):
        if not pivot_row[k] > 1e-12 * scale[k]:
            return None
        for row in rows[k + 1 :]:
            factor = row[k] / pivot_row[k]
            for column in range(k + 1, size + 1):
                row[column] -= factor * pivot_row[column]
    solution = [0.0] * size
    for k in range(size - 1, -1, -1):
        row = rows[k]
        known = sum(row[column] * solution[column] for column in range(k + 1, size))
        solution[k] = (row[size] - known) / row[k]
    return solution
