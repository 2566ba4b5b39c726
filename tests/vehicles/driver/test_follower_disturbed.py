import math
from collections.abc import Container, Sequence
from dataclasses import replace
from functools import cache
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.examples import examples
from tests.made.vehicles import decision_messages
from tests.made.vehicles.exact_drives import (
    CONTROL_HZ,
    PLANE,
    START,
    Source,
    Step,
    drive,
    measured,
    on,
    received_from,
)
from tests.made.vehicles.followers import (
    BEND,
    STRAIGHT,
    admitted,
    follower,
    lateral,
    lead_of,
    modes,
    predecessor_of,
)
from tests.made.vehicles.fusions import FUSIONS
from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.driver.controller import GapLimits, LongitudinalSetup, SpacingPolicy
from vehicles.driver.speed import GapKeeping
from vehicles.geometry.geodesy import heading_from_yaw
from vehicles.messages import GpsPose
from vehicles.received_pose import ReceivedPose, receive
from vehicles.schedule import SECOND, instant


@cache
def usual() -> list[Step]:
    return drive(
        follower(), on(BEND, 0.0, 10.0), 7.0, received_from(lead_of(BEND), predecessor_of(BEND))
    )


def drive_with_jumps(
    sender: str, numbers: Container[int], far: float, towards: float
) -> list[Step]:
    """Drive with messages of `sender` displaced by `far` (m) in the direction `towards` (rad)."""
    usually = received_from(lead_of(BEND), predecessor_of(BEND))

    def receive_at(now: int) -> list[ReceivedPose]:
        return [
            displaced(pose, far * math.cos(towards), far * math.sin(towards))
            if pose.message.vehicle == sender and pose.message.seq in numbers
            else pose
            for pose in usually(now)
        ]

    return drive(follower(), on(BEND, 0.0, 10.0), 7.0, receive_at)


def moved_by(steps: Sequence[Step]) -> float:
    """Largest distance (m) of the car from the undisturbed drive."""
    pairs = zip(steps, usual(), strict=True)
    return max(apart(step.body, undisturbed.body) for step, undisturbed in pairs)


@pytest.mark.spread(4)
@pytest.mark.parametrize("far", [0.5, 5.0, 50.0, 1000.0])
@pytest.mark.parametrize("sender", ["v1", "v2"])
def test_a_received_jump_hardly_moves_the_car(far: float, sender: str) -> None:
    steps = drive_with_jumps(sender, {7, 57, 107}, far, math.radians(127))
    assert moved_by(steps) < 0.03
    assert max(abs(step.decision.actuation.steering) for step in steps) < 0.1


def displaced(pose: ReceivedPose, to_east: float, to_north: float) -> ReceivedPose:
    return replace(pose, east=pose.east + to_east, north=pose.north + to_north)


def apart(one: Body, other: Body) -> float:
    return math.hypot(one.east - other.east, one.north - other.north)


def test_a_jump_of_the_own_fix_hardly_moves_the_car() -> None:
    def jumping(body: Body, now: int) -> Fix | None:
        fix = measured(body, now)
        if fix is not None and fix.seq % 40 == 11:
            return replace(fix, east=fix.east + 12.0, north=fix.north - 9.0)
        return fix

    sources = received_from(lead_of(BEND), predecessor_of(BEND))
    steps = drive(follower(), on(BEND, 0.0, 10.0), 7.0, sources, fix=jumping)
    for step, undisturbed in zip(steps, usual(), strict=True):
        assert apart(step.body, undisturbed.body) < 0.03


def test_messages_out_of_order_hardly_move_the_car() -> None:
    """Pairs arrive swapped, up to 100 ms late, which has no effect 15 m ahead."""
    sources = [lead_of(BEND), predecessor_of(BEND)]

    def receive_at(now: int) -> list[ReceivedPose]:
        if (now - START) % (SECOND // 10):
            return []
        return [
            receive(message, PLANE, now)
            for source in sources
            for message in reversed(list(source.messages_by(now)))
        ]

    steps = drive(follower(), on(BEND, 0.0, 10.0), 7.0, receive_at)
    assert max(map(abs, lateral(BEND, steps))) < 0.05
    assert modes(steps)[-1][0] == "composite"


@pytest.mark.parametrize(
    "wrong",
    [
        {"latitude_deg": -30.0},
        {"longitude_deg": 250.0},
        {"latitude_deg": math.nan},
        {"altitude_m": math.inf},
        {"speed_mps": 190.0},
        {"heading_deg": -20.0},
        {"yaw_rate_radps": 60.0},
    ],
    ids=str,
)
def test_impossible_poses_are_ignored(wrong: dict[str, float]) -> None:
    usually = received_from(lead_of(BEND), predecessor_of(BEND))

    def receive_at(now: int) -> list[ReceivedPose]:
        messages = [pose.message for pose in usually(now)]
        sent = [one if one.seq % 10 else replace(one, **wrong) for one in messages]  # type: ignore[arg-type]
        return admitted(sent, now)

    steps = drive(follower(), on(BEND, 0.0, 10.0), 7.0, receive_at)
    assert max(map(abs, lateral(BEND, steps))) < 0.05


places = st.tuples(st.floats(-40.0, 160.0), st.floats(-30.0, 30.0)) | st.tuples(
    st.floats(-90_000.0, 90_000.0), st.floats(-90_000.0, 90_000.0)
)
pose_inputs = st.tuples(
    st.sampled_from(["v1", "v2"]),
    st.integers(0, 60),  # sequence number: any order, many repeated
    places | st.none(),  # None: the true position
    st.floats(-math.pi, math.pi),
    st.floats(0.0, 150.0),
)


@given(
    ticks=st.lists(st.lists(pose_inputs, max_size=4), min_size=30, max_size=60),
    own=st.dictionaries(st.integers(1, 20), places, max_size=6),
    fusion=st.sampled_from(FUSIONS),
    alpha=st.floats(0.0, 1.0),
    speed=st.sampled_from([0.0, 1.0, 10.0, 40.0]),
    keeps_gap=st.booleans(),
)
@examples(13, 80)
def test_with_any_input_commands_are_finite_and_within_the_limits(
    ticks: list[list[tuple[str, int, tuple[float, float] | None, float, float]]],
    own: dict[int, tuple[float, float]],
    fusion: str,
    alpha: float,
    speed: float,
    *,
    keeps_gap: bool,
) -> None:
    law = GapKeeping(LongitudinalSetup(SpacingPolicy(8.0, 0.5), GapLimits())) if keeps_gap else None
    driver = follower(fusion=fusion, alpha=alpha, speed=speed, law=law)
    body = on(BEND, 0.0, speed)
    true = {"v1": lead_of(BEND), "v2": predecessor_of(BEND)}
    for k, inputs in enumerate(ticks):
        now = instant(START, k, CONTROL_HZ)
        poses = (pose_of(true[name], seq, place, yaw, v) for name, seq, place, yaw, v in inputs)
        received = admitted(poses, now)
        fix = measured(body, now)
        if fix is not None and fix.seq in own:
            east, north = own[fix.seq]
            fix = replace(fix, east=east, north=north)
        decision = driver.step(now, fix, body, received)
        assert math.isfinite(decision.actuation.steering)
        assert abs(decision.actuation.steering) <= CAR.steering_limit
        assert math.isfinite(decision.actuation.acceleration)
        assert math.isfinite(decision.errors.lateral)
        if keeps_gap:
            assert -6.0 <= decision.actuation.acceleration <= 2.0
        decision_messages.log_messages(decision, "v3", k, now)


def pose_of(
    source: Source, seq: int, place: tuple[float, float] | None, yaw: float, speed: float
) -> GpsPose:
    true = source.message(seq)
    if place is None:
        return true
    latitude, longitude, altitude = PLANE.to_geodetic(*place)
    return replace(
        true,
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_m=altitude,
        heading_deg=heading_from_yaw(yaw),
        speed_mps=speed,
    )


def test_sources_with_poor_receivers_are_followed_within_their_noise() -> None:
    random, usually = Random(1), received_from(lead_of(STRAIGHT), predecessor_of(STRAIGHT))
    steps = drive(
        follower(),
        on(STRAIGHT, 0.0, 10.0),
        9.0,
        lambda now: [
            displaced(pose, random.gauss(0.0, 0.3), random.gauss(0.0, 0.3)) for pose in usually(now)
        ],
    )
    assert max(map(abs, lateral(STRAIGHT, steps))) < 0.5
