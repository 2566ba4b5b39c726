"""The set of feedback gains that stabilise the car: membership, boundary, extent, margin.

D-decomposition (paper, Section III-F): a root leaves the left half-plane only where Delta(0, K) = 0
or Delta(j w, K) = 0. The first is the plane k_e = 0. The second is linear in the gains: a line in
the space of (k_e, k_theta, k_omega) for each frequency; these lines form the other surface. A6 does
not depend on the gains, so there is no third boundary (a root at infinity).

Gains are arrays (..., 3) of (k_e in rad/m, k_theta, k_omega in s), or `Gains`. A set is defined for
a list of cars (loadings) and speeds (m/s): its members stabilise all of them. Polynomials are
coefficients in descending powers, as for numpy.roots.
"""

from collections.abc import Sequence
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.linear_model import (
    Array,
    affine_coefficients,
    characteristic_polynomial,
    closed_loop,
)

MILE_PER_HOUR = 0.44704  # m/s
PAPER_SPEEDS = tuple(mph * MILE_PER_HOUR for mph in (10, 20, 30, 40, 50, 60, 67))
"""The speeds (m/s) of Section V-A. The last is 29.95 m/s; the paper rounds it to 30."""


# ---- Membership


def is_hurwitz(coefficients: Array) -> NDArray[np.bool_]:
    """Whether all roots have negative real parts, by Routh's array (Routh-Hurwitz criterion).

    Maps shape (..., n + 1) to (...). A polynomial with a root on the imaginary axis (a zero in the
    first column) is not Hurwitz.
    """
    rows = np.ascontiguousarray(np.moveaxis(coefficients, -1, 0))
    rows = rows * np.sign(rows[0])
    upper, lower = rows[0::2], rows[1::2]
    stable = upper[0] > 0.0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for _ in range(len(rows) - 1):
            stable = stable & (lower[0] > 0.0)
            following = upper[1:].copy()
            following[: len(lower) - 1] -= upper[0] / lower[0] * lower[1:]
            upper, lower = lower, following
    return np.asarray(stable)


def spectral_abscissa(coefficients: Array) -> Array:
    """Largest real part of the roots, shape (..., n + 1) to (...), from companion matrices."""
    degree = coefficients.shape[-1] - 1
    companion = np.zeros((*coefficients.shape[:-1], degree, degree))
    companion[..., 0, :] = -coefficients[..., 1:] / coefficients[..., :1]
    companion[..., np.arange(1, degree), np.arange(degree - 1)] = 1.0
    return np.asarray(np.linalg.eigvals(companion).real.max(axis=-1))


def is_stabilising(parameters: VehicleParameters, speed: float, gains: Array) -> NDArray[np.bool_]:
    """Membership in the stabilising set at one speed, by Routh-Hurwitz; (..., 3) to (...).

    Paper, Section III-F. Agrees with the roots beyond 1e-9 of the steering frequency from zero.
    """
    return is_hurwitz(characteristic_polynomial(parameters, gains, speed))


def stabilises_all(
    cars: Sequence[VehicleParameters], speeds: Sequence[float], gains: Array
) -> NDArray[np.bool_]:
    """Membership in the intersection over cars and speeds (paper, Sections III-F and V-A)."""
    gains = np.asarray(gains, dtype=np.float64)
    flat = gains.reshape(-1, 3)
    remaining = np.arange(len(flat))  # indices of gains that stabilise all cases so far
    for car, speed in product(cars, speeds):
        remaining = remaining[is_stabilising(car, speed, flat[remaining])]
    inside = np.zeros(len(flat), dtype=np.bool_)
    inside[remaining] = True
    return inside.reshape(gains.shape[:-1])


def abscissa(parameters: VehicleParameters, gains: Gains, speeds: Sequence[float]) -> Array:
    """Largest real part (1/s) of the closed-loop roots at each speed (paper, eq. (8))."""
    rows = [characteristic_polynomial(parameters, gains, speed) for speed in speeds]
    return spectral_abscissa(np.array(rows))


def is_stable_over(
    parameters: VehicleParameters, gains: Gains, slowest: float, fastest: float, decay: float = 0.0
) -> bool:
    """Whether all roots lie left of -decay (1/s) at every constant speed of an interval (m/s).

    The hypothesis of Proposition 1 for the whole interval, not on a grid. Roots cross the line only
    at speeds at which two eigenvalues of A(1/v) + decay sum to zero, which are eigenvalues
    themselves (Kronecker sum). One speed is tested between each two of them, and both ends.
    """
    if not 0.0 < slowest <= fastest:
        raise ValueError(f"speeds must satisfy 0 < slowest <= fastest: {slowest}, {fastest}")
    constant, inverse_speed = closed_loop(parameters, gains)
    unit = np.eye(6)
    fixed, by_inverse = (
        np.kron(matrix, unit) + np.kron(unit, matrix)
        for matrix in (constant + decay * unit, inverse_speed)
    )
    try:
        critical = np.linalg.eigvals(-np.linalg.solve(fixed, by_inverse)).real
    except np.linalg.LinAlgError:  # a root that no speed moves
        return False
    inside = np.sort(critical[(slowest < critical) & (critical < fastest)]).tolist()
    between = [0.5 * (low + high) for low, high in pairwise([slowest, *inside, fastest])]
    probes = [slowest, *between, fastest]
    return bool((abscissa(parameters, gains, probes) < -decay).all())


def guaranteed_decay(
    parameters: VehicleParameters, gains: Gains, slowest: float, fastest: float
) -> float:
    """Decay sigma (1/s) of Proposition 1 over an interval of constant speeds (m/s).

    At most 1 % below the true value; 0 if the loop is not stable over the interval.
    """
    if not is_stable_over(parameters, gains, slowest, fastest):
        return 0.0
    low, high = 0.0, -float(abscissa(parameters, gains, (slowest, fastest)).max())
    while high - low > 0.005 * high:
        middle = 0.5 * (low + high)
        if is_stable_over(parameters, gains, slowest, fastest, middle):
            low = middle
        else:
            high = middle
    return low


# ---- Boundary


def crossing_equations(
    parameters: VehicleParameters, speed: float
) -> tuple[list[np.poly1d], list[np.poly1d]]:
    """Delta(j w, K) = 0 as two equations in x = (w / w_n)², linear in (1, k_e, k_theta, k_omega).

    Condition (b) of the D-decomposition in Section III-F: polynomials in x of the real part and of
    the imaginary part over w, four each, for the constant and the three gains. Each equation is
    scaled to a largest constant of one.
    """
    constant, slopes = affine_coefficients(parameters, speed)
    frequency_powers = parameters.steering_frequency ** np.arange(6.0, -1.0, -1.0)
    columns = np.column_stack([constant, slopes]) * frequency_powers[:, None]
    real = columns[0::2] * np.array([-1.0, 1.0, -1.0, 1.0])[:, None]
    imaginary = columns[1::2] * np.array([1.0, -1.0, 1.0])[:, None]
    real, imaginary = (rows / np.abs(rows[:, 0]).max() for rows in (real, imaginary))
    return [np.poly1d(row) for row in real.T], [np.poly1d(row) for row in imaginary.T]


# ---- Extent


WALKERS, ROUNDS = 2000, 60  # Points that explore a set, and their steps
LARGEST = 1e6  # A set with greater gains counts as unbounded
SPREAD = np.array(list(product((-1.0, -0.5, 0.0, 0.5, 1.0), repeat=3)))  # Directions of the search


def members(cars: Sequence[VehicleParameters], speeds: Sequence[float]) -> Array:
    """Gains spread evenly over the intersection over cars and speeds (Section V-A); shape (n, 3).

    A random walk (Metropolis) whose steps have the covariance of its points, so that it also fills
    thin wedges: at low speed the set lies along the plane b k_e + k_theta = 0, because A1 > 0. It
    starts at small gains. Raises ValueError if none of them stabilises, or without a bound.
    """
    random = np.random.default_rng(0)
    size, share, turn = 10.0 ** -random.uniform(0.0, 3.0, WALKERS), *random.random((2, WALKERS))
    start = np.column_stack([0.2 * share * size * size, size, 0.1 * (turn - 0.5) * size])
    start = start[stabilises_all(cars, speeds, start)]
    if not len(start):
        raise ValueError("no stabilising gains found")
    points = random.choice(start, WALKERS)
    for _ in range(ROUNDS):
        ahead = points + random.multivariate_normal(np.zeros(3), np.cov(points.T), WALKERS)
        points = np.where(stabilises_all(cars, speeds, ahead)[:, None], ahead, points)
    if np.abs(points).max() > LARGEST:
        raise ValueError("no bounds of the stabilising gains found")
    return points


def gain_extremes(
    cars: Sequence[VehicleParameters], speeds: Sequence[float]
) -> tuple[tuple[Gains, Gains], ...]:
    """Members of the intersection with the smallest and the largest k_e, k_theta and k_omega.

    Extent of the stabilising set of Section V-A, shown at one speed in Fig. 6. As its tips are
    thin, the search moves from the outermost `members` to better ones, until there is none within
    1e-5 of the extent. The set extends at most 1 or 2 % further. Raises ValueError as `members`.
    """
    inner = members(cars, speeds)
    extent = np.ptp(inner, axis=0)

    def furthest(axis: int, side: float) -> Gains:
        best, reach = inner[np.argmax(side * inner[:, axis])], 0.1
        while reach > 1e-5:
            steps = np.concatenate([reach * 0.3**k * SPREAD for k in range(6)]) * extent
            ahead = best + steps[side * steps[:, axis] > 1e-5 * extent[axis]]
            inside = ahead[stabilises_all(cars, speeds, ahead)]
            if len(inside):
                best = inside[np.argmax(side * inside[:, axis])]
            else:
                reach *= 0.6
        return Gains(*best.tolist())

    return tuple((furthest(axis, -1.0), furthest(axis, 1.0)) for axis in range(3))


def non_convex_pair(
    cars: Sequence[VehicleParameters], speeds: Sequence[float]
) -> tuple[Gains, Gains] | None:
    """Find two stabilising gains whose midpoint does not stabilise: proof of a non-convex set.

    Section V-A states this for the paper's car. Of all pairs of 200 `members`, the one whose
    midpoint is the most unstable; None if there is no pair.
    """
    inside = members(cars, speeds)[:200]
    middle = 0.5 * (inside[:, None, :] + inside[None, :, :])
    first, second = np.nonzero(~stabilises_all(cars, speeds, middle))
    if not len(first):
        return None
    outside = middle[first, second]
    cases = [characteristic_polynomial(car, outside, speed) for car, speed in product(cars, speeds)]
    pick = int(np.argmax(spectral_abscissa(np.array(cases)).max(axis=0)))
    return Gains(*inside[first[pick]].tolist()), Gains(*inside[second[pick]].tolist())


# ---- Margin of chosen gains, in closed form: the largest ball around them


class Ball(NamedTuple):
    """The largest ball of stabilising gains around chosen ones, which exists by Section V-A.

    `radius` in the chosen metric, `nearest` the gains where it touches the boundary, `frequency`
    (rad/s) of the root there (0: the plane k_e = 0), and the limiting speed (m/s).
    """

    radius: float
    nearest: Gains
    frequency: float
    speed: float


def stationary_points(numerator: np.poly1d, denominator: np.poly1d) -> Array:
    """Candidates on x > 0 for stationary points of numerator / denominator; none is missed.

    The real parts of all roots of N' D - N D' (quotient rule) in the right half-plane, if any.
    Callers take the extreme of the ratio, so spurious candidates are harmless.
    """
    slope = numerator.deriv() * denominator - numerator * denominator.deriv()
    candidates = slope.roots.real
    return np.asarray(candidates[candidates > 0.0], dtype=np.float64)


def stability_ball(
    parameters: VehicleParameters,
    speed: float,
    gains: Gains,
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> Ball:
    """Distance from `gains` to the boundary of the stabilising set at one speed.

    The metric is Euclidean on (k_e, k_theta, k_omega) / scale; with scale = gains the radius is a
    relative change of all gains. For each frequency the boundary is a line, and the squared
    distance a ratio of polynomials in w², so its minimum is global. Relative accuracy 1e-6. Radius
    0 if the gains do not stabilise. Paper, Section V-A (which gives no radius).
    """
    if not is_stabilising(parameters, speed, np.array(gains)):
        return Ball(0.0, gains, float("nan"), speed)
    equations = crossing_equations(parameters, speed)
    p, q = (_dot(equation, (1.0, *gains)) for equation in equations)
    u, w = ([a * k for a, k in zip(rest, scale, strict=True)] for _, *rest in equations)
    uu, uw, ww = (_dot(*pair) for pair in ((u, u), (u, w), (w, w)))
    determinant = uu * ww - uw * uw
    best = Ball(gains.lateral / scale[0], Gains(0.0, gains.heading, gains.yaw_rate), 0.0, speed)
    for x in stationary_points(p * p * ww + q * q * uu - p * q * uw * 2.0, determinant):
        # The shortest step of the scaled gains that moves a root to this frequency.
        by_u, by_w = (q * uw - p * ww)(x), (p * uw - q * uu)(x)
        step = [(by_u * a(x) + by_w * b(x)) / determinant(x) for a, b in zip(u, w, strict=True)]
        radius = float(np.sqrt(sum(part * part for part in step)))
        if radius < best.radius:
            nearest = (k + s * part for k, s, part in zip(gains, scale, step, strict=True))
            frequency = parameters.steering_frequency * float(np.sqrt(x))
            best = Ball(radius, Gains(*map(float, nearest)), frequency, speed)
    return best


def _dot(left: Sequence[np.poly1d], right: Sequence[np.poly1d | float]) -> np.poly1d:
    total = np.poly1d([0.0])
    for one, other in zip(left, right, strict=True):
        total += one * other
    return total


def common_ball(
    cars: Sequence[VehicleParameters],
    speeds: Sequence[float],
    gains: Gains,
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> Ball:
    """Largest ball in the intersection over cars and speeds (Section V-A): the smallest of all."""
    balls = [stability_ball(car, speed, gains, scale) for car, speed in product(cars, speeds)]
    return min(balls, key=lambda ball: ball.radius)
