import numpy as np
import pytest
from hypothesis import given

from tests.made.examples import examples
from tests.made.vehicles.theory.error_model import curvature_input, curvature_rate_input
from tests.made.vehicles.theory.random_cars import CAR, CARS, GAINS, SPEEDS
from vehicles.car.parameters import NOMINAL_GAINS, Gains, VehicleParameters
from vehicles.theory.linear_model import (
    SteeringModel,
    chain_offsets,
    closed_loop_at,
    open_loop,
    propagation,
    trace_propagation,
)

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
