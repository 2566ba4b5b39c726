"""The paper's own trajectory: a straight line if the samples pass its test, else one circle.

Section III-B joins the first and the last sample of the preview by a line L. If all samples lie
within 10 cm of L the trajectory is straight, else the circle that minimises J of eq. (5). Section
III-A instead keeps the longest straight prefix and fits the circle to the rest, which swallows
arcs. Both are implemented for comparison with `curve_fit`.

Departures: samples are in order of travel. They are centred, rotated along L and scaled, because
the three linear equations are ill-conditioned far from the origin. The circle has a sign. The
heading is that of the fitted line or circle, not of the two closest samples, which can lie side by
side.
"""

from math import atan2, cos, hypot, inf, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.arc_spline import ArcSpline, Piece
from vehicles.preview.curve_fit import Curve, FitSettings

Floats = NDArray[np.float64]
_sum = np.add.reduce

PREFIX_LEAST = 3  # The k ≥ 3 of Section III-A: least number of samples of a straight prefix
DETERMINED = 1e-12  # Below this share of the squared spread the samples do not determine a circle


def recipe_curve(
    east: Floats, north: Floats, station: Floats, weight: Floats | None, settings: FitSettings
) -> Curve | None:
    """Line or circle of Section III-B through samples (world, m) in order of `station` (m).

    `weight` are the weights in J of eq. (5), one each if None; `settings.tolerance` is the paper's
    10 cm. The trajectory `paper_prefix` first splits off the longest straight prefix of Section
    III-A. None with fewer than three samples, travel shorter than `span_min`, or equal first and
    last positions.
    """
    if len(station) < PREFIX_LEAST or station.item(-1) - station.item(0) < settings.span_min:
        return None
    weight = np.ones(len(station)) if weight is None else weight
    origin_east, origin_north = east.item(0), north.item(0)
    ux, uy = east.item(-1) - origin_east, north.item(-1) - origin_north
    chord = hypot(ux, uy)
    if not 0.0 < chord < inf:
        return None
    ux, uy = ux / chord, uy / chord
    dx, dy = east - origin_east, north - origin_north
    x, y = dx * ux + dy * uy, dy * ux - dx * uy  # along L and left of it
    if float(np.maximum.reduce(np.abs(y))) < settings.tolerance:
        pieces = _line(x, y, weight)
    elif settings.trajectory == "paper_prefix":
        pieces = _split(x, y, weight, _straight_prefix(x, y, settings.tolerance))
    else:
        pieces = _circle(x, y, weight)
    offsets = _offsets(pieces[0], x, y)
    if len(pieces) > 1:
        beyond = x > pieces[1].east
        offsets[beyond] = _offsets(pieces[1], x[beyond], y[beyond])
    rms = sqrt(float(_sum(weight * offsets * offsets)) / float(_sum(weight)))
    turned = atan2(uy, ux)
    world = ArcSpline(
        tuple(
            Piece(
                origin_east + piece.east * ux - piece.north * uy,
                origin_north + piece.east * uy + piece.north * ux,
                turned + piece.yaw,
                piece.curvature,
                piece.length,
            )
            for piece in pieces
        )
    )
    return Curve(world, offsets, rms)


def circle_of_least_squares(
    x: Floats, y: Floats, weight: Floats
) -> tuple[float, float, float] | None:
    """Centre and radius (X_c, Y_c, R) (m) that minimise J of eq. (5); None if undetermined.

    Three linear equations in X_c, Y_c and R² − X_c² − Y_c² (Section III-A.1). About the weighted
    mean the third one decouples; lengths are divided by the spread of the samples.
    """
    total = float(_sum(weight))
    mean_x, mean_y = float(_sum(weight * x)) / total, float(_sum(weight * y)) / total
    dx, dy = x - mean_x, y - mean_y
    size = sqrt(float(_sum(weight * (dx * dx + dy * dy))) / total)
    if not size > 0.0:
        return None
    dx, dy = dx / size, dy / size
    square = dx * dx + dy * dy
    xx, xy, yy = (float(_sum(weight * product)) / total for product in (dx * dx, dx * dy, dy * dy))
    right_x = 0.5 * float(_sum(weight * dx * square)) / total
    right_y = 0.5 * float(_sum(weight * dy * square)) / total
    determinant = xx * yy - xy * xy
    if not determinant > DETERMINED:
        return None
    centre_x = (right_x * yy - right_y * xy) / determinant
    centre_y = (right_y * xx - right_x * xy) / determinant
    radius = sqrt(centre_x * centre_x + centre_y * centre_y + 1.0)  # the mean square is 1
    return mean_x + size * centre_x, mean_y + size * centre_y, size * radius


def _line(x: Floats, y: Floats, weight: Floats) -> tuple[Piece, ...]:
    total = float(_sum(weight))
    mean_x, mean_y = float(_sum(weight * x)) / total, float(_sum(weight * y)) / total
    dx = x - mean_x
    spread = float(_sum(weight * dx * dx))
    slope = float(_sum(weight * dx * y)) / spread if spread > 0.0 else 0.0
    line = Piece(mean_x, mean_y, atan2(slope, 1.0), 0.0, 0.0)
    return (_between(line, x, y),)


def _circle(x: Floats, y: Floats, weight: Floats) -> tuple[Piece, ...]:
    """Circle of eq. (5) in the direction of travel; a line if undetermined.

    The chord of an arc has the direction of the tangent at its middle, which distinguishes left
    from right turns.
    """
    circle = circle_of_least_squares(x, y, weight)
    if circle is None:
        return _line(x, y, weight)
    centre_x, centre_y, radius = circle
    middle = len(x) // 2
    out_x, out_y = x.item(middle) - centre_x, y.item(middle) - centre_y
    away = hypot(out_x, out_y)
    if not away > 0.0:
        return _line(x, y, weight)
    side = 1.0 if out_y < 0.0 else -1.0  # a left turn has its centre to the left
    out_x, out_y = out_x / away, out_y / away
    arc = Piece(
        centre_x + radius * out_x,
        centre_y + radius * out_y,
        atan2(side * out_x, -side * out_y),
        side / radius,
        0.0,
    )
    return (_between(arc, x, y),)


def _between(piece: Piece, x: Floats, y: Floats) -> Piece:
    start = piece.project(x.item(0), y.item(0)).station
    end = piece.project(x.item(-1), y.item(-1)).station
    begin = piece.at(start)
    return Piece(begin.east, begin.north, begin.yaw, piece.curvature, max(end - start, 0.0))


def _offsets(piece: Piece, x: Floats, y: Floats) -> Floats:
    """Distances (m, left positive) from a line or arc, as by `Piece.project`."""
    forward, left = cos(piece.yaw), sin(piece.yaw)
    dx, dy = x - piece.east, y - piece.north
    xi, eta = dx * forward + dy * left, dy * forward - dx * left
    kappa = piece.curvature
    u, w = 1.0 - kappa * eta, kappa * xi
    offsets: Floats = 2.0 * eta - kappa * (xi * xi + eta * eta)
    offsets /= 1.0 + np.sqrt(u * u + w * w)
    return offsets


def _straight_prefix(x: Floats, y: Floats, tolerance: float) -> int:
    """Number of samples in the longest straight prefix (Section III-A); 0 if there is none."""
    for count in range(len(x) - 1, PREFIX_LEAST - 1, -1):
        dx, dy = x[:count] - x.item(0), y[:count] - y.item(0)
        chord = hypot(dx.item(-1), dy.item(-1))
        across = np.abs(dy * dx.item(-1) - dx * dy.item(-1))
        if chord > 0.0 and float(np.maximum.reduce(across)) <= tolerance * chord:
            return count
    return 0


def _split(x: Floats, y: Floats, weight: Floats, count: int) -> tuple[Piece, ...]:
    """Line through the first `count` samples, continued with the curvature of the rest."""
    if count < PREFIX_LEAST:
        return _circle(x, y, weight)
    (line,) = _line(x[:count], y[:count], weight[:count])
    if len(x) - count < PREFIX_LEAST:
        return (line,)
    (rest,) = _circle(x[count:], y[count:], weight[count:])
    end = line.at(line.length)
    return line, Piece(end.east, end.north, end.yaw, rest.curvature, rest.length)
