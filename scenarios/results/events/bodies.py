"""Bodies of cars as oriented rectangles: overlap and distance."""

from dataclasses import dataclass
from math import cos, hypot, inf, sin
from typing import NamedTuple

from vehicles.car.outline import Outline
from vehicles.car.parameters import VehicleParameters
from vehicles.messages import TruePose


class BodySize(NamedTuple):
    """Length and width (m) of a body, and the offset of its centre from the centre of mass."""

    length: float
    width: float
    forward: float

    @classmethod
    def of(cls, car: VehicleParameters) -> "BodySize":
        return cls(car.length, car.width, car.body_offset)


@dataclass(slots=True)
class CarBody(Outline):
    """A body in the world that moves: its outline and velocity (m/s)."""

    speed_east: float
    speed_north: float


class Separation(NamedTuple):
    """Distance (m) between two bodies, 0 where they overlap, and how fast it shrinks (m/s)."""

    distance: float
    closing: float


def body_of(pose: TruePose, size: BodySize) -> CarBody:
    ux, uy = cos(pose.yaw_rad), sin(pose.yaw_rad)
    length, width, forward = size
    sideways = pose.lateral_speed_mps + pose.yaw_rate_radps * forward
    return CarBody(
        pose.east_m + forward * ux,
        pose.north_m + forward * uy,
        ux,
        uy,
        0.5 * length,
        0.5 * width,
        pose.speed_mps * ux - sideways * uy,
        pose.speed_mps * uy + sideways * ux,
    )


def corners(body: Outline) -> tuple[tuple[float, float], ...]:
    """Corners (east, north) of a body, counter-clockwise from front left."""
    forward_east = body.half_length * body.along_east
    forward_north = body.half_length * body.along_north
    left_east, left_north = -body.half_width * body.along_north, body.half_width * body.along_east
    front_east, front_north = body.east + forward_east, body.north + forward_north
    rear_east, rear_north = body.east - forward_east, body.north - forward_north
    return (
        (front_east + left_east, front_north + left_north),
        (rear_east + left_east, rear_north + left_north),
        (rear_east - left_east, rear_north - left_north),
        (front_east - left_east, front_north - left_north),
    )


def overlap(body: Outline, other: Outline) -> bool:
    """Whether two bodies share more than their edges (separating axis theorem).

    Two convex shapes are apart if and only if they are along the normal of one of their sides.
    """
    to_east, to_north = other.east - body.east, other.north - body.north
    # A rectangle's projection is the sum of the projections of its sides.
    cosine = abs(body.along_east * other.along_east + body.along_north * other.along_north)
    sine = abs(body.along_east * other.along_north - body.along_north * other.along_east)
    for here, there in ((body, other), (other, body)):
        along = abs(to_east * here.along_east + to_north * here.along_north)
        across = abs(to_north * here.along_east - to_east * here.along_north)
        if along >= here.half_length + there.half_length * cosine + there.half_width * sine:
            return False
        if across >= here.half_width + there.half_length * sine + there.half_width * cosine:
            return False
    return True


def separation(body: CarBody, other: CarBody) -> Separation:
    """Distance between two bodies and its rate from their velocities, without yaw rates.

    The nearest points of two disjoint convex polygons include a corner. Where the bodies overlap
    the rate is that along the line of their centres.
    """
    if overlap(body, other):
        to_east, to_north = other.east - body.east, other.north - body.north
        return Separation(0.0, _closing(body, other, to_east, to_north))
    nearest = inf
    east = north = 0.0
    for here, there, sign in ((body, other, 1.0), (other, body, -1.0)):
        there_east, there_north, ux, uy = (
            there.east,
            there.north,
            there.along_east,
            there.along_north,
        )
        length, width = there.half_length, there.half_width
        for corner_east, corner_north in corners(here):
            to_east, to_north = there_east - corner_east, there_north - corner_north
            along = to_east * ux + to_north * uy
            across = to_north * ux - to_east * uy
            # Distance beyond the half sizes of the other body.
            along -= min(max(along, -length), length)
            across -= min(max(across, -width), width)
            distance = hypot(along, across)
            if distance < nearest:
                nearest = distance
                east = sign * (along * ux - across * uy)
                north = sign * (along * uy + across * ux)
    return Separation(nearest, _closing(body, other, east, north))


def _closing(body: CarBody, other: CarBody, east: float, north: float) -> float:
    """Speed (m/s) at which `body` nears `other` along the direction (east, north)."""
    length = hypot(east, north)
    if length == 0.0:
        return 0.0
    faster_east = body.speed_east - other.speed_east
    faster_north = body.speed_north - other.speed_north
    return (faster_east * east + faster_north * north) / length
