from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import pytest

from tests.made.transport.received_poses import received
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.driver.controller import SpacingPolicy, VehiclesAhead
from vehicles.driver.convoy import ConvoyWatch, MemberTrack
from vehicles.driver.leader import WAITING_SHARE, WaitingProfile
from vehicles.driver.own_state import Pose
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.speed import SpeedProfile
from vehicles.geometry.sampled_path import Segment, path_from_segments
from vehicles.messages import Announcement, Mode
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import MILLISECOND, SECOND

TICK = 20 * MILLISECOND
SETTINGS = DegradationSettings()
PROFILE = SpeedProfile((0.0, 10.0, 20.0, 30.0), (20.0, 20.0, 8.0, 24.0))


def pose_of(
    vehicle: str, at: int, mode: Mode = "composite", *, hazard: bool = False
) -> ReceivedPose:
    announced = Announcement(mode=mode, hazard=hazard)
    return received(at, 0.0, 0.0, 0.0, 10.0, vehicle=vehicle, announced=announced)


class Convoy:
    """A lead that watches two followers."""

    def __init__(self) -> None:
        path, policy = path_from_segments([Segment(100.0, 0.0)]), SpacingPolicy(10.0, 0.0)
        self.watch = ConvoyWatch(SETTINGS)
        self.members = {
            name: MemberTrack(
                name=name,
                car=CAR,
                period=0.05,
                policy=policy,
                path=path,
                station=0.0,
                received_at=0,
            )
            for name in ("v2", "v3")
        }

    def reason(self, now: int, poses: Sequence[ReceivedPose]) -> str:
        """Reason why the lead waits after receiving these poses."""
        for pose in poses:
            self.members[pose.message.vehicle].receive(replace(pose, received_at=now))
        return self.watch.reason(now, list(self.members.values()), 0.0)


def waited(silent_from: float, silent_to: float, until: float) -> list[tuple[float, str]]:
    """Instants (s) at which the lead begins or ends to wait while v3 is silent, with reasons."""
    convoy, changes, before = Convoy(), [], ""
    for now in range(0, round(until * SECOND), TICK):
        received = [pose_of("v2", now)]
        if not silent_from <= now / SECOND < silent_to:
            received.append(pose_of("v3", now))
        why = convoy.reason(now, received)
        if bool(why) != bool(before):
            changes.append((now / SECOND, why))
        before = why
    return changes


def test_the_lead_waits_from_the_loss_of_a_follower_to_the_end_of_its_probation() -> None:
    (lost, why), (resumed, nothing) = waited(4.0, 6.0, 10.0)
    assert lost == pytest.approx(4.0 + SETTINGS.lost_after, abs=0.041)
    assert "v3 silent for 0.5 s" in why
    assert "v2" not in why
    assert resumed == pytest.approx(6.0 + SETTINGS.probation, abs=0.041)
    assert nothing == ""


@pytest.mark.parametrize(("mode", "hazard"), [("coast", False), ("stop", True), ("lead", True)])
def test_the_lead_waits_for_a_follower_that_announces_trouble(mode: Mode, hazard: bool) -> None:
    convoy = Convoy()
    assert convoy.reason(0, [pose_of("v2", 0), pose_of("v3", 0)]) == ""
    why = convoy.reason(TICK, [pose_of("v2", TICK, mode, hazard=hazard)])
    assert why.endswith(f"v2 in mode {mode}")
    later = 2 * TICK
    assert convoy.reason(later, [pose_of("v2", TICK // 2)]) != ""  # an older pose changes nothing
    soon, after = later + round(0.4 * SECOND), later + round(0.6 * SECOND)
    for now in range(later + TICK, after, TICK):
        why = convoy.reason(now, [pose_of("v2", now), pose_of("v3", now)])
        assert why or now > soon
    assert convoy.reason(after, [pose_of("v2", after), pose_of("v3", after)]) == ""


def driven(waits: tuple[float, float], until: float) -> list[tuple[float, float, float]]:
    """Time (s), distance (m), acceleration (m/s²) of a lead that waits between two instants (s)."""
    law = WaitingProfile(PROFILE, 0, TICK / SECOND, SETTINGS.comfortable)
    speed, distance, states = 20.0, 0.0, []
    for now in range(0, round(until * SECOND), TICK):
        law.waits = waits[0] <= now / SECOND < waits[1]
        command = law.command(now, Pose(distance, 0.0, 0.0, speed, 0.0), VehiclesAhead())
        states.append((now / SECOND, distance, command.acceleration))
        after = speed + command.acceleration * TICK / SECOND
        distance += 0.5 * (speed + after) * TICK / SECOND
        speed = after
    return states


def test_it_slows_down_comfortably_to_half_speed_and_back() -> None:
    states = driven((1.0, 30.0), 9.9)
    comfortable = SETTINGS.comfortable
    assert min(a for _, _, a in states) >= -comfortable.deceleration - 0.01
    changes = [later[2] - sooner[2] for sooner, later in pairwise(states)]
    assert min(changes) >= -comfortable.jerk * TICK / SECOND - 0.02


def test_while_waiting_it_is_never_faster_than_the_profile_at_that_position() -> None:
    states = driven((2.0, 25.0), 60.0)
    usual = driven((90.0, 91.0), 60.0)
    distances = [distance for _, distance, _ in usual]
    speeds = [(b - a) / 0.02 for a, b in pairwise(distances)]
    for (_, here, _), (_, there, _) in pairwise(states):
        if here > distances[-2]:
            break
        k = next(k for k, distance in enumerate(distances) if distance >= here)
        assert (there - here) / 0.02 <= max(speeds[max(k - 2, 0) : k + 3]) + 0.1
    half = [(b - a) / 0.02 for (_, a, _), (_, b, _) in pairwise(states)]
    assert min(half) >= WAITING_SHARE * 8.0 - 0.1
