import math
from itertools import accumulate

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicles.driver.pose_estimator import Pose
from vehicles.driver.speed import GapLimits, GapPolicy, SpeedProfile
from vehicles.driver.speed_law import PROFILE_CORRECTION, Convoy, GapKeeping, ProfileSpeed
from vehicles.schedule import SECOND, instant

START = 1_790_000_000 * SECOND
PERIOD = 0.02


def at_speed(speed: float) -> Pose:
    return Pose(east=0.0, north=0.0, yaw=0.0, speed=speed, yaw_rate=0.0)


def tick(k: int) -> int:
    return instant(START, k, 50.0)


def test_at_the_profile_s_speed_its_own_acceleration_is_asked() -> None:
    law = ProfileSpeed(SpeedProfile((0.0, 10.0), (10.0, 30.0)), START, PERIOD)
    drive = law.drive(tick(100), at_speed(14.0), Convoy())
    assert drive.acceleration == pytest.approx(2.0)
    assert drive.target_speed == pytest.approx(14.04)


def test_a_corner_within_a_period_is_met_at_the_period_s_end() -> None:
    law = ProfileSpeed(SpeedProfile((0.0, 0.01, 5.0), (20.0, 20.0, 10.0)), START, PERIOD)
    drive = law.drive(tick(0), at_speed(20.0), Convoy())
    slope = -10.0 / 4.99
    assert 20.0 + PERIOD * drive.acceleration == pytest.approx(20.0 + 0.01 * slope)


def test_before_the_start_and_after_the_end_the_speed_is_kept() -> None:
    law = ProfileSpeed(SpeedProfile((0.0, 10.0), (10.0, 30.0)), START, PERIOD)
    for now, speed in ((START - SECOND, 10.0), (START + 60 * SECOND, 30.0)):
        drive = law.drive(now, at_speed(speed), Convoy())
        assert (drive.acceleration, drive.target_speed) == (0.0, speed)


def test_a_speed_error_decays_at_the_stated_rate() -> None:
    law = ProfileSpeed(SpeedProfile((0.0,), (20.0,)), START, PERIOD)
    speed = 18.0
    for k in range(50):
        speed += PERIOD * law.drive(tick(k), at_speed(speed), Convoy()).acceleration
    assert 20.0 - speed == pytest.approx(2.0 * (1.0 - PROFILE_CORRECTION * PERIOD) ** 50)
    assert 20.0 - speed == pytest.approx(2.0 * math.exp(-PROFILE_CORRECTION), rel=0.01)


@given(
    spans=st.lists(st.floats(0.001, 2.0), min_size=1, max_size=8),
    speeds=st.lists(st.floats(0.0, 40.0), min_size=8, max_size=8),
)
@settings(max_examples=50)
def test_a_car_that_does_as_told_is_on_the_profile_at_every_tick(
    spans: list[float], speeds: list[float]
) -> None:
    profile = SpeedProfile(list(accumulate(spans)), speeds[: len(spans)])
    law = ProfileSpeed(profile, START, PERIOD)
    speed = speeds[0]
    for k in range(200):
        assert speed == pytest.approx(profile.at(k * PERIOD)[0], abs=1e-6)
        speed += PERIOD * law.drive(tick(k), at_speed(speed), Convoy()).acceleration


def keeper(headway: float = 0.5) -> GapKeeping:
    return GapKeeping(GapPolicy(8.0, headway), GapLimits(acceleration=2.0, deceleration=6.0))


def test_without_a_predecessor_heard_the_speed_is_kept() -> None:
    drive = keeper().drive(tick(0), at_speed(17.0), Convoy())
    assert (drive.acceleration, drive.target_speed) == (0.0, 17.0)
    # The lead's speed alone says nothing about the gap.
    drive = keeper().drive(tick(0), at_speed(17.0), Convoy(lead_speed=30.0))
    assert drive.acceleration == 0.0


def test_at_the_right_gap_and_speed_nothing_is_asked() -> None:
    convoy = Convoy(gap=8.0 + 0.5 * 20.0, predecessor_speed=20.0, lead_speed=20.0)
    drive = keeper().drive(tick(0), at_speed(20.0), convoy)
    assert drive.acceleration == pytest.approx(0.0)
    assert drive.target_speed == 20.0


def test_the_speed_aimed_at_is_the_predecessor_s() -> None:
    convoy = Convoy(gap=18.0, predecessor_speed=17.0, lead_speed=22.0)
    assert keeper().drive(tick(0), at_speed(20.0), convoy).target_speed == 17.0


@pytest.mark.parametrize(
    ("gap", "predecessor_speed", "sign"),
    [(16.0, 20.0, -1), (20.0, 20.0, 1), (18.0, 19.0, -1), (18.0, 21.0, 1)],
)
def test_too_near_or_too_fast_brakes_too_far_or_too_slow_hurries(
    gap: float, predecessor_speed: float, sign: int
) -> None:
    convoy = Convoy(gap=gap, predecessor_speed=predecessor_speed, lead_speed=predecessor_speed)
    assert math.copysign(1, keeper().drive(tick(0), at_speed(20.0), convoy).acceleration) == sign


@pytest.mark.parametrize("headway", [0.0, 0.5])
def test_a_lead_that_was_not_heard_counts_as_fast_as_the_predecessor(headway: float) -> None:
    unheard = Convoy(gap=15.0, predecessor_speed=19.5)
    heard = Convoy(gap=15.0, predecessor_speed=19.5, lead_speed=19.5)
    law = keeper(headway)
    assert law.drive(tick(0), at_speed(20.0), unheard) == law.drive(tick(0), at_speed(20.0), heard)


@given(
    gap=st.floats(-50.0, 500.0),
    own=st.floats(0.0, 60.0),
    predecessor=st.floats(0.0, 60.0),
    lead=st.floats(0.0, 60.0) | st.just(math.nan),
)
@settings(max_examples=100)
def test_no_more_is_asked_than_the_limits_allow(
    gap: float, own: float, predecessor: float, lead: float
) -> None:
    drive = keeper().drive(tick(0), at_speed(own), Convoy(gap, predecessor, lead))
    assert -6.0 <= drive.acceleration <= 2.0


def test_a_follower_settles_at_the_gap_of_the_policy() -> None:
    law = keeper()
    speed, gap = 15.0, 40.0
    for k in range(1500):
        convoy = Convoy(gap=gap, predecessor_speed=20.0, lead_speed=20.0)
        drive = law.drive(tick(k), at_speed(speed), convoy)
        gap += PERIOD * (20.0 - speed)
        speed += PERIOD * drive.acceleration
    assert speed == pytest.approx(20.0, abs=1e-3)
    assert gap == pytest.approx(18.0, abs=1e-3)
