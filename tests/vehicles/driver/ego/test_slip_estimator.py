"""Estimated load of cars with known mass."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.made.vehicles.driving import advance
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.parameters import LINCOLN_MKZ, Loading, VehicleParameters, loaded
from vehicles.car.sensors.imu import Motion
from vehicles.driver.ego.slip_estimator import (
    PRIOR,
    LoadWatch,
    ParameterUser,
    SlipEstimator,
    with_load,
)
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
    assert estimator.deviation < 0.05


def test_one_second_of_a_bend_is_enough() -> None:
    estimator = driven(FULL, seconds=3.0)
    assert estimator.ratio == pytest.approx(FULL_RATIO, abs=0.04)


def test_gradient_and_slip_match_the_laden_car() -> None:
    estimator = driven(FULL).parameters
    assert estimator.steer_gradient == pytest.approx(FULL.steer_gradient, rel=0.03)
    assert estimator.steady_slip_per_curvature(30.0) == pytest.approx(
        FULL.steady_slip_per_curvature(30.0), abs=0.05
    )
    off = FULL.steady_slip_per_curvature(30.0) - LINCOLN_MKZ.steady_slip_per_curvature(30.0)
    assert abs(off) > 0.4  # error without the estimator


def test_the_stated_deviation_is_right_with_noise_and_a_biased_gyroscope() -> None:
    off = []
    for seed in range(12):
        estimator = driven(FULL, noise=0.00175, bias=0.001, seed=seed)
        off.append((estimator.ratio - FULL_RATIO) / estimator.deviation)
        assert 0.005 < estimator.deviation < 0.1
    assert max(map(abs, off)) < 4.0
    assert np.sqrt(np.mean(np.square(off))) < 2.0


def test_a_straight_road_gives_no_information() -> None:
    estimator, random = SlipEstimator(LINCOLN_MKZ, 0.00175), np.random.default_rng(3)
    for _ in range(1000):
        estimator.move(TICK, 30.0, 0.0)
        estimator.correct(0.001 + 0.00175 * random.standard_normal(), 30.0)
    assert estimator.ratio == 1.0
    assert estimator.deviation >= PRIOR


def test_slow_driving_and_slides_are_ignored() -> None:
    for speed, yaw_rate in ((5.0, 0.3), (30.0, 0.3)):
        estimator = SlipEstimator(LINCOLN_MKZ, 0.0)
        for _ in range(100):
            estimator.move(TICK, speed, 0.02)
            estimator.correct(yaw_rate, speed)
        assert estimator.ratio == 1.0


@pytest.mark.parametrize("wild", [50.0, -50.0, 0.1])
def test_the_ratio_is_bounded(wild: float) -> None:
    estimator = SlipEstimator(LINCOLN_MKZ, 0.0)
    for k in range(500):
        estimator.move(TICK if k % 3 else 0.0, 30.0, 0.004)
        estimator.correct(wild * (-1) ** k / 50.0 * 0.1, 30.0)
        assert 0.7 <= estimator.ratio <= 1.6
        assert math.isfinite(estimator.deviation)


def test_left_and_right_are_symmetric() -> None:
    left, right = SlipEstimator(LINCOLN_MKZ, 0.0), SlipEstimator(LINCOLN_MKZ, 0.0)
    for k in range(300):
        for side, one in ((1.0, left), (-1.0, right)):
            one.move(TICK, 25.0, side * bends(k * TICK))
            one.correct(side * 0.9 * bends(k * TICK), 25.0)
    assert left.ratio == pytest.approx(right.ratio, abs=1e-12)


class Recorder:
    """Records the parameters that it is given."""

    def __init__(self) -> None:
        self.assumed: list[VehicleParameters] = []

    def assume(self, parameters: VehicleParameters) -> None:
        self.assumed.append(parameters)


def test_users_get_new_parameters_only_after_a_change() -> None:
    user = Recorder()
    watch = LoadWatch(SlipEstimator(LINCOLN_MKZ, 0.0), [user])
    body = Body(0.0, 0.0, 0.0, 30.0)
    for k in range(300):
        reading = Motion(body.speed, body.yaw_rate)
        watch.observe(k * 20_000_000, reading if k % 2 == 0 else None)
        watch.record_command(bends(k * TICK))
        body = advance(body, Actuation(bends(k * TICK), 0.0), TICK, FULL)
    assert 3 < len(user.assumed) < 150
    assert user.assumed[-1].mass == pytest.approx(FULL.mass, rel=0.03)
    assert replace(user.assumed[-1], mass=1.0, yaw_inertia=1.0) == replace(
        LINCOLN_MKZ, mass=1.0, yaw_inertia=1.0
    )


def test_without_an_estimator_users_get_nothing() -> None:
    user = Recorder()
    watch = LoadWatch(None, [user])
    watch.observe(0, Motion(30.0, 0.1))
    watch.observe(1, None)
    assert user.assumed == []


def test_shipped_controllers_accept_other_parameters() -> None:
    for law in (SlipCompensated(LINCOLN_MKZ), FeedforwardFeedback(LINCOLN_MKZ)):
        assert isinstance(law, ParameterUser)
