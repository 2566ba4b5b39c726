"""The bound on the mean acceleration, against an integration of the system."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS, Loading, VehicleParameters, loaded
from vehicles.theory.linear_model import closed_loop_at, speed_change_matrix
from vehicles.theory.varying_speed import certify, lyapunov_change

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
    certificate = certify(car, NOMINAL_GAINS, SLOWEST, FASTEST)
    decay, sensitivity = certificate.mean_bound()
    turn = (high - low) / acceleration

    def slope(at: float, flat: np.ndarray) -> np.ndarray:
        rate = -acceleration if at < turn else acceleration
        speed = low + acceleration * abs(turn - at)
        moving = closed_loop_at(car, NOMINAL_GAINS, speed) + rate * speed_change_matrix()
        return np.asarray(moving @ flat.reshape(6, 6)).ravel()

    end = solve_ivp(slope, (0.0, 2.0 * turn), np.eye(6).ravel(), rtol=1e-8, atol=1e-12).y[:, -1]
    weights = np.array(certificate.weights)
    _, energy = lyapunov_change(car, NOMINAL_GAINS, high, certificate.weights)
    root = np.linalg.cholesky(energy).T * np.sqrt(weights)  # |root z|² is z'Pz
    grown = float(np.linalg.norm(root @ end.reshape(6, 6) @ np.linalg.inv(root), 2)) ** 2
    assert grown <= np.exp(sensitivity * 2.0 * (high - low) - decay * 2.0 * turn)
