import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicles.driver.controller import predicted_motion
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


@given(SPEEDS, st.floats(0.5, 500.0))
def test_the_needed_deceleration_stops_within_the_distance(speed: float, distance: float) -> None:
    braking = Braking(needed_deceleration(speed, distance), 1e6)
    assert stopping_distance(speed, 0.0, braking) == pytest.approx(distance, rel=5e-3)
    assert needed_deceleration(speed, 0.0) == math.inf


@given(
    speed=st.floats(0.0, 40.0),
    achieved=st.floats(-8.0, 2.0),
    command=st.floats(-2.4, 2.0),
    age=st.floats(0.0, 0.5),
    lag=st.floats(0.05, 1.0),
)
def test_a_prediction_integrates_the_drive(
    speed: float, achieved: float, command: float, age: float, lag: float
) -> None:
    """Achieved acceleration approaches the command with the lag; Euler steps of a millisecond."""
    found = predicted_motion(speed, achieved, command, age, lag)
    driven, now, acceleration, count = 0.0, speed, achieved, 2000
    for _ in range(count):
        driven += (now + 0.5 * acceleration * age / count) * age / count
        now += acceleration * age / count
        acceleration += (command - acceleration) * age / count / lag
    if now > 0.05:
        assert found.speed == pytest.approx(now, abs=0.02)
        assert found.driven == pytest.approx(driven, abs=0.02)
    elif now < -0.05:
        assert found.speed == 0.0


def test_hard_braking_lasts_in_a_prediction_and_mild_braking_does_not() -> None:
    hard = predicted_motion(30.0, -6.0, -6.0, 2.0, 0.0)
    assert (hard.speed, hard.driven, hard.acceleration) == pytest.approx((18.0, 48.0, -6.0))
    mild = predicted_motion(30.0, -1.0, -1.0, 2.0, 0.0)
    assert (mild.speed, mild.driven, mild.acceleration) == pytest.approx((29.5, 59.125, 0.0))
    standing = predicted_motion(6.0, -6.0, -6.0, 3.0, 0.0)
    assert (standing.speed, standing.driven) == pytest.approx((0.0, 3.0))
