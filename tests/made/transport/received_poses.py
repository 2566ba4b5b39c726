"""Received poses at exact positions, without a link."""

from tests.made.message import pose
from vehicles.car.gnss import Fix
from vehicles.messages import NO_ANNOUNCEMENT, Announcement
from vehicles.received_pose import ReceivedPose

STATED = ("mode", "hazard", "acceleration_mps2", "path_offset_m", "stops_at_ns")


def received(
    measured_at: int,
    east: float,
    north: float,
    yaw: float = 0.0,
    speed: float = 0.0,
    *,
    yaw_rate: float = 0.0,
    accuracy: float = 0.02,
    seq: int = 0,
    vehicle: str = "v1",
    received_at: int | None = None,
    announced: Announcement = NO_ANNOUNCEMENT,
) -> ReceivedPose:
    """A pose (ns, m, m, rad, m/s), by default received when it is measured."""
    stated = announced._asdict()
    message = pose(
        vehicle,
        seq,
        measured_at,
        speed_mps=speed,
        yaw_rate_radps=yaw_rate,
        position_accuracy_m=accuracy,
        **{name: stated[name] for name in STATED},
    )
    at = measured_at if received_at is None else received_at
    return ReceivedPose(message, at, measured_at, east, north, yaw, speed, yaw_rate, accuracy)


def received_fix(
    fix: Fix,
    *,
    vehicle: str = "v1",
    received_at: int | None = None,
    announced: Announcement = NO_ANNOUNCEMENT,
) -> ReceivedPose:
    return received(
        fix.measured_at,
        fix.east,
        fix.north,
        fix.yaw,
        fix.speed,
        yaw_rate=fix.yaw_rate,
        accuracy=fix.accuracy,
        seq=fix.seq,
        vehicle=vehicle,
        received_at=received_at,
        announced=announced,
    )
