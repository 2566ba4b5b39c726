"""The distance that a follower drives beyond its known path, and its path there."""

from dataclasses import dataclass, replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.made.examples import examples
from tests.made.transport.received_poses import received
from tests.made.vehicles.exact_drives import (
    START,
    Step,
    drive,
    on,
    received_from,
)
from tests.made.vehicles.exact_drives import Source as ExactSource
from tests.made.vehicles.followers import SPACING, STRAIGHT, follower, lead_of
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.degradation.situation import Situation
from vehicles.driver.degradation.source import Source
from vehicles.driver.degradation.sources import Sources
from vehicles.driver.ego.own_state import Pose
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments
from vehicles.messages import GpsPose
from vehicles.schedule import SECOND, nanoseconds

KNOWN = 5.0


def situation(speed: float, acceleration: float, period: float) -> Situation:
    """Situation of a follower at the origin that received its lead along a straight road."""
    settings = DegradationSettings()
    lead = Source("v1", 0.05, settings)
    pair = Sources([lead], settings, lead="v1", predecessor="v1", lateral=["v1"])
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


def blind_steps(path: SampledPath, speed: float, cut_at: float, seconds: float) -> list[Step]:
    """Steps without known path of a follower that receives its lead until `cut_at` (s)."""
    lead = lead_of(path, speed, ((0.0, cut_at),))
    driver = follower(lead="v1", predecessor="v1", speed=speed, degradation=DegradationSettings())
    steps = drive(driver, on(path, 0.0, speed), seconds, received_from(lead))
    return [step for step in steps if step.decision.situation.known < -0.1 and step.decision.fresh]


def test_the_curvature_fades_over_one_second_of_driving() -> None:
    path = path_from_segments([Segment(100.0, 0.0), Segment(600.0, 1 / 100)])
    steps = blind_steps(path, 20.0, 6.0, 12.0)
    speed, beyond = steps[0].body.speed, -steps[0].decision.situation.known
    for share, expected in ((0.0, 0.01), (0.25, 0.0075), (0.5, 0.005), (0.75, 0.0025), (2.0, 0.0)):
        found = steps[0].decision.errors.curvature_ahead(share * speed - beyond)
        assert found == pytest.approx(expected, abs=3e-4), share
    assert steps[-1].body.speed < 0.05


@dataclass
class StoppingPredecessor(ExactSource):
    """A predecessor that announces a stop from `stops_from` (number of a message) on."""

    stops_from: int = 80

    def message(self, seq: int) -> GpsPose:
        message = super().message(seq)
        return replace(message, mode="stop") if seq >= self.stops_from else message


def test_a_follower_stops_within_the_known_path_if_its_only_source_has_left_it() -> None:
    """The predecessor is received, but no pose beyond its announcement belongs to the path."""
    lead = lead_of(STRAIGHT, 10.0, ((0.0, 4.0),))
    predecessor = StoppingPredecessor("v2", STRAIGHT, SPACING, 10.0)
    driver = follower(speed=10.0, degradation=DegradationSettings())
    steps = drive(driver, on(STRAIGHT, 0.0, 10.0), 10.0, received_from(lead, predecessor))
    assert steps[-1].decision.situation.predecessor.status == "fresh"
    assert steps[-1].body.speed < 0.05
    assert min(step.decision.situation.known for step in steps[1:]) >= 0.0


SEGMENTS = st.lists(
    st.tuples(st.floats(10.0, 60.0), st.sampled_from([0.0, 1 / 60, -1 / 60, 1 / 150, -1 / 300])),
    min_size=4,
    max_size=8,
)


@examples(5, 100)
@given(SEGMENTS, st.floats(3.0, 9.0), st.floats(8.0, 18.0))
def test_the_extrapolated_curvature_never_exceeds_the_largest_received(
    pieces: list[tuple[float, float]], cut_at: float, speed: float
) -> None:
    path = path_from_segments(
        [Segment(40.0, 0.0), *(Segment(*piece) for piece in pieces), Segment(600.0, 0.0)]
    )
    received_until = 30.0 + speed * cut_at
    largest = max(
        abs(path.at(station / 2).curvature) for station in range(round(2 * received_until) + 1)
    )
    for step in blind_steps(path, speed, cut_at, cut_at + 6.0)[::10]:
        beyond = -step.decision.situation.known
        for distance in range(2, 100, 2):
            ahead = step.decision.errors.curvature_ahead(distance - beyond)
            assert abs(ahead) <= largest + 1e-6
