import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from tests.made.vehicles.theory.random_cars import CAR
from vehicles.car.parameters import NOMINAL_GAINS, Gains, all_loadings, loaded
from vehicles.theory.linear_model import closed_loop, closed_loop_at, speed_change_matrix
from vehicles.theory.varying_speed import (
    FASTEST,
    SLOWEST,
    SpeedCertificate,
    balancing_growth,
    certify,
    lyapunov_change,
)

UNSTABLE = Gains(0.06, 3.0, 0.08)
Array = np.ndarray


def _energy(certificate: SpeedCertificate, speed: float) -> Array:
    """P(v) in units of the state, from Lyapunov's equation."""
    matrix = closed_loop_at(certificate.parameters, certificate.gains, speed)
    return np.asarray(solve_continuous_lyapunov(matrix.T, -np.diag(certificate.weights)))


def _growth(certificate: SpeedCertificate, speed: float) -> float:
    change, energy = lyapunov_change(
        certificate.parameters, certificate.gains, speed, certificate.weights
    )
    return balancing_growth(change, energy)


def test_the_certificate_of_the_nominal_gains_covers_road_cars() -> None:
    """At every covered speed and loading the bound exceeds the friction limit of 9.8 m/s²."""
    for loading in all_loadings():
        certificate = certify(loaded(CAR, loading), NOMINAL_GAINS)
        assert certificate.holds
        for speed in np.linspace(SLOWEST, FASTEST, 12):
            assert certificate.bound(float(speed)) > 9.81


def test_change_is_the_derivative_along_the_speed() -> None:
    """S = dP/dv + PE + E'P, with dP/dv by finite differences of Lyapunov's equation."""
    certificate = certify(CAR, NOMINAL_GAINS)
    root = np.sqrt(np.array(certificate.weights))
    for speed in (5.0, 12.0, 30.0):
        width = 1e-4 * speed
        slope = _energy(certificate, speed + width) - _energy(certificate, speed - width)
        energy, entering = _energy(certificate, speed), speed_change_matrix()
        expected = slope / (2.0 * width) + energy @ entering + entering.T @ energy
        change, scaled_energy = lyapunov_change(CAR, NOMINAL_GAINS, speed, certificate.weights)
        unscaled = change * np.outer(root, root)
        assert unscaled == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())
        assert scaled_energy * np.outer(root, root) == pytest.approx(energy, rel=1e-6)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("speed", [2.5, 8.0, 30.0])
def test_bound_is_where_the_lyapunov_function_stops_falling(speed: float, sign: float) -> None:
    certificate = certify(CAR, NOMINAL_GAINS)
    limit = certificate.bound(speed)
    change, energy = lyapunov_change(CAR, NOMINAL_GAINS, speed, certificate.weights)
    total = change + balancing_growth(change, energy) * energy
    for factor, falls in ((0.999, True), (1.001, False)):
        worst = np.linalg.eigvalsh(-np.eye(6) + sign * factor * limit * total).max()
        assert (worst < 0.0) == falls


def test_energy_decreases_along_simulated_speed_profiles() -> None:
    """Swinging between the ends at 99 % of the bound: w(v) z'Pz always decreases, from any state.

    Second method: the time-varying system is integrated, w(v) is the integral of h, and the value
    is compared at successive instants.
    """
    certificate = certify(CAR, NOMINAL_GAINS)
    constant, inverse_speed = closed_loop(CAR, NOMINAL_GAINS)
    entering = speed_change_matrix()
    speeds = np.linspace(SLOWEST, FASTEST, 1200)
    limits = np.array([certificate.bound(v) for v in speeds])
    growths = np.array([_growth(certificate, v) for v in speeds])
    steps = 0.5 * (growths[1:] + growths[:-1]) * np.diff(speeds)
    logarithms = np.concatenate([[0.0], np.cumsum(steps)])
    states = np.random.default_rng(7).normal(size=(6, 12)) / np.sqrt(certificate.weights)[:, None]
    speed, sign, step = SLOWEST, 1.0, 1e-3
    values: list[Array] = []
    turns = 0
    for index in range(4000):
        if index % 20 == 0:
            energy = _energy(certificate, speed)
            weight = np.exp(np.interp(speed, speeds, logarithms))
            values.append(weight * np.einsum("ik,ij,jk->k", states, energy, states))
        rate = sign * 0.99 * float(np.interp(speed, speeds, limits))
        halfway, ahead = speed + 0.5 * step * rate, speed + step * rate
        at = [constant + inverse_speed / v + rate * entering for v in (speed, halfway, ahead)]
        k1 = at[0] @ states
        k2 = at[1] @ (states + 0.5 * step * k1)
        k3 = at[1] @ (states + 0.5 * step * k2)
        k4 = at[2] @ (states + step * k3)
        states = states + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        speed = ahead
        if not SLOWEST + 0.05 < speed < FASTEST - 0.05:
            sign, turns = -sign if (speed > 10.0) == (sign > 0.0) else sign, turns + 1
            speed = min(max(speed, SLOWEST), FASTEST)
    history = np.array(values)
    assert turns >= 2
    assert (history[1:] < history[:-1]).all()
    assert (history[-1] < 1e-3 * history[0]).all()
