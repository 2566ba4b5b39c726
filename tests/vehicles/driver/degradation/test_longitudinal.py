"""Speed of a follower with late or no data, behind a predecessor that may brake."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.vehicles.two_cars import (
    EMERGENCY,
    LENGTH,
    LIMITS,
    PERIOD,
    POLICY,
    TICK,
    RecordingLaw,
    Road,
    keeping,
    profile,
)
from vehicles.driver.controller import LongitudinalSetup, SpacingPolicy
from vehicles.driver.longitudinal_laws import Acc, AccSettings
from vehicles.driver.settings import DegradationSettings, Reaction
from vehicles.driver.situation import friction_left
from vehicles.driver.speed import GapKeeping, SpeedLaw
from vehicles.schedule import SECOND


@pytest.mark.parametrize(("law", "braking"), [(keeping(), -0.5), (profile(), -0.02)])
def test_with_all_data_the_speed_law_decides_exactly(law: SpeedLaw, braking: float) -> None:
    recording = RecordingLaw(law)
    road = Road(recording)
    for step in range(600):
        command = road.tick(braking if 200 < step < 280 else 0.0, received=True)
        assert command is recording.commands[-1]


@pytest.mark.parametrize("reaction", ["extrapolate", "hold", "straight"])
def test_baselines_follow_their_law_whatever_is_lost(reaction: Reaction) -> None:
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
def test_no_collision_at_any_loss_and_braking(
    seed: int, loss: float, braking: float, begins: float, speed: float
) -> None:
    chance = Random(seed)
    road = Road(keeping(), speed=speed)
    for step in range(700):
        brakes = begins <= step * 0.02 < begins + 8.0
        road.tick(-braking if brakes else 0.0, received=chance.random() >= loss)
    assert road.least > 0.5


def acc() -> GapKeeping:
    policy = SpacingPolicy(POLICY.standstill, 1.2)
    return GapKeeping(policy, LIMITS, Acc(LongitudinalSetup(policy, LIMITS, LENGTH), AccSettings()))


@given(st.floats(0.5, 6.0), st.floats(0.0, 8.0), st.floats(5.0, 35.0))
def test_a_measured_gap_replaces_lost_messages_and_prevents_a_collision(
    braking: float, begins: float, speed: float
) -> None:
    road = Road(acc(), speed=speed, spacing=8.0 + 1.2 * speed, has_sensor=True)
    for step in range(700):
        road.tick(-braking if step * 0.02 >= begins else 0.0, received=step < 50)
    assert road.least > 0.5


def test_with_a_measured_gap_lost_messages_do_not_cause_braking() -> None:
    hardest = {}
    for has_sensor in (True, False):
        road = Road(acc(), spacing=8.0 + 1.2 * 25.0, has_sensor=has_sensor)
        for step in range(700):
            road.tick(0.0, received=step < 50)
        hardest[has_sensor] = -min(road.commands)
    assert hardest[True] < 0.01
    assert hardest[False] > 5.0


@given(st.floats(0.1, 1.0), st.floats(-0.3, 0.3), st.floats(5.0, 35.0))
def test_braking_is_limited_by_emergency_braking_and_friction(
    friction: float, yaw_rate: float, speed: float
) -> None:
    road = Road(profile(speed), speed=speed, friction=friction)
    road.yaw_rate = yaw_rate
    for step in range(200):
        left = friction_left(friction, road.speed * yaw_rate)
        command = road.tick(0.0, received=step < 50).acceleration
        assert command >= -max(min(EMERGENCY.deceleration, left), 0.1) - 1e-9


@pytest.mark.parametrize("known", [15.0, 60.0, 120.0, 400.0])
def test_without_data_it_stops_within_the_known_path(known: float) -> None:
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


@pytest.mark.parametrize("headway", [0.0, 0.5])
def test_without_the_lead_a_constant_distance_becomes_a_stable_headway(headway: float) -> None:
    policy = SpacingPolicy(12.0, headway)
    road = Road(GapKeeping(policy, LIMITS), policy=policy, speed=20.0)
    for step in range(2000):
        road.lead = "lost" if step > 100 else "fresh"
        road.tick(0.0, received=True)
    kept = road.ahead - road.place
    assert kept == pytest.approx(12.0 + max(headway, 0.35) * 20.0, abs=0.1)
    assert min(road.commands) >= -1.0 - 1e-9


@given(st.floats(25.0, 36.0), st.floats(2.0, 6.0))
def test_behind_a_predecessor_never_received_it_brakes_hard_once_that_is_lost(
    speed: float, gap: float
) -> None:
    """The convoy starts closer than is safe; the braking is announced."""
    lost_at = SECOND // 2
    road = Road(
        profile(speed), speed=speed, spacing=LENGTH + gap, policy=SpacingPolicy(LENGTH + gap, 0.0)
    )
    road.predecessor_lost_at = lost_at
    announced = {}
    for _ in range(200):
        now = road.now
        road.tick(0.0, received=False)
        announced[now] = road.guard.brakes_at
    before = [one for k, one in enumerate(road.commands) if k * TICK <= lost_at]
    comfortable = DegradationSettings().comfortable.deceleration
    assert min(before) > -comfortable - 1e-9
    needed = road.commands[(lost_at + SECOND // 2) // TICK]
    assert needed == pytest.approx(-EMERGENCY.deceleration)
    instants = {at for now, at in announced.items() if 4 * PERIOD < now < lost_at}
    assert instants
    assert min(instants) >= lost_at
    assert max(instants) < lost_at + 0.3 * SECOND


def test_the_gap_opens_comfortably_at_high_loss_and_closes_again() -> None:
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
