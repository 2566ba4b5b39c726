import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicles.driver.settings import Braking, DegradationSettings
from vehicles.driver.situation import needed_deceleration, stopping_distance

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
