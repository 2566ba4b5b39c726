"""Courses that approach or cross themselves, as positions by distance driven."""

import math
from collections.abc import Callable

from tests.made.vehicles.arc_courses import course
from vehicles.geometry.arc_spline import ArcSpline

TICK = 50_000_000
"""Nanoseconds between two fixes of 20 Hz."""
Place = Callable[[float], tuple[float, float, float]]


def lap(path: ArcSpline) -> Place:

    def place(station: float) -> tuple[float, float, float]:
        at = path.at(station % path.length)
        return at.east, at.north, at.yaw

    return place


def bulb(lane: float = 3.5, radius: float = 9.0) -> ArcSpline:
    """A turning loop: out, around to the right, and back at a distance of `lane` (m).

    By symmetry the centre of the loop is `radius` from the middle line; two arcs of one radius
    meet where their centres are two radii apart.
    """
    angle = math.acos((radius + lane / 2.0) / (2.0 * radius))
    return course(
        [
            (0.0, 60.0),
            (1.0 / radius, radius * angle),
            (-1.0 / radius, radius * (math.pi + 2.0 * angle)),
            (1.0 / radius, radius * angle),
            (0.0, 60.0),
        ]
    )


def eight(station: float) -> tuple[float, float, float]:
    round_length = 2.0 * math.pi * 15.0
    turn = station / 15.0
    side = 1.0 if station % (2.0 * round_length) < round_length else -1.0
    return 15.0 * math.sin(turn), side * (15.0 - 15.0 * math.cos(turn)), side * turn
