"""Received poses at exact positions, without a link."""

from vehicles.car.gnss import Fix
from vehicles.messages import NO_ANNOUNCEMENT, Announcement, GpsPose
from vehicles.received_pose import ReceivedPose


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
    message = GpsPose(
        vehicle=vehicle,
        seq=seq,
        measured_at_ns=measured_at,
        latitude_deg=0.0,
        longitude_deg=0.0,
        altitude_m=0.0,
        heading_deg=0.0,
        speed_mps=speed,
        yaw_rate_radps=yaw_rate,
        sent_at_ns=measured_at,
        fix="fixed",
        position_accuracy_m=accuracy,
        mode=announced.mode,
        hazard=announced.hazard,
        acceleration_mps2=announced.acceleration_mps2,
        path_offset_m=announced.path_offset_m,
        stops_at_ns=announced.stops_at_ns,
        true_east_m=0.0,
        true_north_m=0.0,
        true_distance_m=0.0,
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
