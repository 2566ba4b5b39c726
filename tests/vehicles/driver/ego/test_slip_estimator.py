"""Estimated load of cars with known mass."""

import math

import numpy as np
import pytest

from tests.made.vehicles.driving import advance
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.parameters import LINCOLN_MKZ, Loading, VehicleParameters, loaded
from vehicles.driver.slip_estimator import PRIOR, ParameterUser, SlipEstimator, with_load
from vehicles.driver.steering import FeedforwardFeedback, SlipCompensated

TICK = 0.02
FULL = loaded(LINCOLN_MKZ, Loading(front_passengers=1, rear_passengers=3))
FULL_RATIO = FULL.mass / LINCOLN_MKZ.mass


def bends(t: float) -> float:
    """Steering (rad) of repeated lane changes at 30 m/s, with straights between."""
    return 0.0065 * (0 if t % 6.0 < 2.0 else math.copysign(1.0, math.sin(math.pi * t / 2.0)))


def driven(
    car: VehicleParameters,
    *,
    seconds: float = 12.0,
    speed: float = 30.0,
    noise: float = 0.0,
    bias: float = 0.0,
    seed: int = 0,
) -> SlipEstimator:
    estimator = SlipEstimator(LINCOLN_MKZ, noise)
    body, random = Body(0.0, 0.0, 0.0, speed), np.random.default_rng(seed)
    for k in range(round(seconds / TICK)):
        command = bends(k * TICK)
        estimator.correct(body.yaw_rate + bias + noise * random.standard_normal(), body.speed)
        estimator.move(TICK, body.speed, command)
        body = advance(body, Actuation(command, 0.0), TICK, car)
    return estimator


@pytest.mark.parametrize("ratio", [0.85, 1.0, 1.1, FULL_RATIO, 1.4])
@pytest.mark.parametrize("speed", [15.0, 30.0])
def test_the_load_is_estimated_with_exact_sensors(ratio: float, speed: float) -> None:
    estimator = driven(with_load(LINCOLN_MKZ, ratio), speed=speed)
    assert estimator.ratio == pytest.approx(ratio, abs=0.04)
    assert math.sqrt(estimator.variance) < 0.05


def test_the_stated_deviation_is_right_with_noise_and_a_biased_gyroscope() -> None:
    off = []
    for seed in range(12):
        estimator = driven(FULL, noise=0.00175, bias=0.001, seed=seed)
        off.append((estimator.ratio - FULL_RATIO) / math.sqrt(estimator.variance))
        assert 0.005 < math.sqrt(estimator.variance) < 0.1
    assert max(map(abs, off)) < 4.0
    assert np.sqrt(np.mean(np.square(off))) < 2.0


def test_a_straight_road_gives_no_information() -> None:
    estimator, random = SlipEstimator(LINCOLN_MKZ, 0.00175), np.random.default_rng(3)
    for _ in range(1000):
        estimator.move(TICK, 30.0, 0.0)
        estimator.correct(0.001 + 0.00175 * random.standard_normal(), 30.0)
    assert estimator.ratio == 1.0
    assert math.sqrt(estimator.variance) >= PRIOR


def test_left_and_right_are_symmetric() -> None:
    left, right = SlipEstimator(LINCOLN_MKZ, 0.0), SlipEstimator(LINCOLN_MKZ, 0.0)
    for k in range(300):
        for side, one in ((1.0, left), (-1.0, right)):
            one.move(TICK, 25.0, side * bends(k * TICK))
            one.correct(side * 0.9 * bends(k * TICK), 25.0)
    assert left.ratio == pytest.approx(right.ratio, abs=1e-12)


def test_shipped_controllers_accept_other_parameters() -> None:
    for law in (SlipCompensated(LINCOLN_MKZ), FeedforwardFeedback(LINCOLN_MKZ)):
        assert isinstance(law, ParameterUser)
