import math
from collections.abc import Sequence

import pytest

from tests.made.transport.received_poses import received
from tests.made.vehicles.exact_drives import CONTROL_HZ, START, Step, drive, on
from vehicles.car.gnss import Fix
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.driver.controller import SpacingPolicy
from vehicles.driver.convoy import MemberTrack
from vehicles.driver.leader import Leader
from vehicles.driver.pose_estimator import PoseEstimator
from vehicles.driver.speed import ProfileSpeed, SpeedProfile
from vehicles.driver.steering import SlipCompensated
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments
from vehicles.messages import Announcement
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND, Cadence

HEADINGS = [0.0, math.pi / 2, math.pi, -math.pi / 2]
LEFT_AND_RIGHT = [Segment(40.0, 0.0), Segment(60.0, 1 / 80), Segment(60.0, -1 / 80)]
RADIUS, AWAY = 12.0, math.acos(0.5 + 3.5 / (4 * 12.0))
BULB_TURN = [  # out, right, round to the left, and back at 3.5 m from the first straight
    Segment(60.0, 0.0),
    Segment(RADIUS * AWAY, -1 / RADIUS),
    Segment(RADIUS * (math.pi + 2 * AWAY), 1 / RADIUS),
    Segment(RADIUS * AWAY, -1 / RADIUS),
    Segment(60.0, 0.0),
]
FIGURE_OF_EIGHT = [  # its straights cross at right angles
    Segment(30.0, 0.0),
    Segment(1.5 * math.pi * 15, 1 / 15),
    Segment(60.0, 0.0),
    Segment(1.5 * math.pi * 15, -1 / 15),
    Segment(30.0, 0.0),
]


def leader(
    path: SampledPath,
    speed: float | SpeedProfile,
    station: float = 0.0,
    control_hz: float = CONTROL_HZ,
    members: Sequence[MemberTrack] = (),
) -> Leader:
    profile = speed if isinstance(speed, SpeedProfile) else SpeedProfile((0.0,), (speed,))
    return Leader(
        own_state=PoseEstimator(CAR),
        controller=SlipCompensated(CAR),
        speed_law=ProfileSpeed(profile, START, 1.0 / control_hz),
        control=Cadence(START, control_hz),
        path=path,
        station=station,
        members=members,
        relays=len(members),
    )


def lateral(path: SampledPath, steps: Sequence[Step]) -> list[float]:
    """True lateral error (m) of the car at the distance driven."""
    return [
        path.project(step.body.east, step.body.north, step.body.distance).lateral for step in steps
    ]


@pytest.mark.parametrize("yaw", HEADINGS)
def test_arcs_to_both_sides_are_tracked(yaw: float) -> None:
    path = path_from_segments(LEFT_AND_RIGHT, 50.0, -30.0, yaw)
    steps = drive(leader(path, 15.0), on(path, 0.0, 15.0), 10.0)
    assert max(map(abs, lateral(path, steps))) < 0.15
    by_distance = {round(step.body.distance): step.decision for step in steps}
    for distance, sign in ((80, 1), (140, -1)):
        decision = by_distance[distance]
        assert decision.mode == "path"
        assert decision.errors.curvature == pytest.approx(sign / 80)
        assert math.copysign(1, decision.actuation.steering) == sign
        assert math.copysign(1, decision.steering.feedforward) == sign
    assert abs(lateral(path, steps)[-1]) < 0.02


def test_left_and_right_are_mirror_images() -> None:
    left = path_from_segments([Segment(30.0, 0.0), Segment(80.0, 1 / 60)])
    right = path_from_segments([Segment(30.0, 0.0), Segment(80.0, -1 / 60)])
    to_left = drive(leader(left, 12.0), on(left, 0.0, 12.0, left=0.5), 8.0)
    to_right = drive(leader(right, 12.0), on(right, 0.0, 12.0, left=-0.5), 8.0)
    for one, other in zip(to_left, to_right, strict=True):
        assert one.body.north == pytest.approx(-other.body.north, abs=1e-9)
        assert one.decision.actuation.steering == pytest.approx(
            -other.decision.actuation.steering, abs=1e-9
        )


@pytest.mark.parametrize("yaw", HEADINGS)
@pytest.mark.parametrize("offset", [1.0, -1.0])
def test_a_lead_left_of_its_path_steers_right_and_returns(yaw: float, offset: float) -> None:
    path = path_from_segments([Segment(300.0, 0.0)], yaw=yaw)
    steps = drive(leader(path, 20.0), on(path, 0.0, 20.0, offset), 10.0)
    first = steps[0].decision
    assert first.errors.lateral == pytest.approx(offset)
    assert math.copysign(1, first.actuation.steering) == -math.copysign(1, offset)
    assert abs(lateral(path, steps)[-1]) < 0.01


@pytest.mark.parametrize(
    "segments",
    [
        pytest.param(FIGURE_OF_EIGHT * 2, id="figure of eight, twice"),
        pytest.param([Segment(3 * 2 * math.pi * 15, 1 / 15)], id="three laps"),
        pytest.param(BULB_TURN, id="bulb turn"),
    ],
)
def test_a_path_that_meets_itself_is_driven_in_order(segments: list[Segment]) -> None:
    path = path_from_segments(segments)
    speed = 5.0
    steps = drive(leader(path, speed), on(path, 0.0, speed), (path.length - 1.0) / speed)
    # Compared by arc length: on the wrong leg the distance would be metres.
    for step in steps:
        point = path.at(step.body.distance)
        assert math.hypot(step.body.east - point.east, step.body.north - point.north) < 0.6
        assert abs(step.decision.errors.heading) < 0.3
    assert max(map(abs, lateral(path, steps))) < 0.25


def test_it_repeats_the_announced_stops_of_its_followers() -> None:
    def pose(vehicle: str, at: int, stops_at: int) -> ReceivedPose:
        announced = Announcement(stops_at_ns=stops_at)
        return received(at, 0.0, 0.0, 0.0, 10.0, vehicle=vehicle, announced=announced)

    path, policy = path_from_segments([Segment(100.0, 0.0)]), SpacingPolicy(10.0, 0.0)
    members = [
        MemberTrack(
            name=name,
            car=CAR,
            period=0.05,
            policy=policy,
            path=path,
            station=0.0,
            received_at=START,
        )
        for name in ("v2", "v3")
    ]
    lead = leader(path, 10.0, members=members)
    start = Fix(0, START, 10.0, 0.0, 0.0, 10.0, 0.0)
    assert lead.step(START, start, None, ()).situation.relayed_stops == (0, 0)
    poses = [pose("v3", START, 7), pose("v2", START + 2, 5), pose("v2", START + 1, 9)]
    now = START + SECOND // 50
    assert lead.step(now, None, None, poses).situation.relayed_stops == (5, 7)
    later = lead.step(now + SECOND // 50, None, None, [pose("v3", START + 3, 0)])
    assert later.situation.relayed_stops == (5, 0)
