"""Margins of chosen gains: the largest ball of stabilising gains around them, and intervals.

Both use the boundary of `vehicles.theory.gain_sets` in closed form, not grids of gains or
frequencies.
"""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.gain_sets import crossing_equations, is_stabilising
from vehicles.theory.polynomials import stationary_points

Array = NDArray[np.float64]


class Ball(NamedTuple):
    """The largest ball of stabilising gains around chosen ones, which exists by Section V-A.

    `radius` in the chosen metric, `nearest` the gains where it touches the boundary, `frequency`
    (rad/s) of the root there (0: the plane k_e = 0), and the limiting speed (m/s).
    """

    radius: float
    nearest: Gains
    frequency: float
    speed: float


def stability_ball(
    parameters: VehicleParameters,
    speed: float,
    gains: Gains,
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> Ball:
    """Distance from `gains` to the boundary of the stabilising set at one speed.

    The metric is Euclidean on (k_e, k_theta, k_omega) / scale; with scale = gains the radius is a
    relative change of all gains. For each frequency the boundary is a line, so the squared distance
    is a ratio of polynomials in w². Its stationary points are roots of one polynomial, so the
    minimum is global. Relative accuracy 1e-6. Radius 0 if the gains do not stabilise. Paper,
    Section V-A (which gives no radius).
    """
    centre = np.array(gains)
    if not is_stabilising(parameters, speed, centre):
        return Ball(0.0, gains, float("nan"), speed)
    real, imaginary = crossing_equations(parameters, speed)
    weights = np.array(scale)
    at_centre = np.concatenate([[1.0], centre])
    residuals = [(equation * at_centre).sum(axis=1) for equation in (real, imaginary)]
    slopes = [equation[:, 1:] * weights for equation in (real, imaginary)]
    numerator, denominator = _squared_distance(residuals, slopes)
    best = Ball(gains.lateral / scale[0], Gains(0.0, gains.heading, gains.yaw_rate), 0.0, speed)
    for x in stationary_points(numerator, denominator):
        step = _shortest_step(residuals, slopes, float(x))
        radius = float(np.sqrt((step * step).sum()))
        if radius < best.radius:
            frequency = parameters.steering_frequency * float(np.sqrt(x))
            best = Ball(radius, Gains(*(centre + weights * step).tolist()), frequency, speed)
    return best


def _squared_distance(residuals: list[Array], slopes: list[Array]) -> tuple[Array, Array]:
    """Numerator and denominator in x of the squared distance to the boundary line."""

    def gram(i: int, j: int) -> Array:
        products = [np.polymul(slopes[i][:, k], slopes[j][:, k]) for k in range(3)]
        return np.asarray(np.polyadd(np.polyadd(products[0], products[1]), products[2]), float)

    pp, pq, qq = gram(0, 0), gram(0, 1), gram(1, 1)
    p, q = residuals
    squares = np.polyadd(np.polymul(qq, np.polymul(p, p)), np.polymul(pp, np.polymul(q, q)))
    numerator = np.polysub(squares, 2.0 * np.polymul(pq, np.polymul(p, q)))
    denominator = np.polysub(np.polymul(pp, qq), np.polymul(pq, pq))
    return np.asarray(numerator, float), np.asarray(denominator, float)


def _shortest_step(residuals: list[Array], slopes: list[Array], x: float) -> Array:
    """Shortest change of the scaled gains that moves a root to this frequency; shape (3,)."""
    p, q = (float(np.polyval(residual, x)) for residual in residuals)
    u, w = (np.array([np.polyval(rows[:, column], x) for column in range(3)]) for rows in slopes)
    uu, uw, ww = float((u * u).sum()), float((u * w).sum()), float((w * w).sum())
    determinant = uu * ww - uw * uw
    return np.asarray(-u * (p * ww - q * uw) / determinant - w * (q * uu - p * uw) / determinant)


def common_ball(
    cars: Sequence[VehicleParameters],
    speeds: Sequence[float],
    gains: Gains,
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> Ball:
    """Largest ball in the intersection over cars and speeds (Section V-A): the smallest of all."""
    balls = [stability_ball(car, speed, gains, scale) for car, speed in product(cars, speeds)]
    return min(balls, key=lambda ball: ball.radius)


def gain_interval(
    parameters: VehicleParameters, speed: float, gains: Gains, direction: tuple[float, float, float]
) -> tuple[float, float]:
    """Largest changes of the gains along `direction`, backward (negative) and forward.

    With (1, 0, 0) only k_e changes. On a line the two equations of the boundary share one unknown;
    eliminating it leaves a polynomial in w², whose roots are the candidates. The first candidate
    beyond which the loop is unstable ends the interval. Infinite without such a candidate; (0, 0)
    if the gains do not stabilise. The boundary is that of Section III-F.
    """
    centre, step = np.array(gains), np.array(direction)
    if not is_stabilising(parameters, speed, centre):
        return 0.0, 0.0
    moves = _crossings(parameters, speed, centre, step)
    if direction[0] != 0.0:
        moves.append(-gains.lateral / direction[0])
    limits = []
    for sign in (-1.0, 1.0):
        ahead = sorted(sign * move for move in moves if sign * move > 0.0)
        beyond = [*ahead[1:], 2.0 * ahead[-1]] if ahead else []
        probes = 0.5 * sign * (np.array(ahead) + np.array(beyond))
        stable = is_stabilising(parameters, speed, centre + probes[:, None] * step)
        ends = [move for move, inside in zip(ahead, stable, strict=True) if not inside]
        limits.append(sign * (ends[0] if ends else np.inf))
    return limits[0], limits[1]


def _crossings(
    parameters: VehicleParameters, speed: float, centre: Array, step: Array
) -> list[float]:
    """List values t for which centre + t step may have a root on the axis; some may be spurious."""
    real, imaginary = crossing_equations(parameters, speed)
    at_centre, along = np.concatenate([[1.0], centre]), np.concatenate([[0.0], step])
    fixed_p, fixed_q = ((equation * at_centre).sum(axis=1) for equation in (real, imaginary))
    slope_p, slope_q = ((equation * along).sum(axis=1) for equation in (real, imaginary))
    roots = np.roots(np.polysub(np.polymul(fixed_p, slope_q), np.polymul(fixed_q, slope_p))).real
    return [
        -float(np.polyval(fixed, x)) / slope
        for x in roots[roots > 0.0]
        for fixed, slopes in ((fixed_p, slope_p), (fixed_q, slope_q))
        if (slope := float(np.polyval(slopes, x))) != 0.0
    ]
