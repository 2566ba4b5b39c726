"""The lead keeps its distance from the last member of its convoy, ahead on a lap."""

from dataclasses import dataclass, replace
from math import inf, pi

import pytest

from tests.made.transport.received_poses import received
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.driver.controller import GapLimits, SpacingPolicy
from vehicles.driver.convoy import ConvoyAhead, MemberTrack
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

CIRCLE = path_from_segments([Segment(6.0 * pi * 20.0, 1.0 / 20.0)])
"""Three laps to the left."""
LAP = 2.0 * pi * 20.0
STANDS = LAP + 20.0


def pose_on(path: SampledPath, station: float, at: int = 0, speed: float = 0.0) -> ReceivedPose:
    place = path.at(station)
    return received(at, place.east, place.north, place.yaw, speed, vehicle="v5")


@dataclass
class Convoy:
    """A lead with one follower, which is at `station` (m) of the path."""

    station: float

    def __post_init__(self) -> None:
        self.last = MemberTrack(
            name="v5",
            car=CAR,
            period=PERIOD,
            policy=POLICY,
            path=CIRCLE,
            station=self.station,
            received_at=0,
        )
        self.ahead = ConvoyAhead(lap=LAP, car=CAR, settings=SETTINGS, policy=POLICY, limits=LIMITS)

    def acceleration(self, now: int, station: float, speed: float) -> float:
        return self.ahead.acceleration(now, [self.last], station, speed)


def test_on_a_lap_the_lead_follows_its_last_car_as_on_any_road() -> None:
    convoy, wanted = Convoy(20.0), list[float]()
    for tick in range(40):
        its = 20.0 + 5.0 * tick * PERIOD
        now = round(tick * PERIOD * SECOND)
        convoy.last.receive(pose_on(CIRCLE, its, at=now, speed=5.0))
        gap = POLICY.desired(5.0)
        wanted.append(convoy.acceleration(now, its + LAP - REAR - FRONT - gap, 5.0))
    assert wanted == pytest.approx([0.0] * len(wanted), abs=0.2)


def approached(gap: float, speed: float, until: float, convoy: Convoy) -> tuple[float, float]:
    """Smallest gap (m) and hardest braking (m/s²) of a lead that approaches v5 at `STANDS`."""
    station, least, hardest, last = STANDS - REAR - FRONT - gap, inf, 0.0, 0.0
    for now in range(0, round(until * SECOND), TICK):
        last = min(convoy.acceleration(now, station, speed), 0.0)
        hardest = min(hardest, last)
        after = max(speed + last * TICK / SECOND, 0.0)
        station += 0.5 * (speed + after) * TICK / SECOND
        speed = after
        least = min(least, STANDS - REAR - FRONT - station)
    return least, -hardest


@pytest.mark.parametrize("speed", [2.0, 5.0, 15.0])
def test_it_stops_comfortably_behind_a_car_that_was_last_received_standing(speed: float) -> None:
    convoy = Convoy(STANDS - LAP)
    convoy.last.receive(pose_on(CIRCLE, STANDS - LAP, at=1))
    gap, braking = approached(90.0, speed, 90.0, convoy)
    assert 1.9 < gap < 2.5
    assert braking < 2.5
    assert "silent for" in convoy.ahead.reason


def test_the_last_car_is_predicted_by_its_own_drive_lag() -> None:
    limits, station = list[float](), 20.0 + LAP - REAR - FRONT - 3.0
    for lag in (0.0, 1.0):
        convoy = Convoy(20.0)
        convoy.last.car = replace(CAR, drive_lag=lag)
        braking = Announcement(acceleration_mps2=-4.0)
        place = CIRCLE.at(20.0)
        pose = received(1, place.east, place.north, place.yaw, 5.0, announced=braking)
        convoy.last.receive(pose)
        limits.append(convoy.acceleration(SECOND // 4, station, 5.0))
    assert limits[0] < limits[1] - 0.3
