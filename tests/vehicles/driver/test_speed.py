import math
from collections import deque
from itertools import accumulate, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.examples import examples
from vehicles.driver.controller import (
    GapLimits,
    LongitudinalSetup,
    SourceState,
    SpacingPolicy,
    VehiclesAhead,
)
from vehicles.driver.longitudinal_laws import (
    DAMPING,
    GAP_STIFFNESS,
    LEAD_PULL_DISTANCE,
    STABLE_HEADWAY,
    gap_acceleration,
)
from vehicles.driver.own_state import Pose
from vehicles.driver.speed import (
    PROFILE_CORRECTION,
    GapKeeping,
    ProfileSpeed,
    SpeedProfile,
)
from vehicles.schedule import SECOND, instant

PROFILE = SpeedProfile((0.0, 10.0, 20.0, 25.0), (5.0, 25.0, 25.0, 0.0))
STEP = 0.01


def test_profile_passes_its_points_with_exact_slopes() -> None:
    assert PROFILE.at(0.0) == (5.0, 2.0)
    assert PROFILE.at(4.0) == (13.0, 2.0)
    assert PROFILE.at(10.0) == (25.0, 0.0)
    assert PROFILE.at(22.0) == (15.0, -5.0)
    assert PROFILE.at(25.0) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("times", "speeds", "message"),
    [
        ([], [], "at least one"),
        ([0.0, 1.0], [1.0], "equal in number"),
        ([0.0, 0.0], [1.0, 1.0], "increase"),
        ([1.0, 0.0], [1.0, 1.0], "increase"),
        ([0.0, math.nan], [1.0, 1.0], "finite"),
        ([0.0, 1.0], [1.0, -1.0], "not negative"),
    ],
)
def test_impossible_profiles_are_refused(
    times: list[float], speeds: list[float], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        SpeedProfile(tuple(times), tuple(speeds))


@given(st.floats(0.0, 40.0))
def test_the_distance_is_the_integral_of_the_speed(seconds: float) -> None:
    steps = 4000
    middles = ((k + 0.5) * seconds / steps for k in range(steps))
    driven = sum(PROFILE.at(middle)[0] for middle in middles) * seconds / steps
    assert PROFILE.distance(seconds) == pytest.approx(driven, abs=1e-3)


@given(st.floats(0.0, 24.9), st.floats(0.5, 10.0))
def test_time_to_is_the_inverse_of_distance(seconds: float, last: float) -> None:
    for profile in (PROFILE, SpeedProfile((1.0, 2.0), (5.0, last))):
        assert profile.time_to(profile.distance(seconds)) == pytest.approx(seconds, abs=1e-6)


def acceleration(spacing: float, own: float, predecessor: float, lead: float) -> float:
    return gap_acceleration(
        VehiclesAhead(spacing, predecessor, lead),
        own,
        SpacingPolicy(standstill=8.0),
        GapLimits(acceleration=2.0, deceleration=6.0),
    )


def test_each_term_has_the_right_sign() -> None:
    assert acceleration(8.5, 20.0, 20.0, 20.0) > 0.0 > acceleration(7.5, 20.0, 20.0, 20.0)
    assert acceleration(8.0, 20.0, 20.5, 20.0) > 0.0 > acceleration(8.0, 20.0, 19.5, 20.0)
    assert acceleration(8.0, 20.0, 20.0, 20.5) > 0.0 > acceleration(8.0, 20.0, 20.0, 19.5)


@pytest.mark.parametrize("headway", [0.0, 0.1, 0.2, 0.25, STABLE_HEADWAY, 0.6, 1.0])
@pytest.mark.parametrize("receives_lead", [True, False])
def test_errors_never_grow_from_vehicle_to_vehicle_at_any_frequency(
    headway: float, receives_lead: bool
) -> None:
    """Transfer of speeds to the next vehicle, whose command is linear in what it receives."""
    policy, limits = SpacingPolicy(8.0, headway), GapLimits(1e3, 1e3)
    lead = 0.0 if receives_lead else math.nan

    def gain(ahead: VehiclesAhead) -> float:
        return gap_acceleration(ahead, 0.0, policy, limits)

    by_spacing = gain(VehiclesAhead(9.0, 0.0, lead, 0.0, lead))
    by_speed = gain(VehiclesAhead(8.0, 1.0, lead, 0.0, lead))
    by_acceleration = gain(VehiclesAhead(8.0, 0.0, lead, 1.0, lead))
    assert by_spacing == pytest.approx(GAP_STIFFNESS)

    def transfer(frequency: float) -> float:
        s = 1j * frequency
        passed_on = by_acceleration * s * s + by_speed * s + by_spacing
        return abs(passed_on / (s * s + (DAMPING + GAP_STIFFNESS * headway) * s + by_spacing))

    worst = max(transfer(10 ** (k / 50)) for k in range(-150, 150))
    assert worst <= 1.0 + 1e-12


@given(lead_speed=st.floats(0.0, 50.0), lead_acceleration=st.floats(-8.0, 3.0))
def test_a_lead_that_drives_on_pulls_no_car_into_its_slow_predecessor(
    lead_speed: float, lead_acceleration: float
) -> None:
    spacing = 8.0 - LEAD_PULL_DISTANCE
    ahead = VehiclesAhead(spacing, 10.0, lead_speed, 0.0, lead_acceleration)
    assert gap_acceleration(ahead, 10.0, SpacingPolicy(8.0), GapLimits()) <= 1e-12


class String:
    """Five vehicles that drive as commanded and receive each other at 20 Hz with 20 ms latency.

    Spacings are measured from received positions, extrapolated by speed and age.
    """

    def __init__(self, policy: SpacingPolicy, speed: float, *, receives_lead: bool = True) -> None:
        pitch = policy.desired(speed)
        self.policy, self.receives_lead, self.announces = policy, receives_lead, True
        self.places = [-pitch * k for k in range(5)]
        self.speeds = [speed] * 5
        self.received = [(0.0, place, speed, 0.0) for place in self.places]
        self.air: deque[tuple[float, int, float, float, float]] = deque()
        self.commands = [0.0] * 5
        self.errors: list[list[float]] = []

    def step(self, k: int, lead_acceleration: float) -> None:
        now = k * STEP
        if k % 5 == 0:
            for i, (place, speed) in enumerate(zip(self.places, self.speeds, strict=True)):
                announced = self.commands[i] if self.announces else 0.0
                self.air.append((now, i, place, speed, announced))
        while self.air and self.air[0][0] <= now - 0.02 + 1e-9:
            at, i, *motion = self.air.popleft()
            self.received[i] = (at, motion[0], motion[1], motion[2])
        if k % 2 == 0:
            self.commands[1:] = [self.command(i, now) for i in range(1, 5)]
        self.commands[0] = lead_acceleration
        for i, command in enumerate(self.commands):
            speed = max(0.0, self.speeds[i] + command * STEP)
            self.places[i] += 0.5 * (speed + self.speeds[i]) * STEP
            self.speeds[i] = speed
        gaps = [a - b for a, b in pairwise(self.places)]
        desired = [self.policy.desired(speed) for speed in self.speeds[1:]]
        self.errors.append([spacing - want for spacing, want in zip(gaps, desired, strict=True)])

    def command(self, i: int, now: float) -> float:
        predecessor = self.freshness(i - 1, now)
        driven, speed, acceleration = predecessor.predicted()
        lead_speed = lead_acceleration = math.nan
        if self.receives_lead:
            _, lead_speed, lead_acceleration = self.freshness(0, now).predicted()
        spacing = self.received[i - 1][1] + driven - self.places[i]
        ahead = VehiclesAhead(spacing, speed, lead_speed, acceleration, lead_acceleration)
        return gap_acceleration(ahead, self.speeds[i], self.policy, GapLimits())

    def freshness(self, i: int, now: float) -> SourceState:
        at, _, speed, acceleration = self.received[i]
        return SourceState(
            age=now - at, speed=speed, achieved=acceleration, acceleration=acceleration
        )

    def worst(self) -> list[float]:
        return [max(abs(row[i]) for row in self.errors) for i in range(4)]


POLICIES = [SpacingPolicy(standstill=8.0), SpacingPolicy(standstill=4.0, headway=0.5)]


@pytest.mark.parametrize("policy", POLICIES)
def test_no_collision_when_the_lead_brakes_to_a_stop(policy: SpacingPolicy) -> None:
    string = String(policy, 30.0)
    for k in range(3000):
        string.step(k, -3.0 if 100 <= k < 1100 else 0.0)
        gaps = [a - b for a, b in pairwise(string.places)]
        assert min(gaps) > 1.0
    assert string.speeds == pytest.approx([0.0] * 5, abs=0.01)
    # What the delay costs at the beginning of the braking is not made good, as no car reverses.
    assert all(-0.2 < error < 0.01 for error in string.errors[-1])
    assert all(later <= earlier for earlier, later in pairwise(string.worst()))


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("period", [2.0, 5.0, 10.0, 20.0])
def test_spacing_errors_do_not_amplify_when_the_lead_s_speed_oscillates(
    policy: SpacingPolicy, period: float
) -> None:
    string = String(policy, 20.0)
    for k in range(round(max(40.0, 3 * period) / STEP)):
        string.step(k, 1.0 * math.sin(2.0 * math.pi * k * STEP / period))
    assert all(later <= earlier for earlier, later in pairwise(string.worst()))


# --- Speed laws


START = 1_790_000_000 * SECOND
PERIOD = 0.02


def at_speed(speed: float) -> Pose:
    return Pose(east=0.0, north=0.0, yaw=0.0, speed=speed, yaw_rate=0.0)


def tick(k: int) -> int:
    return instant(START, k, 50.0)


def test_a_speed_error_decays_at_the_stated_rate() -> None:
    law = ProfileSpeed(SpeedProfile((0.0,), (20.0,)), START, PERIOD)
    speed = 18.0
    for k in range(50):
        speed += PERIOD * law.command(tick(k), at_speed(speed), VehiclesAhead()).acceleration
    assert 20.0 - speed == pytest.approx(2.0 * (1.0 - PROFILE_CORRECTION * PERIOD) ** 50)
    assert 20.0 - speed == pytest.approx(2.0 * math.exp(-PROFILE_CORRECTION), rel=0.01)


def keeper(headway: float = 0.5) -> GapKeeping:
    return GapKeeping(
        LongitudinalSetup(
            SpacingPolicy(8.0, headway), GapLimits(acceleration=2.0, deceleration=6.0)
        )
    )


@given(
    spacing=st.floats(-50.0, 500.0),
    own=st.floats(0.0, 60.0),
    predecessor=st.floats(0.0, 60.0),
    lead=st.floats(0.0, 60.0) | st.just(math.nan),
)
@examples(16, 100)
def test_commands_are_within_the_limits(
    spacing: float, own: float, predecessor: float, lead: float
) -> None:
    command = keeper().command(tick(0), at_speed(own), VehiclesAhead(spacing, predecessor, lead))
    assert -6.0 <= command.acceleration <= 2.0


def test_a_follower_settles_at_the_gap_of_the_policy() -> None:
    law = keeper()
    speed, spacing = 15.0, 40.0
    for k in range(1500):
        ahead = VehiclesAhead(spacing=spacing, predecessor_speed=20.0, lead_speed=20.0)
        command = law.command(tick(k), at_speed(speed), ahead)
        spacing += PERIOD * (20.0 - speed)
        speed += PERIOD * command.acceleration
    assert speed == pytest.approx(20.0, abs=1e-3)
    assert spacing == pytest.approx(18.0, abs=1e-3)


def test_at_the_profile_s_speed_the_command_is_its_acceleration() -> None:
    law = ProfileSpeed(SpeedProfile((0.0, 10.0), (10.0, 30.0)), START, PERIOD)
    command = law.command(tick(100), at_speed(14.0), VehiclesAhead())
    assert command.acceleration == pytest.approx(2.0)
    assert command.target_speed == pytest.approx(14.04)


@given(
    spans=st.lists(st.floats(0.001, 2.0), min_size=1, max_size=8),
    speeds=st.lists(st.floats(0.0, 40.0), min_size=8, max_size=8),
)
@examples(8, 50)
def test_a_car_that_follows_commands_exactly_is_on_the_profile(
    spans: list[float], speeds: list[float]
) -> None:
    profile = SpeedProfile(tuple(accumulate(spans)), tuple(speeds[: len(spans)]))
    law = ProfileSpeed(profile, START, PERIOD)
    speed = speeds[0]
    for k in range(200):
        assert speed == pytest.approx(profile.at(k * PERIOD)[0], abs=1e-6)
        speed += PERIOD * law.command(tick(k), at_speed(speed), VehiclesAhead()).acceleration
