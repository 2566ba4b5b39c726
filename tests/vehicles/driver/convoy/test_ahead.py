"""The lead keeps its distance from members of its convoy on its path ahead."""

from dataclasses import replace
from math import inf, pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.results.encounters import BodySize, CarBody, body_of, overlap
from tests.made.scenarios.messages import truth
from tests.made.transport.received_poses import received
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.driver.ahead import ConvoyAhead, ReservedPath
from vehicles.driver.controller import GapLimits, SpacingPolicy
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.watch import ConvoyMember
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

STRAIGHT = path_from_segments([Segment(300.0, 0.0)])
RADIUS = 6.0
HAIRPIN = path_from_segments(
    [Segment(40.0, 0.0), Segment(pi * RADIUS, 1.0 / RADIUS), Segment(40.0, 0.0)]
)
"""Out to the east, a left turn, and back 12 m further north."""
CIRCLE = path_from_segments([Segment(6.0 * pi * 20.0, 1.0 / 20.0)])
"""Three laps to the left."""
LAP = 2.0 * pi * 20.0
STANDS = LAP + 20.0
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


def car_at(path: SampledPath, station: float) -> CarBody:
    place = path.at(station)
    return body_of(truth("v1", 0, place.east, place.north, yaw=place.yaw), BodySize.of(CAR))


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
    members = [ConvoyMember("v5", CAR, PERIOD, station, POLICY)]
    return ConvoyAhead(
        path=path,
        lap=lap,
        car=CAR,
        members=members,
        settings=SETTINGS,
        policy=POLICY,
        limits=LIMITS,
    )


def test_the_lead_waits_before_a_crossing_that_its_last_car_has_yet_to_pass() -> None:
    ahead, before = convoy(EIGHT), SECOND_LEG - FRONT - 6.0
    for second, station in enumerate((2.0, 10.0, CROSSING + 0.5 * CAR.width)):
        ahead.observe([pose_on(EIGHT, station, at=second * SECOND, speed=5.0)])
        assert ahead.acceleration(second * SECOND, before, 5.0) < -1.0
        assert "v5" in ahead.reason
    passed = CROSSING + 0.5 * CAR.width + REAR + 2.0
    ahead.observe([pose_on(EIGHT, passed, at=4 * SECOND, speed=5.0)])
    assert ahead.acceleration(4 * SECOND, before, 5.0) == inf


def test_on_a_lap_the_lead_follows_its_last_car_as_on_any_road() -> None:
    ahead, wanted = convoy(CIRCLE, LAP, 20.0), list[float]()
    for tick in range(40):
        its = 20.0 + 5.0 * tick * PERIOD
        now = round(tick * PERIOD * SECOND)
        ahead.observe([pose_on(CIRCLE, its, at=now, speed=5.0)])
        gap = POLICY.desired(5.0)
        wanted.append(ahead.acceleration(now, its + LAP - REAR - FRONT - gap, 5.0))
    assert wanted == pytest.approx([0.0] * len(wanted), abs=0.2)


@given(st.sampled_from([HAIRPIN, CIRCLE, EIGHT]), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
@settings(max_examples=150, deadline=None)
def test_up_to_the_entry_the_lead_touches_no_car_on_the_reserved_path(
    path: SampledPath, share: float, start: float
) -> None:
    """Independent evidence: bodies, placed along the path, and a test of overlap."""
    last = share * (min(path.length, LAP) - CAR.length)
    station = last + CAR.length + start * (LAP - 3.0 * CAR.length)
    entry, _ = ReservedPath(path, (CAR,)).entry(last - REAR, station - FRONT)
    cars = [car_at(path, last + k) for k in range(int(station - last - CAR.length))]
    until = min(entry - FRONT - TURNED, path.length - FRONT)
    while station < until:
        assert not any(overlap(car_at(path, station), car) for car in cars)
        station += 0.5


@pytest.mark.parametrize("path", [HAIRPIN, STRAIGHT])
def test_a_path_that_does_not_meet_itself_is_free(path: SampledPath) -> None:
    assert ReservedPath(path, (CAR,)).entry(0.0, 0.8 * path.length) == (inf, 0.0)


def approached(gap: float, speed: float, until: float, ahead: ConvoyAhead) -> tuple[float, float]:
    """Smallest gap (m) and hardest braking (m/s²) of a lead that approaches v5 at `STANDS`."""
    station, least, hardest, last = STANDS - REAR - FRONT - gap, inf, 0.0, 0.0
    for now in range(0, round(until * SECOND), TICK):
        last = min(ahead.acceleration(now, station, speed), 0.0)
        hardest = min(hardest, last)
        after = max(speed + last * TICK / SECOND, 0.0)
        station += 0.5 * (speed + after) * TICK / SECOND
        speed = after
        least = min(least, STANDS - REAR - FRONT - station)
    return least, -hardest


@pytest.mark.parametrize("speed", [2.0, 5.0, 15.0])
def test_it_stops_comfortably_behind_a_car_that_was_last_received_standing(speed: float) -> None:
    ahead = convoy(CIRCLE, LAP, STANDS - LAP)
    ahead.observe([pose_on(CIRCLE, STANDS - LAP, at=1)])
    gap, braking = approached(90.0, speed, 90.0, ahead)
    assert 1.9 < gap < 2.5
    assert braking < 2.5
    assert "silent for" in ahead.reason


def test_a_car_that_leaves_the_convoy_no_longer_counts() -> None:
    ahead = convoy(CIRCLE, LAP, STANDS - LAP)
    pose = pose_on(CIRCLE, STANDS - LAP, at=1)
    ahead.observe([pose])
    assert ahead.acceleration(1, STANDS - 10.0, 5.0) < 0.0
    ahead.observe([replace(pose, measured_at=2, message=replace(pose.message, leaving=True))])
    assert ahead.acceleration(2, STANDS - 10.0, 5.0) == inf
