"""The speed of a follower that hears late or nothing, behind a car that does what it may."""

from dataclasses import replace
from itertools import pairwise
from math import nan
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.vehicles.two_cars import (
    EMERGENCY,
    LENGTH,
    LIMITS,
    PERIOD,
    TICK,
    RecordingLaw,
    Road,
    keeping,
    profile,
)
from vehicles.driver.degradation.settings import DegradationSettings, Reaction
from vehicles.driver.degradation.situation import Situation, SourceFreshness
from vehicles.driver.degradation.stopping import friction_left
from vehicles.driver.ego.own_state import Pose
from vehicles.driver.speed import (
    GapKeeping,
    SpacingPolicy,
    SpeedLaw,
    VehiclesAhead,
)
from vehicles.schedule import MILLISECOND, SECOND


@pytest.mark.parametrize(("law", "braking"), [(keeping(), -0.5), (profile(), -0.02)])
def test_as_long_as_all_is_heard_the_law_decides_to_the_bit(law: SpeedLaw, braking: float) -> None:
    recording = RecordingLaw(law)
    road = Road(recording)
    for step in range(600):
        command = road.tick(braking if 200 < step < 280 else 0.0, received=True)
        assert command is recording.commands[-1]


def test_a_common_speed_is_given_up_when_the_gap_has_become_narrower() -> None:
    road = Road(profile())
    for step in range(600):
        road.tick(
            -0.5 if 200 < step < 280 else 0.0, received=True
        )  # 0.8 m/s slower than the common
    assert road.spacing > 14.0


@pytest.mark.parametrize("reaction", ["extrapolate", "hold", "straight"])
def test_the_baselines_drive_as_their_law_whatever_is_lost(reaction: Reaction) -> None:
    recording = RecordingLaw(profile())
    road = Road(recording, reaction=reaction)
    for step in range(600):
        assert road.tick(-6.0, received=step < 50) is recording.commands[-1]
    assert road.least < 0.0


@given(
    st.integers(0, 2**31),
    st.sampled_from([0.0, 0.5, 0.8, 0.9, 0.97, 1.0]),
    st.floats(0.5, 6.0),
    st.floats(0.0, 4.0),
    st.floats(5.0, 35.0),
)
def test_nobody_is_hit_whatever_is_lost_and_however_hard_the_one_ahead_brakes(
    seed: int, loss: float, braking: float, begins: float, speed: float
) -> None:
    chance = Random(seed)
    road = Road(keeping(), speed=speed)
    for step in range(700):
        brakes = begins <= step * 0.02 < begins + 8.0
        road.tick(-braking if brakes else 0.0, received=chance.random() >= loss)
    assert road.least > 0.5


@given(st.floats(0.1, 1.0), st.floats(-0.3, 0.3), st.floats(5.0, 35.0))
def test_never_more_than_the_hardest_braking_or_than_friction_leaves(
    friction: float, yaw_rate: float, speed: float
) -> None:
    road = Road(profile(speed), speed=speed, friction=friction)
    road.yaw_rate = yaw_rate
    for step in range(200):
        left = friction_left(friction, road.speed * yaw_rate)
        asked = road.tick(0.0, received=step < 50).acceleration
        assert asked >= -max(min(EMERGENCY.deceleration, left), 0.1) - 1e-9


@given(st.floats(2.0, 60.0), st.floats(0.1, 30.0), st.floats(0.0, 30.0))
def test_a_wider_gap_never_brakes_harder(gap: float, wider: float, speed: float) -> None:
    asked = []
    for apart in (gap, gap + wider):
        road = Road(keeping(), speed=speed, spacing=apart)
        road.tick(0.0, received=True)
        road.known = (0, apart, speed, 0.0)
        road.now = 400 * MILLISECOND
        asked.append(road.tick(0.0, received=False).acceleration)
    assert asked[0] <= asked[1] + 1e-9


def test_the_gap_opens_comfortably_while_little_is_heard_and_closes_again() -> None:
    road = Road(GapKeeping(SpacingPolicy(8.0, 1.5), LIMITS), policy=SpacingPolicy(8.0, 1.5))
    usual = road.spacing
    for step in range(1500):  # one message in ten
        road.tick(0.0, received=step % 25 == 0)
    comfortable = DegradationSettings().comfortable
    assert min(road.commands) >= -comfortable.deceleration - 1e-9
    opened = road.ahead - road.place - usual
    assert opened > 0.3 * road.speed
    for _ in range(3000):
        road.tick(0.0, received=True)
    assert road.ahead - road.place == pytest.approx(usual, abs=0.1)
    assert road.commands[-1] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("known", [15.0, 60.0, 120.0, 400.0])
def test_a_car_that_hears_nobody_stops_within_the_road_it_knows(known: float) -> None:
    road = Road(profile(20.0), speed=20.0, spacing=1000.0)
    road.tick(0.0, received=True)
    road.path = known
    road.mode = "coast" if known > 300.0 else "stop"
    emergency = 0.0
    for _ in range(4000):
        braking = -road.tick(0.0, received=False).acceleration
        emergency = max(emergency, braking if road.speed > 0.5 else 0.0)
    assert road.speed == 0.0
    shortest = 20.0**2 / 12.0 + 20.0 * 0.25 - 6.0 * 0.5**2 / 24.0  # 6 m/s² within half a second
    if known > shortest:
        assert 0.0 <= road.path < 1.0
        assert emergency < 1.3 * 20.0**2 / (2.0 * known)
    else:
        assert emergency == pytest.approx(6.0)
        assert -road.path == pytest.approx(shortest - known, rel=0.05)


def test_a_stopping_predecessor_that_says_so_is_answered_at_once() -> None:
    road = Road(keeping())
    for _ in range(50):
        road.tick(0.0, received=True)
    for _ in range(5):
        road.tick(-6.0, received=True, hazard=True)
    assert road.commands[-1] < -5.0


def test_a_car_that_fell_behind_the_common_speed_catches_up_and_drives_it_again() -> None:
    law = profile()
    road = Road(law, spacing=40.0, policy=SpacingPolicy(40.0))
    for step in range(4000):
        road.tick(0.0, received=not 100 <= step < 300)
    assert min(road.commands) < -0.5
    assert road.ahead - road.place == pytest.approx(40.0, abs=0.6)
    assert road.speed == pytest.approx(25.0, abs=0.1)
    steps = [after - before for before, after in pairwise(road.commands)]
    jerk = EMERGENCY.jerk * TICK / SECOND
    assert max(steps) <= jerk + 1e-9
    situation = replace(Situation(), predecessor=SourceFreshness(age=0.02))
    pose = Pose(road.place, 0.0, 0.0, road.speed, 0.0)
    ahead = VehiclesAhead(40.0, 25.0, 25.0)
    asked = law.command(road.now, pose, ahead)
    assert road.guard.command(road.now, pose, ahead, situation, "composite") == asked


@pytest.mark.parametrize("headway", [0.0, 0.5])
def test_without_the_lead_a_constant_distance_becomes_a_headway_that_is_stable(
    headway: float,
) -> None:
    policy = SpacingPolicy(12.0, headway)
    road = Road(GapKeeping(policy, LIMITS), policy=policy, speed=20.0)
    for step in range(2000):
        road.lead = "lost" if step > 100 else "fresh"
        road.tick(0.0, received=True)
    kept = road.ahead - road.place
    assert kept == pytest.approx(12.0 + max(headway, 0.35) * 20.0, abs=0.1)
    assert min(road.commands) >= -1.0 - 1e-9


def test_who_stops_without_a_known_path_brakes_as_hard_as_it_can() -> None:
    road = Road(profile())
    road.mode, road.path = "stop", nan
    for _ in range(300):
        road.tick(0.0, received=True)
    assert min(road.commands) == pytest.approx(-EMERGENCY.deceleration)
    assert road.speed < 0.01


@given(st.floats(25.0, 36.0), st.floats(2.0, 6.0))
def test_behind_one_that_was_never_heard_it_brakes_hard_when_that_would_be_lost(
    speed: float, gap: float
) -> None:
    """Where the convoy begins closer than is safe; and says so beforehand."""
    lost_at = SECOND // 2
    road = Road(
        profile(speed), speed=speed, spacing=LENGTH + gap, policy=SpacingPolicy(LENGTH + gap, 0.0)
    )
    road.predecessor_lost_at = lost_at
    said = {}
    for _ in range(200):
        now = road.now
        road.tick(0.0, received=False)
        said[now] = road.guard.brakes_at
    before = [one for k, one in enumerate(road.commands) if k * TICK <= lost_at]
    comfortable = DegradationSettings().comfortable.deceleration
    assert min(before) > -comfortable - 1e-9
    needed = road.commands[(lost_at + SECOND // 2) // TICK]
    assert needed == pytest.approx(-EMERGENCY.deceleration)
    told = {at for now, at in said.items() if 4 * PERIOD < now < lost_at}
    assert told
    assert min(told) >= lost_at
    assert max(told) < lost_at + 0.3 * SECOND
