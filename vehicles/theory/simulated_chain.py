"""Propagation of errors along a chain of linear loops, simulated in time."""

import numpy as np
from numpy.typing import NDArray

from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.linear_model import closed_loop_at, feedback_row, open_loop, steering_input
from vehicles.theory.propagation import SteeringModel

Array = NDArray[np.float64]
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
