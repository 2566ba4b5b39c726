"""Announcements of braking behind a predecessor that falls silent."""

from hypothesis import assume, given
from hypothesis import strategies as st

from tests.made.vehicles.two_cars import LATENCY, LENGTH, PERIOD, TICK, Road, profile
from vehicles.driver.controller import SpacingPolicy
from vehicles.driver.settings import DegradationSettings
from vehicles.schedule import SECOND

SILENT_AT = 3 * SECOND
HARD = DegradationSettings().firm.deceleration
LATE = SILENT_AT + 4 * PERIOD
"""Three messages are missing by then."""


def convoy(speed: float, gap: float) -> Road:
    """Two cars of a convoy at a common speed, which is to keep the gap (m) between the bodies."""
    policy = SpacingPolicy(LENGTH + gap, 0.0)
    return Road(profile(speed), speed=speed, spacing=LENGTH + gap, policy=policy)


def announced(road: Road, until: int, *, received_again: int = 10**12) -> dict[int, int]:
    """Announced instants of braking (ns) by instant; the predecessor continues silently."""
    predicted = {}
    while road.now < until and road.speed > 0.5:
        now = road.now
        road.tick(0.0, received=not SILENT_AT <= now < received_again)
        predicted[now] = road.guard.brakes_at
    return predicted


def begins_hard(road: Road) -> int:
    """Instant (ns) of its first command harder than comfortable braking."""
    tick = next(
        k for k, command in enumerate(road.commands) if command < -HARD and k * TICK > SILENT_AT
    )
    return tick * TICK


@given(st.floats(15.0, 36.0), st.floats(10.0, 40.0))
def test_it_brakes_as_announced(speed: float, gap: float) -> None:
    road = convoy(speed, gap)
    predicted = announced(road, SILENT_AT + 6 * SECOND)
    assume(predicted[LATE])  # it keeps the safe distance
    hard = begins_hard(road)
    instants = [at for now, at in predicted.items() if LATE <= now < hard]
    assert instants
    # It begins mildly, shortly before its reserve is used up.
    assert max(instants) < hard + 0.3 * SECOND
    assert hard - min(instants) < 0.6 * SECOND


def test_reception_withdraws_the_announcement() -> None:
    road = convoy(30.0, 20.0)
    again = SILENT_AT + SECOND
    predicted = announced(road, again + SECOND, received_again=again)
    assert predicted[again - TICK] < again
    assert {at for now, at in predicted.items() if now > again + PERIOD + LATENCY + TICK} == {0}
