"""The speed limit of a car that is uncertain of its own position."""

from collections.abc import Callable
from itertools import pairwise

import pytest

from vehicles.driver.command_limit import WALKING_PACE, PositionLimit
from vehicles.driver.controller import (
    GapLimits,
    LongitudinalSetup,
    SpacingPolicy,
    VehiclesAhead,
)
from vehicles.driver.leader import WaitingProfile
from vehicles.driver.own_state import Pose
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import Situation
from vehicles.driver.speed import ProfileSpeed, SpeedProfile
from vehicles.driver.speed_guard import SpeedGuard
from vehicles.schedule import SECOND

SETTINGS = DegradationSettings()
SPAN = 0.02
Deviation = Callable[[float], float]


def follower(deviation: Deviation, seconds: float) -> list[tuple[float, float]]:
    """Speeds (m/s) and accelerations (m/s²) of a car whose usual command returns to 30 m/s."""
    limit, speed, driven = PositionLimit(SETTINGS), 30.0, []
    law = ProfileSpeed(SpeedProfile((0.0,), (30.0,)), 0, SPAN)
    setup = LongitudinalSetup(SpacingPolicy(15.0), GapLimits())
    guard = SpeedGuard(law, SETTINGS, setup)
    for step in range(round(seconds / SPAN)):
        limit.observe(deviation(step * SPAN))
        situation = Situation(state="follow", position_limit=limit.speed)
        pose = Pose(0.0, 0.0, 0.0, speed, 0.0)
        at = round(step * SPAN * SECOND)
        last = guard.command(at, pose, VehiclesAhead(), situation).acceleration
        speed += last * SPAN
        driven.append((speed, last))
    return driven


def lead(deviation: Deviation, seconds: float) -> list[tuple[float, float]]:
    """Speeds (m/s) and commands (m/s²) of a lead with a planned speed of 30 m/s."""
    limit, speed, driven = PositionLimit(SETTINGS), 30.0, []
    law = WaitingProfile(SpeedProfile((0.0,), (30.0,)), 0, SPAN, SETTINGS.comfortable)
    for step in range(round(seconds / SPAN)):
        limit.observe(deviation(step * SPAN))
        law.limit = limit.speed
        pose = Pose(0.0, 0.0, 0.0, speed, 0.0)
        command = law.command(round(step * SPAN * SECOND), pose, VehiclesAhead())
        speed += command.acceleration * SPAN
        driven.append((speed, command.acceleration))
    return driven


@pytest.mark.parametrize("car", [follower, lead])
@pytest.mark.parametrize(("deviation", "limit"), [(0.19, 14.3), (2.0, WALKING_PACE)])
def test_a_car_slows_comfortably_and_recovers(
    car: Callable[[Deviation, float], list[tuple[float, float]]], deviation: float, limit: float
) -> None:
    driven = car(lambda at: deviation if 1.0 < at < 60.0 else 0.02, 120.0)
    speeds, accelerations = zip(*driven, strict=True)
    assert min(accelerations) > -SETTINGS.comfortable.deceleration - 0.05
    assert min(speeds) > limit - 0.1
    assert speeds[round(60.0 / SPAN)] == pytest.approx(limit, abs=0.2)
    assert speeds[-1] == pytest.approx(30.0, abs=0.1)
    steps = [a - b for a, b in pairwise(accelerations)]
    assert max(steps) < 1.01 * SETTINGS.emergency_jerk * SPAN


def test_the_margin_of_the_gap_covers_both_positions_and_ends() -> None:
    limit = PositionLimit(SETTINGS)
    for deviation, margin in ((0.02, 0.0), (0.3, 3.0 * 0.5), (0.02, 0.0)):
        limit.observe(deviation)
        assert limit.gap_margin(0.4) == pytest.approx(margin)
