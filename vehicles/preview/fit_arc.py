"""Least squares for line, arc, line→arc and arc→line, in closed form (paper, Section III-A.1).

One equation serves all. Through a point P with unit tangent u and normal n (left), the arc of
curvature κ is the set of points q with

    E(q) = (q − P)·n − κ/2 |q − P|² = 0,

the paper's e(x, y) divided by −2R: exact for every circle, a line for κ = 0, and linear in offset,
slope and κ once P is given. On the curve its gradient has length one, so E is the distance to first
order, and the fit is not biased to small circles as one with e(x, y) itself is. Coordinates are
centred at the samples and turned along them (far from the origin the paper's equations are
ill-conditioned).

E is a combination of (x² + y², x, y, 1) for every κ, P and u. The sums of the products of these
four over the first k samples, for every k, are therefore all that is needed of the samples:
`FitData.sums`. All is elementwise arithmetic, so that no result depends on a linear-algebra
library. Curves with a join are in `fit_joined`.
"""

from math import atan, cos, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SQUARE, X, Y, ONE = range(4)
"""Places of x² + y², x, y and 1 in `FitData`."""
DETERMINED = 1e-9
"""Relative spread below which the samples do not determine an unknown."""


class LocalCurve(NamedTuple):
    """A curve of one or two pieces (arc spline of Section III-A) in the local frame.

    It passes the join P = (x, y) (m) with tangent `angle` (rad) and has the curvatures `before` and
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


class FitData(NamedTuple):
    """Samples of both sources (Section III-A) in the local frame, in order of travel.

    `rows` are x² + y², x, y and 1 with x along the travel, y left (m); station (m); weight.
    `sums[i, j, k]` is the weighted sum over the first k + 1 samples of row i times row j.
    """

    rows: Floats
    station: Floats
    weight: Floats
    sums: Floats


class Centred(NamedTuple):
    """Linear regression about the weighted mean: weight, means (m), xx (m²), slope, misfit (m²)."""

    weight: float
    mean_x: float
    mean_y: float
    xx: float
    slope: float
    misfit: float


def summed(x: Floats, y: Floats, station: Floats, weight: Floats) -> FitData:
    """Add up the products of (x² + y², x, y, 1) along the samples: what eq. (5) expands to."""
    rows = np.empty((4, len(x)))
    rows[X], rows[Y], rows[ONE] = x, y, 1.0
    np.multiply(x, x, out=rows[SQUARE])
    rows[SQUARE] += y * y
    sums = np.add.accumulate((rows * weight)[:, None, :] * rows, 2)
    return FitData(rows, station, weight, sums)


def offsets(curve: LocalCurve, data: FitData) -> Floats:
    """Distance of each sample from the curve (m, left positive), to first order.

    The e of Section III-A.1 divided by −2R, left turns having a positive R.
    """
    x, y, angle, before, after = curve[:5]
    ux, uy = cos(angle), sin(angle)
    dx, dy = data.rows[X] - x, data.rows[Y] - y
    eta: Floats = dy * ux
    eta -= dx * uy
    if before == after == 0.0:
        return eta
    sag: Floats = dx * dx
    sag += dy * dy
    sag *= 0.5 * (before or after)
    if before != after:
        dx *= ux
        dy *= -uy
        sag *= dx > dy if after else dx <= dy
    eta -= sag
    return eta


def centred(data: FitData) -> Centred | None:
    """Line through the samples by linear regression of y on x; None if they determine none."""
    total = data.sums[:, :, -1].tolist()
    weight = total[ONE][ONE]
    mean_x, mean_y = total[X][ONE] / weight, total[Y][ONE] / weight
    xx = total[X][X] - weight * mean_x * mean_x
    if not xx > DETERMINED * total[X][X]:
        return None
    xy = total[X][Y] - weight * mean_x * mean_y
    yy = total[Y][Y] - weight * mean_y * mean_y
    slope = xy / xx
    return Centred(weight, mean_x, mean_y, xx, slope, max(yy - slope * xy, 0.0))


def best_line(line: Centred) -> LocalCurve:
    """Give the line of least squares (linear regression; Section III-A joins two samples)."""
    misfit = line.misfit / (1.0 + line.slope * line.slope)
    return LocalCurve(line.mean_x, line.mean_y, atan(line.slope), 0.0, 0.0, misfit, 2)


def best_arc(data: FitData, line: Centred) -> LocalCurve | None:
    """Fit the arc of least squares; None unless three distinct samples determine it.

    Minimises J of eq. (5) with e divided by −2R, times a factor near one that `_arc` takes out
    again: three linear equations, as Section III-A.1 says.
    """
    total = data.sums[:, :, -1].tolist()
    row = total[SQUARE]
    cross_x = row[X] - line.mean_x * row[ONE]
    cross = row[Y] - line.mean_y * row[ONE] - line.slope * cross_x
    spread = row[SQUARE] - row[ONE] * row[ONE] / line.weight - cross_x * cross_x / line.xx
    if not spread > DETERMINED * row[SQUARE]:
        return None
    half = cross / spread
    slope = line.slope - half * cross_x / line.xx
    offset = line.mean_y - slope * line.mean_x - half * row[ONE] / line.weight
    return _arc(offset, slope, half, max(line.misfit - half * cross, 0.0))


def drift(arc: LocalCurve, data: FitData) -> float:
    """How far the distances from an arc add up (m, weighted), at most, along the samples.

    Those of noise alone cancel out sooner than those of a curve that is no arc (CUSUM statistic).
    """
    px, py, half = arc.x, arc.y, 0.5 * arc.after
    nx, ny = -sin(arc.angle), cos(arc.angle)
    equation = (
        -half,
        nx + 2.0 * half * px,
        ny + 2.0 * half * py,
        -(nx * px + ny * py) - half * (px * px + py * py),
    )
    sums = np.einsum("i,ik->k", equation, data.sums[:, ONE])
    return float(np.maximum.reduce(np.abs(sums)))


def _arc(offset: float, slope: float, half: float, misfit: float) -> LocalCurve | None:
    """Convert the circle y = offset + slope x + half (x² + y²) to a curve at the origin."""
    square = 1.0 + slope * slope - 4.0 * half * offset
    if not square > 0.0:
        return None
    gradient = sqrt(square)
    kappa, algebraic = 2.0 * half / gradient, -offset / gradient
    away = 2.0 * algebraic / (1.0 + sqrt(max(1.0 - 2.0 * kappa * algebraic, 0.0)))
    angle = atan(slope)
    return LocalCurve(
        away * sin(angle), -away * cos(angle), angle, kappa, kappa, misfit / square, 3
    )
