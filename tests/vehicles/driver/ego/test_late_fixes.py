"""Late fixes correct the estimate at their instant; stored readings predict it to now."""

import math
from dataclasses import astuple

import numpy as np
import pytest

from tests.made.vehicles.driving import advance
from tests.made.vehicles.receivers import receiver
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import ImuSettings, InertialSensor
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.driver.own_state import Pose
from vehicles.driver.pose_estimator import PoseEstimator
from vehicles.schedule import MILLISECOND, SECOND

TICK = 10 * MILLISECOND


def driven(latency: int, *, seconds: float = 6.0) -> tuple[list[Pose], list[Pose], list[Body]]:
    """Poses from fixes with `latency` (ns), from the same fixes without it, and the truth."""
    gnss = receiver()
    imu = InertialSensor(ImuSettings(), 50.0, 0, np.random.default_rng(2))
    body = Body(0.0, 0.0, 0.3, 20.0)
    start = Fix(0, 0, body.east, body.north, body.yaw, body.speed, body.yaw_rate)
    late = PoseEstimator(CAR, latency=latency)
    late.correct(start)
    prompt = PoseEstimator(CAR)
    prompt.correct(start)
    coming: list[Fix] = []
    by_late: list[Pose] = []
    by_prompt: list[Pose] = []
    bodies: list[Body] = []
    for now in range(0, round(seconds * SECOND), TICK):
        fix, motion = gnss.measure(body, now), imu.measure(body, now)
        if fix is not None:
            coming.append(fix)
        known = coming and coming[0].measured_at + latency <= now
        late.update(now, coming.pop(0) if known else None, motion)
        prompt.update(now, fix, motion)
        if now > SECOND:
            by_late.append(late.at(now))
            by_prompt.append(prompt.at(now))
            bodies.append(body)
        angle = 0.02 * math.sin(now / SECOND)
        body = advance(body, Actuation(angle, 0.5), TICK / SECOND, CAR)
    return by_late, by_prompt, bodies


def off(poses: list[Pose], bodies: list[Body]) -> float:
    """Root mean square of the distance (m) from the truth."""
    away = [
        math.hypot(p.east - b.east, p.north - b.north) for p, b in zip(poses, bodies, strict=True)
    ]
    return math.sqrt(sum(one * one for one in away) / len(away))


def test_without_latency_the_estimates_are_identical() -> None:
    late, prompt, _ = driven(0)
    assert list(map(astuple, late)) == list(map(astuple, prompt))


@pytest.mark.parametrize("latency_ms", [10, 50, 120, 300])
def test_late_fixes_are_nearly_as_good(latency_ms: int) -> None:
    """Only the last readings have no fix yet: one centimetre more at 300 ms.

    Treated as present fixes they would displace the car by the distance driven since, 6 m.
    """
    late, prompt, truth = driven(latency_ms * MILLISECOND)
    assert off(late, truth) < 1.2 * off(prompt, truth) + 0.03 * latency_ms / 1000.0
    assert off(late, truth) < 0.03


def test_a_fix_is_weighted_by_its_stated_accuracy() -> None:
    """A tenth of the standard deviation gives a hundred times the weight."""
    moved = []
    for accuracy in (0.02, 0.2, 2.0):
        estimator = PoseEstimator(CAR)
        estimator.correct(Fix(0, 0, 0.0, 0.0, 0.0, 20.0, 0.0, accuracy=0.2))
        displaced = Fix(1, SECOND // 20, 1.0, 0.3, 0.0, 20.0, 0.0, accuracy=accuracy)
        estimator.correct(displaced)
        moved.append(estimator.at(SECOND // 20).north / 0.3)
    assert moved[0] > 0.95
    assert moved[1] == pytest.approx(0.5, abs=0.05)
    assert moved[2] < 0.05
