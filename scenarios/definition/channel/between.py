"""The vehicles between the ends of a directed link, and the road along which they drive."""

from collections.abc import Callable

import numpy as np

from scenarios.definition.road.route import Route
from transport.links.laws.between import Road, VehiclesBetween
from vehicles.geometry.path import Path

ROAD_STEP = 2.0
"""Metres between two places of the road by which vehicles in between are sought."""

Between = Callable[[], VehiclesBetween]
"""Returns the vehicles between sender and receiver, and their road."""


def vehicles_between(route: Route, sender: int, receiver: int) -> VehiclesBetween:
    """Return the vehicles between those at two places of the convoy, the lead's being 0."""
    first = float(route.path.station[0])
    return VehiclesBetween(
        count=max(abs(receiver - sender) - 1, 0),
        road=_road(route.path),
        sender_start=route.start_station(sender) - first,
        receiver_start=route.start_station(receiver) - first,
    )


def _road(path: Path) -> Road:
    """Sample a path; the last piece is on the straight that leaves it."""
    first, count = float(path.station[0]), int(path.length / ROAD_STEP) + 1
    nodes = first + ROAD_STEP * np.arange(count)
    beyond = [path.at(first + ROAD_STEP * (count + more)) for more in (0, 1)]
    return Road(
        ROAD_STEP,
        (*np.interp(nodes, path.station, path.east).tolist(), *(point.east for point in beyond)),
        (*np.interp(nodes, path.station, path.north).tolist(), *(point.north for point in beyond)),
    )
