import numpy as np
import pytest
from hypothesis import assume, given

from tests.made.examples import examples
from tests.made.vehicles.theory.random_cars import CAR, CARS, GAINS, SPEEDS
from vehicles.car.parameters import NOMINAL_GAINS, Gains, VehicleParameters, all_loadings, loaded
from vehicles.theory.gain_sets import (
    PAPER_SPEEDS,
    abscissa,
    common_ball,
    is_stabilising,
    stability_ball,
)
from vehicles.theory.linear_model import characteristic_polynomial

RELATIVE = (NOMINAL_GAINS.lateral, NOMINAL_GAINS.heading, NOMINAL_GAINS.yaw_rate)
AROUND_ONE = (0.3, 1.0, 0.1)


def _on_sphere(count: int) -> np.ndarray:
    points = np.random.default_rng(6).normal(size=(count, 3))
    return np.asarray(points / np.linalg.norm(points, axis=1)[:, None])


@examples(13, 80)
@given(CARS, GAINS, SPEEDS)
def test_ball_of_any_car(car: VehicleParameters, gains: Gains, speed: float) -> None:
    """The whole ball is stable, and a root is on the axis where it touches the boundary."""
    assume(gains.lateral > 1e-3)
    assume(bool(is_stabilising(car, speed, np.array(gains))))
    assume(abscissa(car, gains, [speed])[0] < -1e-3)
    ball = stability_ball(car, speed, gains, AROUND_ONE)
    directions = _on_sphere(400) * np.array(AROUND_ONE)
    for fraction in (0.5, 0.999):
        assert is_stabilising(
            car, speed, np.array(gains) + fraction * ball.radius * directions
        ).all()
    step = (np.array(ball.nearest) - np.array(gains)) / np.array(AROUND_ONE)
    assert np.linalg.norm(step) == pytest.approx(ball.radius, rel=1e-9)
    polynomial = characteristic_polynomial(car, ball.nearest, speed)
    terms = np.abs(polynomial) * max(ball.frequency, 1.0) ** np.arange(6, -1, -1)
    assert abs(np.polyval(polynomial, 1j * ball.frequency)) < 1e-6 * terms.sum()
    beyond = np.array(gains) + 1.001 * np.array(AROUND_ONE) * step
    assert not is_stabilising(car, speed, beyond)


def test_common_ball_is_inside_every_set() -> None:
    cars = [loaded(CAR, loading) for loading in all_loadings()]
    ball = common_ball(cars, PAPER_SPEEDS, NOMINAL_GAINS, RELATIVE)
    assert ball.radius == pytest.approx(0.8179, abs=1e-4)
    assert ball.speed == PAPER_SPEEDS[-1]
    gains = np.array(NOMINAL_GAINS) * (1.0 + 0.9999 * ball.radius * _on_sphere(100))
    for car in cars:
        for speed in PAPER_SPEEDS:
            assert is_stabilising(car, speed, gains).all()
