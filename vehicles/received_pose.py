"""A received pose in the plane of the scenario."""

from dataclasses import dataclass

from vehicles.geometry.geodesy import LocalPlane, yaw_from_heading
from vehicles.messages import GpsPose


@dataclass(slots=True)
class ReceivedPose:
    """A received message, converted once.

    `received_at` (ns) is the tick at which it was processed, `measured_at` (ns) its time stamp by
    the receiver's clock. Position (m) and yaw (rad, counter-clockwise from east) lie in the plane
    of the scenario; speed m/s, yaw rate rad/s; `accuracy` (m) is the standard deviation per axis
    that the sender states.
    """

    message: GpsPose
    received_at: int
    measured_at: int
    east: float
    north: float
    yaw: float
    speed: float
    yaw_rate: float
    accuracy: float


def receive(message: GpsPose, plane: LocalPlane, now: int) -> ReceivedPose:
    """Convert a message received at `now` (ns) from WGS84 and compass course to the plane.

    Raises ValueError beyond the range of the plane.
    """
    east, north = plane.to_plane(message.latitude_deg, message.longitude_deg, message.altitude_m)
    return ReceivedPose(
        message,
        now,
        message.measured_at_ns,
        east,
        north,
        yaw_from_heading(message.heading_deg),
        message.speed_mps,
        message.yaw_rate_radps,
        message.position_accuracy_m,
    )
