"""Behind a car that announced to stop, and then was silent or braked."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.vehicles.two_cars import (
    EMERGENCY,
    LENGTH,
    TICK,
    RecordingLaw,
    Road,
    keeping,
    profile,
)
from vehicles.driver.degradation.situation import Situation
from vehicles.driver.speed import SpeedLaw, VehiclesAhead
from vehicles.schedule import SECOND

ANNOUNCED = 3 * SECOND
"""When the one ahead begins to stop, as it said."""


class Announced(Road):
    """As `Road`, but the one ahead has announced when it stops, 0 for not."""

    stops_at = ANNOUNCED

    def _seen(self, *, hazard: bool) -> tuple[VehiclesAhead, Situation]:
        ahead, situation = super()._seen(hazard=hazard)
        silent = situation.predecessor.age > 0.5
        situation.predecessor = replace(
            situation.predecessor,
            stops_at=self.stops_at,
            status="lost" if silent else "fresh",
        )
        return ahead, situation

    def braking(self) -> float:
        """What the one ahead does: as hard as it can from the announced instant on."""
        since = (self.now - ANNOUNCED) / SECOND
        return -min(max(since, 0.0) * EMERGENCY.jerk, EMERGENCY.deceleration)


@given(st.floats(5.0, 36.0), st.floats(1.1, 20.0), st.floats(0.1, 0.6))
def test_it_stands_behind_the_one_that_brakes_unheard(
    speed: float, gap: float, silence: float
) -> None:
    road = Announced(profile(speed), speed=speed, spacing=LENGTH + gap)
    while road.speed > 0.0 and road.now < 30 * SECOND:
        road.tick(road.braking(), received=road.now < ANNOUNCED - silence * SECOND)
    # Both brake alike from one instant on: the follower's is the next tick, as is its margin.
    assert road.least > min(gap, 1.0) - (speed * TICK / SECOND + 0.1)
    assert min(road.commands) >= -EMERGENCY.deceleration


def test_without_the_announcement_it_hits_it() -> None:
    road = Announced(profile(30.0), speed=30.0, spacing=LENGTH + 3.0)
    road.stops_at = 0
    for _ in range(500):
        road.tick(road.braking(), received=road.now < ANNOUNCED - 0.3 * SECOND)
    assert road.least < 0.0


@pytest.mark.parametrize("law", [keeping(), profile()])
def test_before_the_announced_instant_nothing_changes(law: SpeedLaw) -> None:
    recording = RecordingLaw(law)
    road = Announced(recording)
    while road.now < ANNOUNCED:
        assert road.tick(0.0, received=True) is recording.commands[-1]


def test_it_stops_bracing_itself_once_the_one_ahead_is_heard_to_go_on() -> None:
    road = Announced(profile())
    while road.now < ANNOUNCED + 6 * TICK:
        road.tick(0.0, received=road.now < ANNOUNCED - SECOND // 3)
    assert road.commands[-1] < -1.0
    assert road.guard.stops_behind
    road.stops_at = 0
    for _ in range(1500):
        road.tick(0.0, received=True)
    assert road.speed == pytest.approx(25.0, abs=0.1)
    assert abs(road.commands[-1]) < 0.05
    assert not road.guard.stops_behind


@given(st.floats(0.5, 3.0), st.floats(10.0, 36.0))
def test_one_that_is_heard_to_brake_more_mildly_is_braced_for_only_shortly(
    milder: float, speed: float
) -> None:
    road = Announced(profile(speed), speed=speed, spacing=LENGTH + 10.0)
    while road.speed > 1.0 and road.ahead_speed > 1.0:
        road.tick(-milder if road.now >= ANNOUNCED else 0.0, received=True, hazard=True)
        if road.now > ANNOUNCED + 2 * SECOND:
            assert road.commands[-1] > -milder - 1.5
    assert road.least > 0.5
