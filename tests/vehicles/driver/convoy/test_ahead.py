"""The lead keeps its distance from members of its convoy on its path ahead."""

from math import cos, inf, pi, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.results.encounters import overlap
from tests.made.transport.received_poses import received
from vehicles.car.outline import Outline, outline_of
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.driver.ahead import ConvoyAhead, ConvoyMember, Lane
from vehicles.driver.controller import GapLimits, SpacingPolicy
from vehicles.driver.settings import DegradationSettings
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments
from vehicles.messages import Announcement
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

CAR = LINCOLN_MKZ
FRONT = 0.5 * CAR.length + CAR.body_offset
REAR = 0.5 * CAR.length - CAR.body_offset
POLICY, LIMITS, SETTINGS = SpacingPolicy(2.0, 0.5), GapLimits(), DegradationSettings()
PERIOD = 0.05
TICK = SECOND // 50

TURNED = 0.6
"""Distance (m) by which a front corner is further along a bend of 6 m radius than the bumper."""

CORNER = 0.17
"""Distance (m) by which a rear corner is behind the rear bumper on `CIRCLE`."""

STRAIGHT = path_from_segments([Segment(300.0, 0.0)])
RADIUS = 6.0
HAIRPIN = path_from_segments(
    [Segment(40.0, 0.0), Segment(pi * RADIUS, 1.0 / RADIUS), Segment(40.0, 0.0)]
)
"""Out to the east, a left turn, and back 12 m further north."""
CIRCLE = path_from_segments([Segment(6.0 * pi * 20.0, 1.0 / 20.0)])
"""Three laps to the left."""
LAP = 2.0 * pi * 20.0
EIGHT = path_from_segments(
    [
        Segment(30.0, 0.0),
        Segment(1.5 * pi * 15.0, 1.0 / 15.0),
        Segment(30.0, 0.0),
        Segment(1.5 * pi * 15.0, -1.0 / 15.0),
    ]
)
"""It crosses its first straight at (15, 0), heading south, at station 30 + 1.5 π 15 + 15."""
CROSSING, SECOND_LEG = 15.0, 30.0 + 22.5 * pi + 15.0


def contact(path: SampledPath, body: Outline, low: float = 0.0) -> float | None:
    return Lane(path, CAR).first_contact(body, low, float(path.station[-1]))


def car_at(path: SampledPath, station: float, left: float = 0.0, turned: float = 0.0) -> Outline:
    place = path.at(station)
    east, north = place.east - left * sin(place.yaw), place.north + left * cos(place.yaw)
    return outline_of(CAR, east, north, place.yaw + turned)


def pose_on(
    path: SampledPath, station: float, at: int = 0, speed: float = 0.0, acceleration: float = 0.0
) -> ReceivedPose:
    place = path.at(station)
    announced = Announcement(acceleration_mps2=acceleration)
    return received(
        at, place.east, place.north, place.yaw, speed, vehicle="v5", announced=announced
    )


def convoy(path: SampledPath, lap: float = 0.0, station: float = 0.0) -> ConvoyAhead:
    """A lead with one follower, which is at `station` (m)."""
    members = [ConvoyMember("v5", CAR, PERIOD, station)]
    return ConvoyAhead(path, lap, CAR, members, SETTINGS, POLICY, LIMITS)


def test_on_the_other_leg_of_a_hairpin_a_car_is_as_far_as_the_road() -> None:
    other_leg = 40.0 + pi * RADIUS + 20.0
    found = contact(HAIRPIN, car_at(HAIRPIN, other_leg), 15.0)
    assert found == pytest.approx(other_leg - REAR, abs=0.02)
    assert contact(HAIRPIN, car_at(HAIRPIN, 12.0), 15.0 + FRONT) is None


def test_the_lead_waits_before_a_crossing_that_its_last_car_has_yet_to_pass() -> None:
    ahead, before = convoy(EIGHT), SECOND_LEG - FRONT - 6.0
    for second, station in enumerate((2.0, 10.0, CROSSING + 0.5 * CAR.width)):
        ahead.observe([pose_on(EIGHT, station, at=second * SECOND, speed=5.0)])
        assert ahead.acceleration(second * SECOND, before, 5.0, 0.0) < -1.0
        assert "v5" in ahead.reason
    passed = CROSSING + 0.5 * CAR.width + REAR + 2.0
    ahead.observe([pose_on(EIGHT, passed, at=4 * SECOND, speed=5.0)])
    assert ahead.acceleration(4 * SECOND, before, 5.0, 0.0) == inf


def test_on_a_lap_the_lead_follows_its_last_car_as_on_any_road() -> None:
    ahead, wanted = convoy(CIRCLE, LAP, 20.0), list[float]()
    for tick in range(40):
        its = 20.0 + 5.0 * tick * PERIOD
        now = round(tick * PERIOD * SECOND)
        ahead.observe([pose_on(CIRCLE, its, at=now, speed=5.0)])
        gap = POLICY.desired(5.0) + CORNER
        wanted.append(ahead.acceleration(now, its + LAP - REAR - FRONT - gap, 5.0, 0.0))
    assert wanted == pytest.approx([0.0] * len(wanted), abs=0.2)


@given(
    st.sampled_from([HAIRPIN, CIRCLE, EIGHT]),
    st.floats(0.0, 1.0),
    st.floats(-6.0, 6.0),
    st.floats(-pi, pi),
    st.floats(0.0, 1.0),
)
@settings(max_examples=150, deadline=None)
def test_up_to_the_contact_the_lead_touches_nobody(
    path: SampledPath, share: float, left: float, turned: float, start: float
) -> None:
    """Independent evidence: the lead's body, placed along the path, and a test of overlap."""
    length = min(float(path.station[-1]), LAP)
    body = car_at(path, share * length, left, turned)
    station = start * length
    if overlap(car_at(path, station), body):
        return  # it begins inside
    found = contact(path, body, station)
    until = min(length if found is None else found - FRONT - TURNED, length - FRONT)
    while station < until:
        assert not overlap(car_at(path, station), body)
        station += 0.3


def approached(gap: float, speed: float, until: float, ahead: ConvoyAhead) -> tuple[float, float]:
    """Smallest gap (m) and hardest braking (m/s²) of a lead that approaches v5 on a straight."""
    station, least, hardest, last = 100.0 - REAR - FRONT - gap, inf, 0.0, 0.0
    for now in range(0, round(until * SECOND), TICK):
        last = min(ahead.acceleration(now, station, speed, last), 0.0)
        hardest = min(hardest, last)
        after = max(speed + last * TICK / SECOND, 0.0)
        station += 0.5 * (speed + after) * TICK / SECOND
        speed = after
        least = min(least, 100.0 - REAR - FRONT - station)
    return least, -hardest


@pytest.mark.parametrize("speed", [2.0, 5.0, 15.0])
def test_it_stops_comfortably_behind_a_car_that_was_last_received_standing(speed: float) -> None:
    ahead = convoy(STRAIGHT)
    ahead.observe([pose_on(STRAIGHT, 100.0)])
    gap, braking = approached(90.0, speed, 90.0, ahead)
    assert 1.9 < gap < 2.5
    assert braking < 2.5
    assert "silent for" in ahead.reason
