"""The body of a car on the ground: an oriented rectangle."""

from dataclasses import dataclass
from math import cos, hypot, sin

from vehicles.car.parameters import VehicleParameters


@dataclass(slots=True)
class Outline:
    """Body of a car in the world: centre (m), unit vector forwards and half sizes (m)."""

    east: float
    north: float
    along_east: float
    along_north: float
    half_length: float
    half_width: float

    @property
    def reach(self) -> float:
        return hypot(self.half_length, self.half_width)  # m, from the centre to a corner


def outline_of(car: VehicleParameters, east: float, north: float, yaw: float) -> Outline:
    """Outline of `car` with its centre of mass at (east, north) (m), in direction `yaw` (rad)."""
    ahead, ux, uy = car.body_offset, cos(yaw), sin(yaw)
    half_length, half_width = 0.5 * car.length, 0.5 * car.width
    return Outline(east + ahead * ux, north + ahead * uy, ux, uy, half_length, half_width)
