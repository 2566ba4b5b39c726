"""Predicted distance beyond the known path in an emergency stop."""

from hypothesis import assume, given
from hypothesis import strategies as st

from tests.made.transport.received_poses import received
from tests.made.vehicles.exact_drives import START
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.degradation.situation import Situation
from vehicles.driver.degradation.source import Source
from vehicles.driver.degradation.sources import SourcePair
from vehicles.driver.ego.own_state import Pose
from vehicles.schedule import SECOND, nanoseconds

KNOWN = 5.0


def situation(speed: float, acceleration: float, period: float) -> Situation:
    """Situation of a follower at the origin that received its lead along a straight road."""
    settings = DegradationSettings()
    lead = Source("v1", 0.05, settings)
    pair = SourcePair(lead, lead, "composite", settings)
    for seq, east in enumerate((-KNOWN, 0.0, KNOWN)):
        lead.receive(received(START + seq, east, 0.0, 0.0, speed, seq=seq))
    pose = Pose(0.0, 0.0, 0.0, speed, 0.0)
    pair.assess(START + SECOND, pose, acceleration, refit=True)
    return pair.assess(START + SECOND + nanoseconds(period), pose, acceleration, refit=True)


def driven(speed: float, acceleration: float, period: float) -> float:
    """Distance (m) to a standstill with commands that are held and limited in jerk."""
    emergency, east = DegradationSettings().emergency, 0.0
    while True:
        acceleration = max(acceleration - emergency.jerk * period, -emergency.deceleration)
        if speed + acceleration * period <= 0.0:
            return east - speed**2 / (2.0 * acceleration)
        east += speed * period + 0.5 * acceleration * period**2
        speed += acceleration * period


@given(st.floats(10.0, 36.0), st.floats(-5.0, 1.0), st.sampled_from([0.01, 0.02, 0.05, 0.1]))
def test_the_blind_distance_accounts_for_held_commands(
    speed: float, acceleration: float, period: float
) -> None:
    predicted = situation(speed, acceleration, period)
    blind = driven(speed, acceleration, period) - predicted.known
    assume(blind > 0.0)
    # Without that, it would be off by 0.5 * speed * period. The last step to the hardest braking is
    # a partial one.
    assert abs(predicted.blind - blind) < 0.1 * speed * period + 1e-3
