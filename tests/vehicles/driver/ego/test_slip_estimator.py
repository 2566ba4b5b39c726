"""The load that the estimator finds, against cars of known mass driven by the product's plant."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.made.vehicles.driving import advance
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.imu import Motion
from vehicles.car.parameters import LINCOLN_MKZ, Loading, VehicleParameters, loaded
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
    """Steering of a lane change at 30 m/s, again and again, with straights between."""
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
def test_it_finds_the_load_of_a_car_with_exact_sensors(ratio: float, speed: float) -> None:
    found = driven(with_load(LINCOLN_MKZ, ratio), speed=speed)
    assert found.ratio == pytest.approx(ratio, abs=0.04)
    assert found.deviation < 0.05


def test_a_second_of_the_first_bend_is_enough() -> None:
    found = driven(FULL, seconds=3.0)
    assert found.ratio == pytest.approx(FULL_RATIO, abs=0.04)


def test_gradient_and_slip_are_then_the_laden_car_s() -> None:
    found = driven(FULL).parameters
    assert found.steer_gradient == pytest.approx(FULL.steer_gradient, rel=0.03)
    assert found.steady_slip_per_curvature(30.0) == pytest.approx(
        FULL.steady_slip_per_curvature(30.0), abs=0.05
    )
    off = FULL.steady_slip_per_curvature(30.0) - LINCOLN_MKZ.steady_slip_per_curvature(30.0)
    assert abs(off) > 0.4  # what is not known without it


def test_its_uncertainty_is_honest_with_noise_and_a_biased_gyroscope() -> None:
    off = []
    for seed in range(12):
        found = driven(FULL, noise=0.00175, bias=0.001, seed=seed)
        off.append((found.ratio - FULL_RATIO) / found.deviation)
        assert 0.005 < found.deviation < 0.1
    assert max(map(abs, off)) < 4.0
    assert np.sqrt(np.mean(np.square(off))) < 2.0


def test_on_a_straight_road_nothing_is_learned() -> None:
    estimator, random = SlipEstimator(LINCOLN_MKZ, 0.00175), np.random.default_rng(3)
    for _ in range(1000):
        estimator.move(TICK, 30.0, 0.0)
        estimator.correct(0.001 + 0.00175 * random.standard_normal(), 30.0)
    assert estimator.ratio == 1.0
    assert estimator.deviation >= PRIOR


def test_slow_driving_and_slides_teach_nothing() -> None:
    for speed, yaw_rate in ((5.0, 0.3), (30.0, 0.3)):
        estimator = SlipEstimator(LINCOLN_MKZ, 0.0)
        for _ in range(100):
            estimator.move(TICK, speed, 0.02)
            estimator.correct(yaw_rate, speed)
        assert estimator.ratio == 1.0


@pytest.mark.parametrize("wild", [50.0, -50.0, 0.1])
def test_it_stays_within_reason(wild: float) -> None:
    estimator = SlipEstimator(LINCOLN_MKZ, 0.0)
    for k in range(500):
        estimator.move(TICK if k % 3 else 0.0, 30.0, 0.004)
        estimator.correct(wild * (-1) ** k / 50.0 * 0.1, 30.0)
        assert 0.7 <= estimator.ratio <= 1.6
        assert math.isfinite(estimator.deviation)


def test_the_sides_are_alike() -> None:
    left, right = SlipEstimator(LINCOLN_MKZ, 0.0), SlipEstimator(LINCOLN_MKZ, 0.0)
    for k in range(300):
        for side, one in ((1.0, left), (-1.0, right)):
            one.move(TICK, 25.0, side * bends(k * TICK))
            one.correct(side * 0.9 * bends(k * TICK), 25.0)
    assert left.ratio == pytest.approx(right.ratio, abs=1e-12)


class Told:
    """Remembers what it is to assume."""

    def __init__(self) -> None:
        self.assumed: list[VehicleParameters] = []

    def assume(self, parameters: VehicleParameters) -> None:
        self.assumed.append(parameters)


def test_those_who_assume_are_told_of_news_only() -> None:
    told = Told()
    watch = LoadWatch(SlipEstimator(LINCOLN_MKZ, 0.0), [told])
    body = Body(0.0, 0.0, 0.0, 30.0)
    for k in range(300):
        reading = Motion(body.speed, body.yaw_rate)
        watch.observe(k * 20_000_000, reading if k % 2 == 0 else None)
        watch.record_command(bends(k * TICK))
        body = advance(body, Actuation(bends(k * TICK), 0.0), TICK, FULL)
    assert 3 < len(told.assumed) < 150
    assert told.assumed[-1].mass == pytest.approx(FULL.mass, rel=0.03)
    assert replace(told.assumed[-1], mass=1.0, yaw_inertia=1.0) == replace(
        LINCOLN_MKZ, mass=1.0, yaw_inertia=1.0
    )


def test_without_an_estimator_nobody_is_told() -> None:
    told = Told()
    watch = LoadWatch(None, [told])
    watch.observe(0, Motion(30.0, 0.1))
    watch.observe(1, None)
    assert told.assumed == []


def test_the_shipped_laws_can_assume_another_car() -> None:
    for law in (SlipCompensated(LINCOLN_MKZ), FeedforwardFeedback(LINCOLN_MKZ)):
        assert isinstance(law, ParameterUser)
