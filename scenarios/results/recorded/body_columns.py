"""Distances between the bodies of two cars at many instants.

The formulas are those of `scenarios.results.events.bodies`, for arrays.
"""

from typing import NamedTuple

import numpy as np

from scenarios.results.events.bodies import BodySize
from transport.columns import Array, Columns, Integers


class Bodies(NamedTuple):
    """Bodies (N): centres (m), unit vectors forwards, and half of length and width (m)."""

    east: Array
    north: Array
    along_east: Array
    along_north: Array
    half_length: float
    half_width: float

    @classmethod
    def of(cls, truth: Columns, rows: Integers, size: BodySize) -> "Bodies":
        """Bodies at some of the true poses of a vehicle."""
        yaw = truth["yaw_rad"][rows]
        along_east, along_north = np.cos(yaw), np.sin(yaw)
        east = truth["east_m"][rows] + size.forward * along_east
        north = truth["north_m"][rows] + size.forward * along_north
        return cls(east, north, along_east, along_north, 0.5 * size.length, 0.5 * size.width)


def body_distances(bodies: Bodies, others: Bodies) -> Array:
    """Distances (N, m) between two bodies, 0 where they overlap."""
    nearest = np.full(len(bodies.east), np.inf)
    for here, there in ((bodies, others), (others, bodies)):
        for length in (here.half_length, -here.half_length):
            for width in (here.half_width, -here.half_width):
                east = here.east + length * here.along_east - width * here.along_north
                north = here.north + length * here.along_north + width * here.along_east
                nearest = np.minimum(nearest, _distance_to_corner(there, east, north))
    nearest[_overlap(bodies, others)] = 0.0
    return nearest


def _distance_to_corner(bodies: Bodies, east: Array, north: Array) -> Array:
    to_east, to_north = bodies.east - east, bodies.north - north
    along = np.abs(to_east * bodies.along_east + to_north * bodies.along_north)
    across = np.abs(to_north * bodies.along_east - to_east * bodies.along_north)
    beyond_ends = np.maximum(along - bodies.half_length, 0.0)
    beyond_sides = np.maximum(across - bodies.half_width, 0.0)
    distance: Array = np.hypot(beyond_ends, beyond_sides)
    return distance


def _overlap(bodies: Bodies, others: Bodies) -> Array:
    """Whether bodies share more than their edges (separating axis theorem)."""
    to_east, to_north = others.east - bodies.east, others.north - bodies.north
    cosine = np.abs(bodies.along_east * others.along_east + bodies.along_north * others.along_north)
    sine = np.abs(bodies.along_east * others.along_north - bodies.along_north * others.along_east)
    overlap: Array = np.ones(len(cosine), bool)
    for here, there in ((bodies, others), (others, bodies)):
        along = np.abs(to_east * here.along_east + to_north * here.along_north)
        across = np.abs(to_north * here.along_east - to_east * here.along_north)
        length = here.half_length + there.half_length * cosine + there.half_width * sine
        width = here.half_width + there.half_length * sine + there.half_width * cosine
        overlap &= (along < length) & (across < width)
    return overlap
