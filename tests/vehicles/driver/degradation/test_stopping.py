import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicles.car.tyres import GRAVITY
from vehicles.driver.degradation.settings import Braking, DegradationSettings
from vehicles.driver.degradation.stopping import (
    friction_left,
    needed_deceleration,
    stopping_distance,
)

SPEEDS = st.floats(0.1, 40.0)
ACCELERATIONS = st.floats(-7.0, 2.0)
BRAKINGS = st.builds(Braking, st.floats(0.2, 8.0), st.floats(0.1, 20.0))
STEP = 1e-3


def driven(speed: float, acceleration: float, braking: Braking) -> float:
    """Distance (m) to a standstill, by trapezoidal steps."""
    distance = 0.0
    while speed > 0.0:
        wanted = -braking.deceleration - acceleration
        change = min(max(wanted, -braking.jerk * STEP), braking.jerk * STEP)
        slower = speed + (acceleration + 0.5 * change) * STEP
        distance += 0.5 * (speed + max(slower, 0.0)) * STEP
        speed, acceleration = slower, acceleration + change
    return distance


@given(SPEEDS, ACCELERATIONS, BRAKINGS)
def test_the_stopping_distance_is_the_distance_driven(
    speed: float, acceleration: float, braking: Braking
) -> None:
    found = stopping_distance(speed, acceleration, braking)
    assert found == pytest.approx(driven(speed, acceleration, braking), rel=2e-3, abs=0.02)


def test_stops_calculated_by_hand() -> None:
    emergency = stopping_distance(15.0, 0.0, DegradationSettings().emergency)
    ramp = 6.0 / 12.0
    left = 15.0 - 0.5 * 12.0 * ramp**2
    assert emergency == pytest.approx(15.0 * ramp - 12.0 * ramp**3 / 6.0 + left**2 / 12.0)
    assert stopping_distance(15.0, -6.0, DegradationSettings().emergency) == 225.0 / 12.0
    assert stopping_distance(0.0, 0.0, DegradationSettings().emergency) == 0.0


@given(SPEEDS, st.floats(0.1, 10.0), ACCELERATIONS, BRAKINGS)
def test_faster_cars_need_more_distance_and_harder_braking_less(
    speed: float, faster: float, acceleration: float, braking: Braking
) -> None:
    found = stopping_distance(speed, acceleration, braking)
    assert 0.0 < found < stopping_distance(speed + faster, acceleration, braking)
    harder = Braking(braking.deceleration + 0.1, braking.jerk)
    assert stopping_distance(speed, acceleration, harder) <= found + 1e-9


@given(SPEEDS, st.floats(0.01, 500.0))
def test_without_a_jerk_limit_the_car_stops_exactly_at_the_end(
    speed: float, distance: float
) -> None:
    needed = needed_deceleration(speed, distance)
    assert needed == pytest.approx(speed * speed / (2.0 * distance))
    stop = Braking(needed, 1.0)
    assert stopping_distance(speed, -needed, stop) == pytest.approx(distance)


@given(SPEEDS, st.floats(0.5, 500.0), ACCELERATIONS, st.floats(0.1, 20.0))
def test_the_needed_deceleration_is_the_smallest_that_stops_within_the_distance(
    speed: float, distance: float, acceleration: float, jerk: float
) -> None:
    needed = needed_deceleration(speed, distance, acceleration, jerk)
    if needed == math.inf:
        assert stopping_distance(speed, acceleration, Braking(100.0, jerk)) > distance
        return
    assert stopping_distance(speed, acceleration, Braking(needed, jerk)) <= distance + 1e-6
    if needed > 0.01:  # else the car stops before the end while it releases the brake
        milder = Braking(0.99 * needed, jerk)
        assert stopping_distance(speed, acceleration, milder) >= distance - 1e-6


def test_zero_distance_needs_infinite_deceleration_unless_the_car_stands() -> None:
    assert needed_deceleration(0.0, -1.0) == 0.0
    assert needed_deceleration(0.1, 0.0) == needed_deceleration(9.0, -1.0) == math.inf


@given(st.floats(0.1, 1.2), st.floats(-15.0, 15.0))
def test_remaining_friction_is_within_the_friction_circle(friction: float, lateral: float) -> None:
    left = friction_left(friction, lateral)
    limit = friction * GRAVITY
    assert left == 0.0 if abs(lateral) >= limit else math.hypot(left, lateral) <= limit + 1e-9
    assert friction_left(friction, 0.0) == pytest.approx(limit)
