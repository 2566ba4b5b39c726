"""The speed of a follower that hears late or nothing, behind a car that does what it may."""

from dataclasses import replace
from itertools import pairwise
from math import inf, nan
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicles.driver.degradation.settings import DegradationSettings, Reaction
from vehicles.driver.degradation.situation import Situation, SourceFreshness
from vehicles.driver.degradation.slowing.longitudinal import GuardedCar, SpeedGuard
from vehicles.driver.degradation.slowing.stopping import friction_left
from vehicles.driver.ego.own_state import Pose
from vehicles.driver.speed import (
    GapKeeping,
    GapLimits,
    GapPolicy,
    ProfileSpeed,
    SpeedCommand,
    SpeedLaw,
    SpeedProfile,
    VehiclesAhead,
)
from vehicles.messages import Mode, SourceStatus
from vehicles.schedule import MILLISECOND, SECOND

TICK, PERIOD, LATENCY = 20 * MILLISECOND, 50 * MILLISECOND, 20 * MILLISECOND
LENGTH, LIMITS = 4.93, GapLimits(2.0, 6.0)
POLICY = GapPolicy(8.0, 0.5)
HARDEST = DegradationSettings().hardest


class Road:
    """Two cars on a straight: the follower hears some messages of the one ahead, exact and late.

    `heard` tells whether the message of an instant (s) is, `braking` what the one ahead does then.
    """

    def __init__(
        self,
        law: SpeedLaw,
        *,
        speed: float = 25.0,
        gap: float | None = None,
        reaction: Reaction = "degrade",
        friction: float = 0.9,
        policy: GapPolicy = POLICY,
    ) -> None:
        self.gap = policy.desired(speed) if gap is None else gap
        car = GuardedCar(
            length=LENGTH,
            friction=friction,
            policy=policy,
            limits=LIMITS,
            initial_gap=self.gap,
            period=PERIOD / SECOND,
        )
        self.guard = SpeedGuard(law, DegradationSettings(reaction=reaction), car)
        self.law = law
        self.ahead, self.place = self.gap, 0.0
        self.ahead_speed = self.speed = speed
        self.ahead_acceleration = 0.0
        self.now = 0
        self.heard: list[tuple[int, float, float, float]] = []
        self.known: tuple[int, float, float, float] | None = None
        self.yaw_rate = 0.0
        self.lead: SourceStatus = "fresh"
        self.mode: Mode = "composite"
        self.path = nan
        self.commands: list[float] = []
        self.least = inf

    def tick(self, acceleration: float, *, heard: bool, hazard: bool = False) -> SpeedCommand:
        """One control period: send, hear, decide, move on."""
        self.ahead_acceleration = acceleration
        if heard and self.now % PERIOD < TICK:
            self.heard.append((self.now, self.ahead, self.ahead_speed, acceleration))
        while self.heard and self.heard[0][0] + LATENCY <= self.now:
            self.known = self.heard.pop(0)
        pose = Pose(self.place, 0.0, 0.0, self.speed, self.yaw_rate)
        vehicles, situation = self._seen(hazard=hazard)
        command = self.guard.command(self.now, pose, vehicles, situation, self.mode)
        self.commands.append(command.acceleration)
        self._move(command.acceleration)
        return command

    def _seen(self, *, hazard: bool) -> tuple[VehiclesAhead, Situation]:
        situation = Situation(lead=SourceFreshness(status=self.lead), known=self.path)
        if self.known is None:
            return VehiclesAhead(), situation
        measured_at, place, speed, acceleration = self.known
        age = (self.now - measured_at) / SECOND
        situation.predecessor = SourceFreshness(
            status="fresh", age=age, hazard=hazard, acceleration=acceleration
        )
        return VehiclesAhead(place + speed * age - self.place, speed, speed), situation

    def _move(self, acceleration: float) -> None:
        span = TICK / SECOND
        after = max(self.speed + acceleration * span, 0.0)
        self.place += 0.5 * (self.speed + after) * span
        self.path -= 0.5 * (self.speed + after) * span
        self.speed = after
        after = max(self.ahead_speed + self.ahead_acceleration * span, 0.0)
        self.ahead += 0.5 * (self.ahead_speed + after) * span
        self.ahead_speed = after
        self.now += TICK
        self.least = min(self.least, self.ahead - self.place - LENGTH)


def keeping() -> GapKeeping:
    return GapKeeping(POLICY, LIMITS)


def profile(speed: float = 25.0) -> ProfileSpeed:
    return ProfileSpeed(SpeedProfile((0.0,), (speed,)), 0, TICK / SECOND)


class Told:
    """A speed law that keeps what it asked."""

    def __init__(self, law: SpeedLaw) -> None:
        self.law = law
        self.asked: list[SpeedCommand] = []

    def command(self, now: int, pose: Pose, ahead: VehiclesAhead) -> SpeedCommand:
        self.asked.append(self.law.command(now, pose, ahead))
        return self.asked[-1]


@pytest.mark.parametrize(("law", "braking"), [(keeping(), -0.5), (profile(), -0.02)])
def test_as_long_as_all_is_heard_the_law_decides_to_the_bit(law: SpeedLaw, braking: float) -> None:
    told = Told(law)
    road = Road(told)
    for step in range(600):
        command = road.tick(braking if 200 < step < 280 else 0.0, heard=True)
        assert command is told.asked[-1]


def test_a_common_speed_is_given_up_when_the_gap_has_become_narrower() -> None:
    road = Road(profile())
    for step in range(600):
        road.tick(-0.5 if 200 < step < 280 else 0.0, heard=True)  # 0.8 m/s slower than the common
    assert road.gap > 14.0


@pytest.mark.parametrize("reaction", ["extrapolate", "hold", "straight"])
def test_the_baselines_drive_as_their_law_whatever_is_lost(reaction: Reaction) -> None:
    told = Told(profile())
    road = Road(told, reaction=reaction)
    for step in range(600):
        assert road.tick(-6.0, heard=step < 50) is told.asked[-1]
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
        road.tick(-braking if brakes else 0.0, heard=chance.random() >= loss)
    assert road.least > 0.5


@given(st.floats(0.1, 1.0), st.floats(-0.3, 0.3), st.floats(5.0, 35.0))
def test_never_more_than_the_hardest_braking_or_than_friction_leaves(
    friction: float, yaw_rate: float, speed: float
) -> None:
    road = Road(profile(speed), speed=speed, friction=friction)
    road.yaw_rate = yaw_rate
    for step in range(200):
        left = friction_left(friction, road.speed * yaw_rate)
        asked = road.tick(0.0, heard=step < 50).acceleration
        assert asked >= -max(min(HARDEST.deceleration, left), 0.1) - 1e-9


@given(st.floats(2.0, 60.0), st.floats(0.1, 30.0), st.floats(0.0, 30.0))
def test_a_wider_gap_never_brakes_harder(gap: float, wider: float, speed: float) -> None:
    asked = []
    for apart in (gap, gap + wider):
        road = Road(keeping(), speed=speed, gap=apart)
        road.tick(0.0, heard=True)
        road.known = (0, apart, speed, 0.0)
        road.now = 400 * MILLISECOND
        asked.append(road.tick(0.0, heard=False).acceleration)
    assert asked[0] <= asked[1] + 1e-9


def test_the_gap_opens_comfortably_while_little_is_heard_and_closes_again() -> None:
    road = Road(GapKeeping(GapPolicy(8.0, 1.5), LIMITS), policy=GapPolicy(8.0, 1.5))
    usual = road.gap
    for step in range(1500):  # one message in ten
        road.tick(0.0, heard=step % 25 == 0)
    comfortable = DegradationSettings().comfortable
    assert min(road.commands) >= -comfortable.deceleration - 1e-9
    opened = road.ahead - road.place - usual
    assert opened > 0.3 * road.speed
    for _ in range(3000):
        road.tick(0.0, heard=True)
    assert road.ahead - road.place == pytest.approx(usual, abs=0.1)
    assert road.commands[-1] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("known", [15.0, 60.0, 120.0, 400.0])
def test_a_car_that_hears_nobody_stops_within_the_road_it_knows(known: float) -> None:
    road = Road(profile(20.0), speed=20.0, gap=1000.0)
    road.tick(0.0, heard=True)
    road.path = known
    road.mode = "coast" if known > 300.0 else "stop"
    hardest = 0.0
    for _ in range(4000):
        braking = -road.tick(0.0, heard=False).acceleration
        hardest = max(hardest, braking if road.speed > 0.5 else 0.0)
    assert road.speed == 0.0
    shortest = 20.0**2 / 12.0 + 20.0 * 0.25 - 6.0 * 0.5**2 / 24.0  # 6 m/s² within half a second
    if known > shortest:
        assert 0.0 <= road.path < 1.0
        assert hardest < 1.3 * 20.0**2 / (2.0 * known)
    else:
        assert hardest == pytest.approx(6.0)
        assert -road.path == pytest.approx(shortest - known, rel=0.05)


def test_a_stopping_predecessor_that_says_so_is_answered_at_once() -> None:
    road = Road(keeping())
    for _ in range(50):
        road.tick(0.0, heard=True)
    for _ in range(5):
        road.tick(-6.0, heard=True, hazard=True)
    assert road.commands[-1] < -5.0


def test_a_car_that_fell_behind_the_common_speed_catches_up_and_drives_it_again() -> None:
    law = profile()
    road = Road(law, gap=40.0, policy=GapPolicy(40.0))
    for step in range(4000):
        road.tick(0.0, heard=not 100 <= step < 300)
    assert min(road.commands) < -0.5
    assert road.ahead - road.place == pytest.approx(40.0, abs=0.6)
    assert road.speed == pytest.approx(25.0, abs=0.1)
    steps = [after - before for before, after in pairwise(road.commands)]
    jerk = HARDEST.jerk * TICK / SECOND
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
    policy = GapPolicy(12.0, headway)
    road = Road(GapKeeping(policy, LIMITS), policy=policy, speed=20.0)
    for step in range(2000):
        road.lead = "lost" if step > 100 else "fresh"
        road.tick(0.0, heard=True)
    kept = road.ahead - road.place
    assert kept == pytest.approx(12.0 + max(headway, 0.35) * 20.0, abs=0.1)
    assert min(road.commands) >= -1.0 - 1e-9
