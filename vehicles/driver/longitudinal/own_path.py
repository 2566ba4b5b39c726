"""The path that a car itself has driven, along which vehicles behind it follow; SI units."""

from math import cos, hypot, inf, sin
from typing import Final

from vehicles.driver.ego.own_state import Pose
from vehicles.preview.received.polyline import Polyline, step

STEP: Final = 0.5  # Distance (m) between stored positions
CAPACITY: Final = 8192
DROPPED_AT_ONCE: Final = 2048  # Positions stored at most, and oldest dropped at once
BACK: Final = 2.0  # A vehicle behind may seem to move back by this (m)
REACH_RATIO: Final = 1.5  # Its advance over the distance between its poses


class OwnPath:
    """Positions that the car has driven through, with their arc length.

    It begins with a straight behind the initial position, as a convoy starts on a straight.
    """

    def __init__(self) -> None:
        self._line = Polyline()
        self._located: dict[str, tuple[float, float, float]] = {}

    def extend(self, now: int, pose: Pose) -> None:
        """Add the pose at `now` (ns), unless the car has hardly moved."""
        line, place = self._line, (now, pose.east, pose.north, pose.yaw)
        if not line.at:
            behind = pose.east - STEP * cos(pose.yaw), pose.north - STEP * sin(pose.yaw)
            line.append((now - 1, *behind, pose.yaw), 0.0)
            line.append(place, STEP)
            return
        driven = step(line.point(-1), place)
        if driven >= STEP:
            line.append(place, driven)
            if len(line) > CAPACITY:
                line.drop(DROPPED_AT_ONCE)

    def spacing(self, name: str, east: float, north: float, pose: Pose) -> float:
        """Arc length (m) from the car at `pose` to a position of the vehicle `name`, negative.

        The position is searched near the last one, so that another leg of a hairpin is not taken.
        """
        line, before = self._line, self._located.get(name)
        low, high = -inf, inf
        if before is not None:
            moved = hypot(east - before[0], north - before[1])
            low, high = before[2] - BACK, before[2] + BACK + REACH_RATIO * moved
        station = line.nearest(east, north, low, high)
        self._located[name] = east, north, station
        return station - line.nearest(pose.east, pose.north, line.station[-1] - BACK, inf)
