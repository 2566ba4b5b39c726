"""The return to a path that has jumped, for a car that follows its return exactly."""

import math
from itertools import pairwise
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.vehicles.exact_drives import START
from vehicles.driver.tracking import (
    FARTHEST,
    REJOINING_ANGLE,
    REJOINING_LATERAL,
    Rejoining,
    TrackingErrors,
)
from vehicles.schedule import SECOND

TICK = SECOND // 50


class State(NamedTuple):
    """Errors (m, rad) and speed (m/s) of the car, and the allowed speed (m/s)."""

    lateral: float
    heading: float
    speed: float
    allowed: float


def drive_back(lateral: float, heading: float, speed: float) -> list[State]:
    """States per tick, from the jump until the return ends; the car brakes at 3 m/s²."""
    rejoining, now = Rejoining([]), START
    rejoining.corrected(now, TrackingErrors(0.0, 0.0, 0.0, 0.0), speed)
    errors = TrackingErrors(lateral, heading, 0.0, 0.0)
    states = []
    for _ in range(10_000):
        now += TICK
        left = rejoining.corrected(now, errors, speed)
        states.append(State(errors.lateral, errors.heading, speed, rejoining.speed_limit))
        if not rejoining.is_active:
            return states
        # The car is where its return is: without an error relative to it.
        errors = TrackingErrors(
            errors.lateral - left.lateral, errors.heading - left.heading, 0.0, 0.0
        )
        if speed > rejoining.speed_limit:
            speed = max(speed - 3.0 * TICK / SECOND, rejoining.speed_limit)
    raise AssertionError("the return does not end")


def curvatures(states: list[State]) -> list[tuple[float, float]]:
    """Curvature (1/m) of the return and the speed (m/s), between parts of it."""
    found = []
    for before, after in pairwise(states):
        driven = after.speed * TICK / SECOND
        found.append(((after.heading - before.heading) / driven, after.speed))
    return found


far = st.floats(0.4, 5.0).flatmap(lambda away: st.sampled_from([away, -away]))


@given(far, st.floats(-0.1, 0.1), st.floats(0.5, 30.0))
def test_a_car_returns_at_a_small_angle_and_lateral_acceleration(
    lateral: float, heading: float, speed: float
) -> None:
    states = drive_back(lateral, heading, speed)
    assert abs(states[-1].lateral) < 0.05
    assert abs(states[-1].heading) < 0.02
    assert max(abs(one.heading) for one in states) < REJOINING_ANGLE + 0.75 * abs(heading) + 0.01
    for curvature, at in curvatures(states):
        assert abs(curvature) * at**2 <= 1.2 * REJOINING_LATERAL + 0.1
    # It crosses the path only if its heading does so, within the limit of lateral acceleration.
    beyond = (heading * max(speed, 8.0)) ** 2 / REJOINING_LATERAL
    assert min(one.lateral * math.copysign(1.0, lateral) for one in states) > -beyond - 0.05


@pytest.mark.parametrize(
    ("lateral", "heading"), [(FARTHEST + 1.0, 0.0), (-FARTHEST - 1.0, 0.1), (2.0, 1.5), (0.5, -3.0)]
)
def test_a_car_that_cannot_return_stops_and_reports_it(lateral: float, heading: float) -> None:
    remarks: list[str] = []
    rejoining = Rejoining(remarks)
    rejoining.corrected(START, TrackingErrors(0.0, heading, 0.0, 0.0), 10.0)
    rejoining.corrected(START + TICK, TrackingErrors(lateral, heading, 0.0, 0.0), 10.0)
    assert rejoining.speed_limit == 0.0
    assert rejoining.is_active
    assert len(remarks) == 1
    rejoining.corrected(START + 2 * TICK, TrackingErrors(0.1, 0.0, 0.0, 0.0), 0.0)
    assert rejoining.speed_limit > 0.0


def test_a_car_corrects_its_error_from_a_path_that_jumps_all_the_time() -> None:
    """The positions behind the path have errors of decimetres; a cross wind moves the car."""
    rejoining, lateral, largest = Rejoining([]), 0.0, 0.0
    for k in range(3000):
        noise = 0.25 if k % 2 else -0.25
        errors = TrackingErrors(lateral + noise, 0.0, 0.0, 0.0)
        left = rejoining.corrected(START + k * TICK, errors, 4.0)
        lateral += (0.2 - left.lateral) * TICK / SECOND
        largest = max(largest, abs(lateral))
    assert largest < 1.0
