"""The set of feedback gains that stabilise the car: membership, boundary, extent.

D-decomposition (paper, Section III-F): a root leaves the left half-plane only where Delta(0, K) = 0
or Delta(j w, K) = 0. The first is the plane k_e = 0. The second is linear in the gains: a line in
the space of (k_e, k_theta, k_omega) for each frequency; these lines form the other surface. A6 does
not depend on the gains, so there is no third boundary (a root at infinity).

Gains are arrays (..., 3) of (k_e in rad/m, k_theta, k_omega in s), or `Gains`. A set is defined for
a list of cars (loadings) and speeds (m/s): its members stabilise all of them.
"""

from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise, product
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.linear_model import affine_coefficients, closed_loop_at

# ---- Polynomials of a closed loop: Hurwitz stability, and stationary points of a ratio
#
# Floating-point polynomials are arrays of coefficients in descending powers, as for numpy.roots.
# Exact polynomials are tuples of fractions in ascending powers.


Array = NDArray[np.float64]
Exact = tuple[Fraction, ...]  # A polynomial with rational coefficients, constant term first
DEEPEST_SUBDIVISION = 40  # Number of bisections after which an exact positivity check returns False


def is_hurwitz(coefficients: Array) -> NDArray[np.bool_]:
    """Whether all roots have negative real parts, by Routh's array (Routh-Hurwitz criterion).

    Maps shape (..., n + 1) to (...). A polynomial with a root on the imaginary axis (a zero in the
    first column) is not Hurwitz.
    """
    count = coefficients.shape[-1]
    sign = np.sign(coefficients[..., 0])
    columns = [np.asarray(coefficients[..., k] * sign, dtype=np.float64) for k in range(count)]
    upper, lower = columns[0::2], columns[1::2]
    stable = upper[0] > 0.0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for _ in range(count - 1):
            stable = stable & (lower[0] > 0.0)
            ratio = upper[0] / lower[0]
            following = [
                above - ratio * below for above, below in zip(upper[1:], lower[1:], strict=False)
            ]
            upper, lower = lower, following + upper[1 + len(following) :]
    return np.asarray(stable)


def spectral_abscissa(coefficients: Array) -> Array:
    """Largest real part of the roots, shape (..., n + 1) to (...), from companion matrices."""
    degree = coefficients.shape[-1] - 1
    companion = np.zeros((*coefficients.shape[:-1], degree, degree))
    companion[..., 0, :] = -coefficients[..., 1:] / coefficients[..., :1]
    companion[..., np.arange(1, degree), np.arange(degree - 1)] = 1.0
    return np.asarray(np.linalg.eigvals(companion).real.max(axis=-1))


def squared_magnitude(polynomial: Array) -> Array:
    """|p(j w)|² as a polynomial in x = w²: p(s) p(-s) has even powers only, and s² = -x.

    The inverse of spectral factorisation.
    """
    powers = np.arange(len(polynomial))[::-1]
    product = np.convolve(polynomial, polynomial * (-1.0) ** powers)[::2]
    return np.asarray(product * (-1.0) ** powers)


def stationary_points(numerator: Array, denominator: Array) -> Array:
    """Candidates on x > 0 for stationary points of numerator / denominator; none is missed.

    The real parts of all roots of N' D - N D' (quotient rule) in the right half-plane. Callers
    evaluate the ratio and take the extreme, so spurious candidates are harmless and no tolerance
    is needed to distinguish real roots. The array may be empty.
    """
    slope: Array = np.polysub(
        np.polymul(np.polyder(numerator), denominator),
        np.polymul(numerator, np.polyder(denominator)),
    )
    candidates = np.roots(slope).real
    return np.asarray(candidates[candidates > 0.0])


def multiply(left: Exact, right: Exact) -> Exact:
    """Product of two exact polynomials (Cauchy product)."""
    product = [Fraction(0)] * (len(left) + len(right) - 1)
    for i, factor in enumerate(left):
        for j, other in enumerate(right):
            product[i + j] += factor * other
    return tuple(product)


def add(left: Exact, right: Exact, factor: int = 1) -> Exact:
    """Sum left + factor * right, exactly (elementary algebra)."""
    length = max(len(left), len(right))
    a = left + (Fraction(0),) * (length - len(left))
    b = right + (Fraction(0),) * (length - len(right))
    return tuple(p + factor * q for p, q in zip(a, b, strict=True))


def is_positive_between(polynomial: Exact, low: Fraction, high: Fraction) -> bool:
    """Whether polynomial(x) > 0 for every x in [low, high], proven in exact arithmetic.

    Bernstein coefficients on an interval bound the polynomial from below; the first and last are
    its end values. If they do not decide, the interval is halved (de Casteljau). False if the
    polynomial touches zero within 2^-40 of the interval.
    """
    degree = len(polynomial) - 1
    moved = _affine_argument(polynomial, low, high - low)
    bernstein = [
        sum((Fraction(comb(i, k), comb(degree, k)) * moved[k] for k in range(i + 1)), Fraction(0))
        for i in range(degree + 1)
    ]
    pending = [(bernstein, 0)]
    while pending:
        values, depth = pending.pop()
        if min(values) > 0:
            continue
        if values[0] <= 0 or values[-1] <= 0 or depth == DEEPEST_SUBDIVISION:
            return False
        pending.extend((half, depth + 1) for half in _halves(values))
    return True


def _affine_argument(polynomial: Exact, offset: Fraction, factor: Fraction) -> Exact:
    """Coefficients of polynomial(offset + factor t) in t."""
    result: Exact = (Fraction(0),)
    for coefficient in reversed(polynomial):
        result = add(multiply(result, (offset, factor)), (coefficient,))
    return result[: len(polynomial)]


def _halves(values: Sequence[Fraction]) -> tuple[list[Fraction], list[Fraction]]:
    """Split Bernstein coefficients at the middle of their interval (de Casteljau)."""
    left, right, row = [], [], list(values)
    while row:
        left.append(row[0])
        right.append(row[-1])
        row = [(p + q) / 2 for p, q in pairwise(row)]
    return left, right[::-1]


def hurwitz_minors(coefficients: Sequence[Exact]) -> list[Exact]:
    """Leading minors of Hurwitz's matrix of a polynomial in s whose coefficients depend on x.

    `coefficients` are in descending powers of s. They are exact polynomials in x, and so are the
    minors, of order 1 to n - 1. With a positive first and last coefficient, all roots lie in the
    open left half-plane if and only if all minors are positive (Hurwitz's criterion).
    """
    degree = len(coefficients) - 1
    zero: Exact = (Fraction(0),)
    matrix = [
        [
            coefficients[2 * column - row + 1] if 0 <= 2 * column - row + 1 <= degree else zero
            for column in range(degree - 1)
        ]
        for row in range(degree - 1)
    ]
    return [_determinant([row[:order] for row in matrix[:order]]) for order in range(1, degree)]


def shifted(coefficients: Sequence[Exact], decay: Fraction) -> list[Exact]:
    """Coefficients of p(s - decay), which is Hurwitz if all roots of p lie left of -decay.

    By Horner's scheme, in exact arithmetic.
    """
    result: list[Exact] = []
    for coefficient in coefficients:
        lowered = [multiply(term, (-decay,)) for term in result]
        result = [
            add(*pair)
            for pair in zip([*result, coefficient], [(Fraction(0),), *lowered], strict=True)
        ]
    return result


def _determinant(rows: list[list[Exact]]) -> Exact:
    """Laplace expansion along the first row; the matrices are sparse, and at most 5 by 5."""
    if len(rows) == 1:
        return rows[0][0]
    total: Exact = (Fraction(0),)
    for column, entry in enumerate(rows[0]):
        if not any(entry):
            continue
        minor = [row[:column] + row[column + 1 :] for row in rows[1:]]
        total = add(total, multiply(entry, _determinant(minor)), -1 if column % 2 else 1)
    return total


# ---- Gain sets


MILE_PER_HOUR = 0.44704  # m/s
PAPER_SPEEDS = tuple(mph * MILE_PER_HOUR for mph in (10, 20, 30, 40, 50, 60, 67))
"""The speeds (m/s) of Section V-A. The last is 29.95 m/s; the paper rounds it to 30."""


def _coefficients(parameters: VehicleParameters, speed: float, gains: Array) -> Array:
    """A6...A0 for gains (..., 3); shape (..., 7)."""
    constant, slopes = affine_coefficients(parameters, speed)
    lateral, heading, yaw_rate = (gains[..., k : k + 1] * slopes[:, k] for k in range(3))
    return np.asarray(constant + (lateral + heading + yaw_rate))


def is_stabilising(parameters: VehicleParameters, speed: float, gains: Array) -> NDArray[np.bool_]:
    """Membership in the stabilising set at one speed, by Routh-Hurwitz; (..., 3) to (...).

    Paper, Section III-F. Agrees with the roots themselves wherever the spectral abscissa is further
    than 1e-9 of the steering frequency from zero.
    """
    return is_hurwitz(_coefficients(parameters, speed, np.asarray(gains, dtype=np.float64)))


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
    rows = [_coefficients(parameters, speed, np.array(gains)) for speed in speeds]
    return spectral_abscissa(np.array(rows))


def singular_frequency(parameters: VehicleParameters) -> float | None:
    """Frequency (rad/s) at which the boundary in a (k_e, k_theta) plane is at infinity, if any.

    The determinant of the two equations of `boundary_curve` (Section III-F) is proportional to
    C_r (a + b) + (m a b - I_z) w², whatever the speed; it vanishes if I_z > m a b. The paper's car
    has I_z just below m a b (they differ by 0.01 %); I_z of most loaded cars is above it.
    """
    excess = (
        parameters.yaw_inertia
        - parameters.mass * parameters.front_axle_distance * parameters.rear_axle_distance
    )
    if excess <= 0.0:
        return None
    return float(np.sqrt(parameters.rear_cornering_stiffness * parameters.wheelbase / excess))


def crossing_equations(parameters: VehicleParameters, speed: float) -> tuple[Array, Array]:
    """Delta(j w, K) = 0 as two equations in x = (w / w_n)², linear in (1, k_e, k_theta, k_omega).

    Condition (b) of the D-decomposition in Section III-F. Coefficients in descending powers of x:
    real part (4, 4), imaginary part over w (3, 4); columns are the constant and the three gains.
    Each equation is scaled to a largest constant of one.
    """
    constant, slopes = affine_coefficients(parameters, speed)
    frequency_powers = parameters.steering_frequency ** np.arange(6.0, -1.0, -1.0)
    columns = np.column_stack([constant, slopes]) * frequency_powers[:, None]
    real = columns[0::2] * np.array([-1.0, 1.0, -1.0, 1.0])[:, None]
    imaginary = columns[1::2] * np.array([1.0, -1.0, 1.0])[:, None]
    return real / np.abs(real[:, 0]).max(), imaginary / np.abs(imaginary[:, 0]).max()


def boundary_curve(
    parameters: VehicleParameters, speed: float, yaw_rate_gain: float, frequencies: Array
) -> Array:
    """Gains (k_e, k_theta) with a root at j w for each frequency (rad/s) > 0; shape (n, 2).

    Paper, Section III-F: Delta(j w, K) = 0 at fixed k_omega, two linear equations solved in closed
    form. Rows are NaN at the singular frequency, where the equations have no solution. The line
    k_e = 0 completes the boundary.
    """
    real, imaginary = crossing_equations(parameters, speed)
    x = (np.asarray(frequencies) / parameters.steering_frequency) ** 2
    p, q = _rows(real, x), _rows(imaginary, x)
    determinant = p[1] * q[2] - p[2] * q[1]
    scale = np.abs(p[1] * q[2]) + np.abs(p[2] * q[1])
    determinant = np.where(np.abs(determinant) > 1e-12 * scale, determinant, np.nan)
    right_p, right_q = -p[0] - p[3] * yaw_rate_gain, -q[0] - q[3] * yaw_rate_gain
    lateral = (right_p * q[2] - p[2] * right_q) / determinant
    heading = (p[1] * right_q - right_p * q[1]) / determinant
    return np.column_stack([lateral, heading])


def _rows(equation: Array, x: Array) -> Array:
    """Evaluate the four columns of an equation at each x; shape (4, n)."""
    return np.array([np.polyval(equation[:, column], x) for column in range(4)])


def gain_box(
    cars: Sequence[VehicleParameters], speeds: Sequence[float], points: int = 24
) -> tuple[tuple[float, float], ...]:
    """Rough bounds of k_e, k_theta and k_omega around the intersection over cars and speeds.

    The set of Section V-A, searched on grids that grow while members are on their outer faces and
    otherwise shrink to the members. The result is accurate to a cell (about 1/20 of the extent) and
    widened by one; tips thinner than a cell may stick out (see `gain_extremes`). The grid is skew,
    along b k_e + k_theta, because A1 > 0 makes the set at low speed a thin wedge along that plane.
    Raises ValueError if no member is found or the set is not bounded by any grid.
    """
    skew = min(car.rear_axle_distance for car in cars)
    low, high = np.array([0.0, 0.0, -0.5]), np.array([0.5, 2.0, 0.5])
    for attempt in range(48):
        axes = [np.linspace(low[k], high[k], points) for k in range(3)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        grid[..., 1] -= skew * grid[..., 0]
        inside = stabilises_all(cars, speeds, grid)
        if not inside.any():
            break
        indices = [np.flatnonzero(inside.any(axis=tuple({0, 1, 2} - {k}))) for k in range(3)]
        first, last = np.array([i[0] for i in indices]), np.array([i[-1] for i in indices])
        cell = (high - low) / (points - 1)
        short, long = (first == 0) & (low != 0.0), last == points - 1
        if not (short.any() or long.any()) and (last - first >= points - 6)[[0, 2]].all():
            corners = grid[inside]
            margin = cell + np.array([0.0, skew * cell[0], 0.0])
            bounds = (corners.min(axis=0) - margin, corners.max(axis=0) + margin)
            return tuple(zip(*(bound.tolist() for bound in bounds), strict=True))
        start = low
        step = 0.5 * (high - low) if attempt < 8 else 4.0 * cell
        shrunk = np.where(low == 0.0, 0.0, low + np.maximum(first - 2, 0) * cell)
        low = np.where(short, low - step, shrunk)
        high = np.where(long, high + step, start + np.minimum(last + 2, points - 1) * cell)
    raise ValueError("no stabilising gains found, or no bounds of them")


SPREAD = np.array(list(product((-1.0, -0.5, 0.0, 0.5, 1.0), repeat=3)))  # Directions of the search


def gain_extremes(
    cars: Sequence[VehicleParameters], speeds: Sequence[float]
) -> tuple[tuple[Gains, Gains], ...]:
    """Members of the intersection with the smallest and the largest k_e, k_theta and k_omega.

    Extent of the stabilising set of Section V-A, shown at one speed in Fig. 6. The set has tips
    thinner than a cell of any grid. So the search starts from the outermost members of `gain_box`
    and moves to better ones at several distances, until there is none within 1e-5 of the box. All
    six results are members; the set extends at most 1 or 2 % further. Raises ValueError as
    `gain_box` does.
    """
    low, high = np.array(gain_box(cars, speeds)).T
    axes = [np.linspace(low[k], high[k], 24) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    members = grid[stabilises_all(cars, speeds, grid)]
    if not len(members):
        raise ValueError("the set of stabilising gains is too thin to find its extent")
    pairs = []
    for axis in range(3):
        least, most = members[members[:, axis].argmin()], members[members[:, axis].argmax()]
        climbed = [
            _climbed(cars, speeds, end, side * np.eye(3)[axis], high - low)
            for end, side in ((least, -1.0), (most, 1.0))
        ]
        pairs.append((Gains(*climbed[0].tolist()), Gains(*climbed[1].tolist())))
    return tuple(pairs)


def _climbed(
    cars: Sequence[VehicleParameters],
    speeds: Sequence[float],
    start: Array,
    direction: Array,
    extent: Array,
) -> Array:
    """Move from a member to members further along `direction`; shapes (3,)."""
    best, reach = start, 0.1
    while reach > 1e-5:
        steps = np.concatenate([reach * 0.3**k * SPREAD for k in range(6)]) * extent
        ahead = best + steps[(steps * direction).sum(axis=1) > 0.0]
        inside = ahead[stabilises_all(cars, speeds, ahead)]
        if len(inside):
            best = inside[int(np.argmax((inside * direction).sum(axis=1)))]
        else:
            reach *= 0.6
    return best


def non_convex_pair(
    cars: Sequence[VehicleParameters], speeds: Sequence[float], points: int = 10
) -> tuple[Gains, Gains] | None:
    """Find two stabilising gains whose midpoint does not stabilise: proof of a non-convex set.

    Section V-A states this for the paper's car. Searches all pairs of members of a grid and returns
    the pair whose midpoint is the most unstable; None if there is no pair.
    """
    axes = [np.linspace(low, high, points + 2)[1:-1] for low, high in gain_box(cars, speeds)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = grid[stabilises_all(cars, speeds, grid)]
    middle = 0.5 * (inside[:, None, :] + inside[None, :, :])
    outside = ~stabilises_all(cars, speeds, middle)
    if not outside.any():
        return None
    first, second = np.nonzero(outside)
    worst = np.max(
        [
            spectral_abscissa(_coefficients(car, speed, middle[first, second]))
            for car, speed in product(cars, speeds)
        ],
        axis=0,
    )
    pick = int(np.argmax(worst))
    return Gains(*inside[first[pick]].tolist()), Gains(*inside[second[pick]].tolist())


# ---- Margins of chosen gains: the largest ball of stabilising gains around them, and intervals
#
# Both use the boundary of `vehicles.theory.gain_sets` in closed form, not grids of gains or
# frequencies.


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


# ---- Stability at every constant speed of an interval, proven in exact arithmetic (Proposition 1)
#
# The paper checks seven speeds and argues by continuity, which proves nothing between them. Here
# Hurwitz's minors are polynomials in gamma = 1/v with rational coefficients. Their signs over the
# whole interval are determined without rounding.


def exact_coefficients(parameters: VehicleParameters, gains: Gains) -> list[Exact]:
    """Coefficients of Delta(s, K), descending in s, as exact polynomials in gamma = 1/v (s/m).

    Paper, Section III-F. The floating-point parameters are used at their exact binary values.
    """
    mass, inertia = Fraction(parameters.mass), Fraction(parameters.yaw_inertia)
    front = Fraction(parameters.front_cornering_stiffness)
    rear = Fraction(parameters.rear_cornering_stiffness)
    a, b = Fraction(parameters.front_axle_distance), Fraction(parameters.rear_axle_distance)
    frequency = Fraction(parameters.steering_frequency)
    damping = Fraction(parameters.steering_damping)
    lateral, heading, yaw_rate = (Fraction(gain) for gain in gains)
    zero, length, drive = Fraction(0), a + b, front * frequency * frequency
    handling: list[Exact] = [
        (mass * inertia,),
        (zero, (inertia + mass * a * a) * front + (inertia + mass * b * b) * rear),
        (-mass * (a * front - b * rear), zero, length * length * front * rear),
    ]
    steering = ((Fraction(1),), (2 * damping * frequency,), (frequency * frequency,))
    result: list[Exact] = [(zero,)] * 7
    for i, left in enumerate(steering):
        for j, right in enumerate(handling):
            result[i + j] = add(result[i + j], multiply(left, right))
    turning: Exact = (drive * mass * a,)
    damped: Exact = (zero, drive * length * rear)
    feedback: list[Exact] = [
        multiply((yaw_rate,), turning),
        add(
            add(multiply((heading,), turning), multiply((yaw_rate,), damped)),
            (lateral * drive * inertia,),
        ),
        multiply((heading + lateral * b,), damped),
        (lateral * drive * length * rear,),
    ]
    return result[:3] + [add(*pair) for pair in zip(result[3:], feedback, strict=True)]


def is_stable_over(
    parameters: VehicleParameters, gains: Gains, slowest: float, fastest: float, decay: float = 0.0
) -> bool:
    """Whether all roots lie left of -decay (1/s) at every constant speed of an interval (m/s).

    Proves the hypothesis of Proposition 1 for the whole interval, not on a grid.
    """
    if not 0.0 < slowest <= fastest:
        raise ValueError(f"speeds must satisfy 0 < slowest <= fastest: {slowest}, {fastest}")
    low, high = 1 / Fraction(fastest), 1 / Fraction(slowest)
    coefficients = shifted(exact_coefficients(parameters, gains), Fraction(decay))
    conditions = [coefficients[0], coefficients[-1], *hurwitz_minors(coefficients)]
    return all(is_positive_between(condition, low, high) for condition in conditions)


def guaranteed_decay(
    parameters: VehicleParameters, gains: Gains, slowest: float, fastest: float
) -> float:
    """Proven decay sigma (1/s) of Proposition 1 over an interval of constant speeds (m/s).

    At most 1 % below the true value; 0 if the loop is not stable over the interval.
    """
    if not is_stable_over(parameters, gains, slowest, fastest):
        return 0.0
    low = 0.0
    high = min(
        -float(np.linalg.eigvals(closed_loop_at(parameters, gains, speed)).real.max())
        for speed in (slowest, fastest)
    )
    while high - low > 0.005 * high:
        middle = 0.5 * (low + high)
        if is_stable_over(parameters, gains, slowest, fastest, middle):
            low = middle
        else:
            high = middle
    return low
