"""The return to a path that has jumped, for a car that follows its return exactly."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.vehicles.exact_drives import START, drive, on, received_from
from tests.made.vehicles.followers import STRAIGHT, follower, lead_of, predecessor_of
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.tracking import (
    FARTHEST,
    REJOINING_ANGLE,
    REJOINING_LATERAL,
    Rejoining,
    TrackingErrors,
)
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.fusion import CompositeFusion, SourceFusion, Trajectories
from vehicles.preview.trajectory import SourceWindow
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


class Jumping(SourceFusion):
    """Composite trajectory that jumps by 1 m to the left, and is two equal ones soon after."""

    separate, calls = False, 0

    def fuse(self, sources: Sequence[SourceWindow], settings: FitSettings) -> Trajectories:
        self.calls += 1
        if self.calls > 40:
            moved = [one.window._replace(north=one.window.north + 1.0) for one in sources]
            sources = [one._replace(window=to) for one, to in zip(sources, moved, strict=True)]
        along = CompositeFusion().fuse(sources, settings)
        return [(0.5, fit) for _, fit in along] * 2 if self.calls > 43 else along


def test_a_return_ends_also_along_several_trajectories() -> None:
    driver = follower(degradation=DegradationSettings())
    driver.fusion = Jumping()
    received = received_from(lead_of(STRAIGHT), predecessor_of(STRAIGHT))
    steps = drive(driver, on(STRAIGHT, 0.0, 10.0), 9.0, received)
    assert any(step.decision.situation.hazard for step in steps)
    assert not steps[-1].decision.situation.hazard
    assert steps[-1].decision.situation.speed_limit == math.inf
    assert steps[-1].body.north == pytest.approx(1.0, abs=0.05)
    assert max(abs(step.body.yaw_rate) * 10.0 for step in steps) < 2.5
