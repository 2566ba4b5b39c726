"""A received pose in the plane of the scenario."""

from dataclasses import dataclass

from vehicles.geometry.geodesy import LocalPlane, yaw_from_heading
from vehicles.geometry.sampled_path import DEGREE_UNITS, TIME_UNIT, Place
from vehicles.messages import GpsPose


@dataclass(slots=True)
class ReceivedPose:
    """A received message, converted once.

    `received_at` (ns) is the tick at which it was processed, `measured_at` (ns) its time stamp by
    the receiver's clock. Position (m) and yaw (rad, counter-clockwise from east) lie in the plane
    of the scenario; speed m/s, yaw rate rad/s; `accuracy` (m) is the standard deviation per axis
    that the sender states. `plane` converts the path history, which is empty without it.
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
    plane: LocalPlane | None = None

    def path_history(self) -> list[Place]:
        """Positions of the path that the sender drove before this pose, oldest first.

        Each with its instant (ns) by the receiver's clock. Older positions beyond the range of the
        plane are left out.
        """
        message, plane, places = self.message, self.plane, list[Place]()
        if plane is None:
            return places
        latitude = round(message.latitude_deg * DEGREE_UNITS)
        longitude = round(message.longitude_deg * DEGREE_UNITS)
        at = self.measured_at
        for north, east, age in zip(
            message.history_latitude_e7deg,
            message.history_longitude_e7deg,
            message.history_age_cs,
            strict=True,
        ):
            latitude, longitude, at = latitude + north, longitude + east, at - age * TIME_UNIT
            try:
                place = plane.to_plane(
                    latitude / DEGREE_UNITS, longitude / DEGREE_UNITS, message.altitude_m
                )
            except ValueError:
                break
            places.append((at, *place))
        places.reverse()
        return places


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
        plane,
    )
