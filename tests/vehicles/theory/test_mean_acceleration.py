"""Bounds on the integral of the acceleration, against the system's transition matrix."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS, Loading, VehicleParameters, loaded
from vehicles.theory.linear_model import closed_loop_at, speed_change_matrix
from vehicles.theory.varying_speed import certify, energy_root, integral_bound, transition

SLOWEST, FASTEST = 5.0, 30.0
HEAVY = loaded(LINCOLN_MKZ, Loading(front_passengers=1, rear_passengers=3))


@pytest.mark.parametrize(
    ("car", "low", "high", "acceleration"),
    [
        (LINCOLN_MKZ, 5.0, 30.0, 6.0),
        (LINCOLN_MKZ, 5.0, 9.0, 3.0),
        (LINCOLN_MKZ, 12.0, 30.0, 1.0),
        (HEAVY, 5.0, 30.0, 3.0),
    ],
)
def test_the_bound_holds_over_a_cycle_of_speeds(
    car: VehicleParameters, low: float, high: float, acceleration: float
) -> None:
    """The speed returns to its initial value, so the weight w(v) cancels in V."""
    bound = integral_bound(car, NOMINAL_GAINS, SLOWEST, FASTEST)
    weights = certify(car, NOMINAL_GAINS, SLOWEST, FASTEST).weights
    cycle = transition(car, NOMINAL_GAINS, low, high, acceleration) @ transition(
        car, NOMINAL_GAINS, high, low, acceleration
    )
    root = energy_root(car, NOMINAL_GAINS, high, weights)
    grown = float(np.linalg.norm(root @ cycle @ np.linalg.inv(root), 2)) ** 2
    change = 2.0 * (high - low)
    assert grown <= bound.energy_ratio(change / acceleration, change)


def test_the_transition_is_that_of_an_integrator() -> None:
    before, after, acceleration = 25.0, 8.0, 4.0

    def slope(at: float, flat: np.ndarray) -> np.ndarray:
        speed = before - acceleration * at
        matrix = closed_loop_at(LINCOLN_MKZ, NOMINAL_GAINS, speed)
        moving = matrix - acceleration * speed_change_matrix()
        return np.asarray(moving @ flat.reshape(6, 6)).ravel()

    span = (before - after) / acceleration
    exact = solve_ivp(slope, (0.0, span), np.eye(6).ravel(), rtol=1e-10, atol=1e-12).y[:, -1]
    result = transition(LINCOLN_MKZ, NOMINAL_GAINS, before, after, acceleration)
    assert result == pytest.approx(exact.reshape(6, 6), abs=5e-3 * float(np.abs(exact).max()))
