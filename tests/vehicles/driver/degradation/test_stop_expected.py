"""A follower behind a predecessor that announced a stop, and then was silent or braked."""

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
from vehicles.driver.controller import VehiclesAhead
from vehicles.driver.situation import Situation
from vehicles.driver.speed import SpeedLaw
from vehicles.schedule import SECOND

ANNOUNCED = 3 * SECOND
"""Announced instant at which the predecessor begins to stop."""


class Announced(Road):
    """`Road` whose predecessor has announced its stop (`stops_at`, 0 for none)."""

    stops_at = ANNOUNCED

    def _seen(self, *, hazard: bool) -> tuple[VehiclesAhead, Situation]:
        ahead, situation = super()._seen(hazard=hazard)
        silent = situation.predecessor.age > 0.5
        situation.predecessor = replace(
            situation.predecessor, stops_at=self.stops_at, status="lost" if silent else "fresh"
        )
        return ahead, situation

    def braking(self) -> float:
        """Acceleration of the predecessor: emergency braking from the announced instant on."""
        since = (self.now - ANNOUNCED) / SECOND
        return -min(max(since, 0.0) * EMERGENCY.jerk, EMERGENCY.deceleration)


@given(st.floats(5.0, 36.0), st.floats(1.1, 20.0), st.floats(0.1, 0.6))
def test_it_stops_behind_a_silent_predecessor_that_brakes(
    speed: float, gap: float, silence: float
) -> None:
    road = Announced(profile(speed), speed=speed, spacing=LENGTH + gap)
    while road.speed > 0.0 and road.now < 30 * SECOND:
        road.tick(road.braking(), received=road.now < ANNOUNCED - silence * SECOND)
    # Both brake equally; the follower begins up to one tick later.
    assert road.least > min(gap, 1.0) - (speed * TICK / SECOND + 0.1)
    assert min(road.commands) >= -EMERGENCY.deceleration


@pytest.mark.parametrize("law", [keeping(), profile()])
def test_before_the_announced_instant_nothing_changes(law: SpeedLaw) -> None:
    recording = RecordingLaw(law)
    road = Announced(recording)
    while road.now < ANNOUNCED:
        assert road.tick(0.0, received=True) is recording.commands[-1]


@given(st.floats(0.5, 3.0), st.floats(10.0, 36.0))
def test_a_received_milder_braking_ends_the_assumed_stop(milder: float, speed: float) -> None:
    road = Announced(profile(speed), speed=speed, spacing=LENGTH + 10.0)
    while road.speed > 1.0 and road.ahead_speed > 1.0:
        road.tick(-milder if road.now >= ANNOUNCED else 0.0, received=True, hazard=True)
        if road.now > ANNOUNCED + 2 * SECOND:
            assert road.commands[-1] > -milder - 1.5
    assert road.least > 0.5
