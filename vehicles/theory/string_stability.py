"""String stability: norms of the propagation of errors (Section IV-B).

The H-infinity norm is the gain in L2. The paper's Definition 1 is in L-infinity, whose gain (the L1
norm of the impulse response) is at least as large.
"""

from dataclasses import dataclass
from math import pi

import numpy as np

from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.gain_sets import stationary_points
from vehicles.theory.linear_model import (
    Array,
    Transfer,
    heading_numerator,
    lateral_numerator,
    propagation,
)

LANE_CHANGE_BAND = 2.0 * pi  # rad/s, 1 Hz: well below the steering's mode


def squared_magnitude(polynomial: Array) -> np.poly1d:
    """|p(j w)|² as a polynomial in x = w² (spectral factorisation).

    p(s) p(-s) has even powers only, and s² = -x.
    """
    powers = np.arange(len(polynomial))[::-1]
    product = np.convolve(polynomial, polynomial * (-1.0) ** powers)[::2]
    return np.poly1d(product * (-1.0) ** powers)


@dataclass(frozen=True, slots=True)
class Peak:
    """Largest magnitude over all frequencies (H-infinity norm, Section IV-B), and its frequency."""

    magnitude: float
    frequency: float


def peak(transfer: Transfer, highest: float = np.inf) -> Peak:
    """Largest magnitude at frequencies up to `highest` (rad/s); by default the H-infinity norm.

    Section IV-B. |T|² is a ratio of polynomials in w², and its stationary points are roots of one
    polynomial, so none is missed. The transfer function must be stable and strictly proper.
    """
    squares = squared_magnitude(transfer.numerator), squared_magnitude(transfer.denominator)
    stationary = np.sqrt(stationary_points(*squares))
    frequencies = np.concatenate([[0.0], stationary[stationary < highest]])
    if np.isfinite(highest):
        frequencies = np.append(frequencies, highest)
    magnitudes = np.abs(transfer.at(frequencies))
    best = int(np.argmax(magnitudes))
    return Peak(float(magnitudes[best]), float(frequencies[best]))


def amplified_band(transfer: Transfer) -> list[tuple[float, float]]:
    """Frequency intervals (rad/s) with |T| > 1, in which errors grow (Section IV-B), if T(0) = 1.

    The ends are real roots of |numerator|² - |denominator|², which has a root at zero.
    """
    excess = squared_magnitude(transfer.numerator) - squared_magnitude(transfer.denominator)
    roots = np.roots(excess.coef[:-1])
    real = roots[np.abs(roots.imag) < 1e-7 * np.abs(roots)].real
    edges = [0.0, *np.sqrt(np.sort(real[real > 0.0])).tolist()]
    beyond = [*edges[1:], 2.0 * edges[-1] + 1.0]
    above = np.abs(transfer.at(0.5 * (np.array(edges) + np.array(beyond)))) > 1.0
    ends = [*edges[1:], np.inf]
    return [(a, b) for a, b, over in zip(edges, ends, above, strict=True) if over]


def largest_weight(transfer: Transfer) -> float:
    """Largest weight alpha of eq. (5) below which alpha |T| < 1 at every frequency, at most 1.

    Below it the chain with the lead's data does not amplify an error that a vehicle adds.
    """
    return min(1.0, 1.0 / peak(transfer).magnitude)


def largest_singular_value(
    parameters: VehicleParameters, gains: Gains, speed: float, frequencies: Array
) -> Array:
    """sigma_max of (M_0 + B K)^-1 B K at each frequency (rad/s), Section IV-B; shape (n,).

    From the states of one vehicle to those of the next, with instantaneous steering. The matrix has
    rank one, b k, and the singular value |b| |k|, which mixes metres and radians, as in the paper.
    """
    s = 1j * np.asarray(frequencies, dtype=np.float64)
    plain = propagation(parameters, gains, speed, "instantaneous")
    outputs = [np.polyval(n(parameters, speed), s) for n in (lateral_numerator, heading_numerator)]
    feedback = np.hypot(gains.lateral, np.abs(gains.heading + gains.yaw_rate * s))
    sizes = np.hypot(*np.abs(outputs)) * feedback
    return np.asarray(sizes / np.abs(np.polyval(plain.denominator, s)))
