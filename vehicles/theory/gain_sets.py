"""The set of feedback gains that stabilise the car: membership, boundary, extent.

D-decomposition (paper, Section III-F): a root leaves the left half-plane only where Delta(0, K) = 0
or Delta(j w, K) = 0. The first is the plane k_e = 0. The second is linear in the gains: a line in
the space of (k_e, k_theta, k_omega) for each frequency; these lines form the other surface. A6 does
not depend on the gains, so there is no third boundary (a root at infinity).

Gains are arrays (..., 3) of (k_e in rad/m, k_theta, k_omega in s), or `Gains`. A set is defined for
a list of cars (loadings) and speeds (m/s): its members stabilise all of them.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.linear_model import affine_coefficients
from vehicles.theory.polynomials import is_hurwitz, spectral_abscissa

Array = NDArray[np.float64]

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
