"""What a follower says beforehand of its braking behind one that falls silent."""

from hypothesis import assume, given
from hypothesis import strategies as st

from tests.made.vehicles.two_cars import LATENCY, LENGTH, PERIOD, TICK, Road, profile
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.speed import SpacingPolicy
from vehicles.schedule import SECOND

SILENT_AT = 3 * SECOND
HARD = DegradationSettings().firm.deceleration
LATE = SILENT_AT + 4 * PERIOD
"""By then three messages are missing."""


def convoy(speed: float, gap: float) -> Road:
    """Two cars of a convoy at a common speed, which is to keep the gap (m) between the bodies."""
    policy = SpacingPolicy(LENGTH + gap, 0.0)
    return Road(profile(speed), speed=speed, spacing=LENGTH + gap, policy=policy)


def announced(road: Road, until: int, *, heard_again: int = 10**12) -> dict[int, int]:
    """When it said it would brake (ns), by instant; the one ahead goes on, and is silent."""
    said = {}
    while road.now < until and road.speed > 0.5:
        now = road.now
        road.tick(0.0, received=not SILENT_AT <= now < heard_again)
        said[now] = road.guard.brakes_at
    return said


def begins_hard(road: Road) -> int:
    """Instant (ns) of its first command harder than comfortable braking."""
    tick = next(
        k for k, asked in enumerate(road.commands) if asked < -HARD and k * TICK > SILENT_AT
    )
    return tick * TICK


@given(st.floats(15.0, 36.0), st.floats(10.0, 40.0))
def test_what_it_says_comes_true(speed: float, gap: float) -> None:
    road = convoy(speed, gap)
    said = announced(road, SILENT_AT + 6 * SECOND)
    assume(said[LATE])  # it keeps the safe distance
    hard = begins_hard(road)
    told = [at for now, at in said.items() if LATE <= now < hard]
    assert told
    # It begins a little before its reserve is used up, and mildly.
    assert max(told) < hard + 0.3 * SECOND
    assert hard - min(told) < 0.6 * SECOND


@given(st.floats(15.0, 36.0))
def test_the_instant_stays_while_it_brakes(speed: float) -> None:
    road = convoy(speed, 20.0)
    said = announced(road, SILENT_AT + 3 * SECOND)
    hard = begins_hard(road)
    assert len({at for now, at in said.items() if now > hard}) == 1


@given(st.floats(20.0, 36.0))
def test_who_never_kept_the_safe_distance_says_nothing_until_it_does(speed: float) -> None:
    road = convoy(speed, 3.0)
    said = announced(road, SILENT_AT + 6 * SECOND)
    assert said[SILENT_AT] == said[SILENT_AT + 2 * PERIOD] == 0
    for now, asked in zip(said, road.commands, strict=True):
        assert asked >= -HARD or 0 < said[now] <= now


def test_it_takes_it_back_once_the_one_ahead_is_heard() -> None:
    road = convoy(30.0, 20.0)
    again = SILENT_AT + SECOND
    said = announced(road, again + SECOND, heard_again=again)
    assert said[again - TICK] < again
    assert {at for now, at in said.items() if now > again + PERIOD + LATENCY + TICK} == {0}
