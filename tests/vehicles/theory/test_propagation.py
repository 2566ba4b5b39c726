import numpy as np
import pytest
from hypothesis import assume, given

from tests.made.examples import examples
from tests.made.vehicles.theory.error_model import curvature_input, curvature_rate_input
from tests.made.vehicles.theory.random_cars import CAR, CARS, GAINS, SPEEDS
from vehicles.car.parameters import NOMINAL_GAINS, Gains, VehicleParameters
from vehicles.theory.gain_sets import abscissa
from vehicles.theory.linear_model import (
    SteeringModel,
    chain_offsets,
    closed_loop_at,
    low_frequency_growth,
    open_loop,
    propagation,
    steady_cornering,
    trace_propagation,
)
from vehicles.theory.string_stability import amplified_band

BOTH: tuple[SteeringModel, ...] = ("instantaneous", "second order")
FREQUENCIES = np.geomspace(0.05, 60.0, 40)


@examples(10, 60)
@given(CARS, GAINS, SPEEDS)
def test_propagation_is_h_over_one_plus_h(
    car: VehicleParameters, gains: Gains, speed: float
) -> None:
    """H from the paper's M_0(s) and K(s), solved numerically at each frequency."""
    p, cf, cr = car, car.front_cornering_stiffness, car.rear_cornering_stiffness
    a, b = p.front_axle_distance, p.rear_axle_distance
    for frequency in (0.1, 1.0, 7.0, 25.0):
        s = 1j * frequency
        m0 = np.array(
            [
                [p.mass * s**2 + (cf + cr) / speed * s, (a * cf - b * cr) / speed * s - (cf + cr)],
                [
                    (a * cf - b * cr) / speed * s,
                    p.yaw_inertia * s**2
                    + (a * a * cf + b * b * cr) / speed * s
                    - (a * cf - b * cr),
                ],
            ]
        )
        row = cf * np.array([gains.lateral, gains.heading + gains.yaw_rate * s])
        h = row @ np.linalg.solve(m0, np.array([1.0, a]))
        wn, zeta = p.steering_frequency, p.steering_damping
        lag = wn**2 / (s**2 + 2 * zeta * wn * s + wn**2)
        for steering, loop in zip(BOTH, (h, lag * h), strict=True):
            actual = propagation(car, gains, speed, steering).at(np.array([frequency]))[0]
            assert actual == pytest.approx(loop / (1.0 + loop), rel=1e-8)


@examples(10, 60)
@given(CARS, GAINS, SPEEDS)
def test_predecessor_only_amplifies_at_low_frequency(
    car: VehicleParameters, gains: Gains, speed: float
) -> None:
    """The paper's result for every stable loop with R(0) > 0, and its size."""
    assume(gains.lateral > 1e-2)
    assume(abscissa(car, gains, [speed])[0] < -1e-2)
    growth = low_frequency_growth(car, gains, speed)
    assume(growth > 1e-2)
    for steering in BOTH:
        transfer = propagation(car, gains, speed, steering)
        band = amplified_band(transfer)
        assert band[0][0] == 0.0
        magnitude = abs(transfer.at(np.array([0.1 * band[0][1]]))[0])
        assert magnitude > 1.0
        frequency = 1e-3
        excess = abs(transfer.at(np.array([frequency]))[0]) - 1.0
        assert excess / frequency**2 == pytest.approx(growth, rel=0.02)


@examples(10, 60)
@given(CARS, CARS, GAINS, SPEEDS)
def test_trace_propagation_from_the_error_model(
    car: VehicleParameters, known: VehicleParameters, gains: Gains, speed: float
) -> None:
    """Second derivation: error relative to the path bent by the predecessor, eq. (3) with F.

    Closed loop driven by curvature and its rate; the path's own offset is added.
    """
    matrix = closed_loop_at(car, gains, speed)
    for s in 1j * np.array([0.2, 2.0, 9.0]):
        column = curvature_input(car, speed, known) + s * curvature_rate_input(speed)
        curvature = s**2 / speed**2
        error = np.linalg.solve(s * np.eye(6) - matrix, column * curvature)
        actual = trace_propagation(car, gains, speed, assumed=known).at(np.array([s.imag]))[0]
        assert actual == pytest.approx(1.0 + error[0], rel=1e-7)


def test_an_error_to_the_outside_amplifies_at_low_frequency() -> None:
    for speed in (10.0, 20.0, 30.0):
        transfer = trace_propagation(CAR, NOMINAL_GAINS, speed)
        wide = -steady_cornering(CAR, NOMINAL_GAINS, speed, 1.0)[0]
        excess = abs(transfer.at(np.array([0.01]))[0]) - 1.0
        assert excess / 0.01**2 == pytest.approx(wide / speed**2, rel=1e-3)


def test_instant_steering_from_the_matrices() -> None:
    constant, inverse_speed = open_loop(CAR)
    matrix = (constant + inverse_speed / 20.0)[:4, :4]
    column = constant[:4, 4]
    row = np.array([0.06, 0.96, 0.0, 0.08])
    closed = np.linalg.eigvals(matrix - np.outer(column, row))
    transfer = propagation(CAR, NOMINAL_GAINS, 20.0, "instantaneous")
    roots = np.roots(transfer.denominator)
    assert np.sort_complex(roots) == pytest.approx(np.sort_complex(closed), rel=1e-8)


@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.5, 1.0])
def test_chain_by_following_the_recursion(alpha: float) -> None:
    transfer = trace_propagation(CAR, NOMINAL_GAINS, 30.0)
    actual = chain_offsets(transfer, FREQUENCIES, alpha, 4)
    factor = transfer.at(FREQUENCIES)
    offsets = [np.ones_like(factor)]
    for _ in range(4):
        offsets.append(factor * (alpha * offsets[-1] + (1.0 - alpha) * offsets[0]))
    for found_row, offset in zip(actual, offsets[1:], strict=True):
        assert found_row == pytest.approx(offset - 1.0, abs=1e-12)


def test_lead_data_limit_the_growth() -> None:
    """With the predecessor only, the offset grows from car to car. With half lead it converges."""
    transfer = trace_propagation(CAR, NOMINAL_GAINS, 30.0)
    slow = np.array([1.0])
    alone = np.abs(chain_offsets(transfer, slow, 1.0, 12))[:, 0]
    half = np.abs(chain_offsets(transfer, slow, 0.5, 12))[:, 0]
    assert alone[11] > 10.0 * alone[0]
    assert half[11] < 2.5 * half[0]
    factor = transfer.at(slow)[0]
    assert half[11] == pytest.approx(abs((factor - 1.0) / (1.0 - 0.5 * factor)), rel=1e-3)
