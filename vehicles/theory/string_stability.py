"""String stability: norms of propagation and of recorded errors (Section IV-B).

The H-infinity norm is the gain in L2. The paper's Definition 1 is in L-infinity, whose gain (the L1
norm of the impulse response) is at least as large.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi

import numpy as np
from numpy.typing import NDArray

from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.gain_sets import squared_magnitude, stationary_points
from vehicles.theory.linear_model import (
    SteeringModel,
    Transfer,
    closed_loop_at,
    feedback_row,
    heading_numerator,
    lateral_numerator,
    open_loop,
    propagation,
    steering_input,
)

Array = NDArray[np.float64]

LANE_CHANGE_BAND = 2.0 * pi  # rad/s, 1 Hz: well below the steering's mode


@dataclass(frozen=True, slots=True)
class Peak:
    """Largest magnitude over all frequencies (H-infinity norm, Section IV-B), and its frequency."""

    magnitude: float
    frequency: float


def peak(transfer: Transfer, highest: float = np.inf) -> Peak:
    """Largest magnitude at frequencies up to `highest` (rad/s); by default the H-infinity norm.

    Section IV-B. |T|² is a ratio of polynomials in w², and its stationary points are roots of one
    polynomial, so none is missed. The transfer function must be stable and proper.
    """
    stationary = np.sqrt(
        stationary_points(
            squared_magnitude(transfer.numerator), squared_magnitude(transfer.denominator)
        )
    )
    inside = np.concatenate([[0.0], stationary[stationary < highest]])
    if np.isfinite(highest):
        frequencies = np.append(inside, highest)
        magnitudes = np.abs(transfer.at(frequencies))
    else:
        at_infinity = (
            abs(transfer.numerator[0] / transfer.denominator[0])
            if len(transfer.numerator) == len(transfer.denominator)
            else 0.0
        )
        frequencies = np.append(inside, np.inf)
        magnitudes = np.append(np.abs(transfer.at(inside)), at_infinity)
    best = int(np.argmax(magnitudes))
    return Peak(float(magnitudes[best]), float(frequencies[best]))


def amplified_band(transfer: Transfer) -> list[tuple[float, float]]:
    """Frequency intervals (rad/s) with |T| > 1, in which errors grow (Section IV-B for G).

    For transfer functions with T(0) = 1. The ends are real roots of |numerator|² -
    |denominator|², which has a root at zero.
    """
    excess = np.polysub(
        squared_magnitude(transfer.numerator), squared_magnitude(transfer.denominator)
    )
    roots = np.roots(excess[:-1])
    real = roots[np.abs(roots.imag) < 1e-7 * np.abs(roots)].real
    edges = [0.0, *np.sqrt(np.sort(real[real > 0.0])).tolist()]
    beyond = [*edges[1:], 2.0 * edges[-1] + 1.0]
    above = np.abs(transfer.at(0.5 * (np.array(edges) + np.array(beyond)))) > 1.0
    ends = [*edges[1:], np.inf]
    return [(a, b) for a, b, over in zip(edges, ends, above, strict=True) if over]


def maximum_gain(transfer: Transfer) -> float:
    """Gain in L-infinity: bound on the growth of a signal's largest value from car to car.

    The norm of the paper's Definition 1 (Section IV-B); the H-infinity norm is a lower bound. It is
    the integral of the impulse response's magnitude, from partial fractions (simple poles) and the
    trapezoidal rule, within 1e-4. The transfer function must be stable and strictly proper.
    """
    poles = np.roots(transfer.denominator)
    residues = np.polyval(transfer.numerator, poles) / np.polyval(
        np.polyder(transfer.denominator), poles
    )
    span = 25.0 / -float(poles.real.max())
    count = int(np.ceil(400.0 * span * float(np.abs(poles).max()) / (2.0 * np.pi)))
    times = np.linspace(0.0, span, min(count, 400_000))
    response = sum(
        (residue * np.exp(pole * times)).real for pole, residue in zip(poles, residues, strict=True)
    )
    return float(np.trapezoid(np.abs(response), times))


def largest_weight(transfer: Transfer) -> float:
    """Largest alpha below which alpha |T| < 1 at every frequency, at most 1.

    Alpha is the predecessor's weight of eq. (5). Below this value the chain with the lead's data
    contracts: an error added by a vehicle is not amplified behind it.
    """
    return min(1.0, 1.0 / peak(transfer).magnitude)


def largest_singular_value(
    parameters: VehicleParameters, gains: Gains, speed: float, frequencies: Array
) -> Array:
    """sigma_max of (M_0 + B K)^-1 B K at each frequency (rad/s), Section IV-B; shape (n,).

    From the states of one vehicle to those of the next, with instantaneous steering. The matrix has
    rank one, b k, and the singular value |b| |k|. As in the paper, the norm mixes metres and
    radians.
    """
    s = 1j * np.asarray(frequencies, dtype=np.float64)
    plain = propagation(parameters, gains, speed, "instantaneous")
    outputs = [np.polyval(n(parameters, speed), s) for n in (lateral_numerator, heading_numerator)]
    feedback = np.hypot(gains.lateral, np.abs(gains.heading + gains.yaw_rate * s))
    sizes = np.hypot(*np.abs(outputs)) * feedback
    return np.asarray(sizes / np.abs(np.polyval(plain.denominator, s)))


def is_string_stable(norms: Sequence[float], slack: float = 0.0) -> bool:
    """Whether norms do not increase from follower to follower (Definition 1, Section IV-B).

    Growth from one follower to the next of up to `slack`, in the unit of the norms, is ignored.
    """
    return all(behind <= ahead + slack for ahead, behind in pairwise(norms))


def head_to_tail(norms: Sequence[float]) -> float:
    """Ratio of the last follower's norm to the first's, at most 1 under Definition 1."""
    return norms[-1] / norms[0] if norms[0] > 0.0 else np.inf


# ---- Propagation of errors along a chain of linear loops, simulated in time


ComplexArray = NDArray[np.complex128]

SIMULATED_FREQUENCIES = np.geomspace(0.3, 25.0, 10)  # rad/s
TRANSIENT = 14.0  # Settling time before the evaluation, in time constants of the slowest root
STEP_PER_RATE = 0.2  # Integration step, in units of the shortest time constant


def simulated_propagation(
    parameters: VehicleParameters,
    gains: Gains,
    speed: float,
    frequencies: Array,
    steering: SteeringModel = "second order",
) -> ComplexArray:
    """Ratio of the second follower's e_lat to the first's on a simulated chain; shape (n,).

    Lead and two followers with feedback on x_i - x_(i-1) (Section IV-B); the lead drives a sine of
    each frequency (rad/s). Integrated in time (Runge-Kutta, order 4); after settling, a sine is
    fitted to each car by least squares. Agrees with `propagation.propagation` within 1e-3. The
    first follower's ratio to the lead is not G, as the lead moves sideways without turning.
    """
    single, column, row = _loop(parameters, gains, speed, steering)
    eigenvalues = np.linalg.eigvals(single)
    if eigenvalues.real.max() >= 0.0:
        raise ValueError("the loop is not stable and does not settle")
    frequencies = np.asarray(frequencies, dtype=np.float64)
    step = STEP_PER_RATE / max(float(np.abs(eigenvalues).max()), float(frequencies.max()))
    settled = TRANSIENT / -float(eigenvalues.real.max())
    count = int(np.ceil((settled + 2.0 * np.pi / frequencies.min()) / step))
    first, size = int(settled / step), len(single)
    pair = np.kron(np.eye(2), single)
    pair[size:, :size] = np.outer(column, row)  # the second follows the first
    entering = np.concatenate([column, np.zeros(size)])[:, None]
    lead = gains.lateral * np.sin(frequencies * (0.5 * step) * np.arange(2 * count + 1)[:, None])
    states, record = np.zeros((2 * size, len(frequencies))), np.zeros((2, count, len(frequencies)))
    for index in range(count):
        record[:, index] = states[[0, size]]
        now, halfway, ahead = (entering * lead[2 * index + k] for k in range(3))
        k1 = pair @ states + now
        k2 = pair @ (states + (0.5 * step) * k1) + halfway
        k3 = pair @ (states + (0.5 * step) * k2) + halfway
        k4 = pair @ (states + step * k3) + ahead
        states = states + (step / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
    times = step * np.arange(first, count, dtype=np.float64)
    front, back = (_amplitudes(signal[first:], times, frequencies) for signal in record)
    return back / front


def _loop(
    parameters: VehicleParameters, gains: Gains, speed: float, steering: SteeringModel
) -> tuple[Array, Array, Array]:
    """Closed loop, steering input and feedback row: six states, or four without actuation."""
    row = feedback_row(gains)
    if steering == "second order":
        return closed_loop_at(parameters, gains, speed), steering_input(parameters), row
    constant, inverse_speed = open_loop(parameters)
    steered = constant[:4, 4]
    frozen = constant[:4, :4] + inverse_speed[:4, :4] / speed
    return frozen - np.outer(steered, row[:4]), steered, row[:4]


def _amplitudes(signal: Array, times: Array, frequencies: Array) -> ComplexArray:
    """Complex amplitude a of Re(a exp(j w t)) in each column of the signal, by least squares."""
    amplitudes = np.zeros(len(frequencies), dtype=np.complex128)
    for index, frequency in enumerate(frequencies):
        angle = frequency * times
        basis = np.column_stack([np.cos(angle), -np.sin(angle)])
        real, imaginary = np.linalg.lstsq(basis, signal[:, index], rcond=None)[0]
        amplitudes[index] = complex(real, imaginary)
    return amplitudes
