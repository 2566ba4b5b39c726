"""Bends of the known path ahead: how fast a follower may drive now to take them."""

from collections import deque
from math import hypot
from typing import Final

from vehicles.geometry.geodesy import along
from vehicles.received_pose import ReceivedPose

MIN_SPEED: Final = 1.0  # Below this speed (m/s) a measured yaw rate does not determine a curvature
SPACING: Final = 0.5  # Poses of a source that has moved less than this (m) are skipped
CAPACITY: Final = 4096  # Largest number of poses kept ahead of the car


class BendsAhead:
    """Speed limit by the poses that a source sent from the path ahead.

    A pose at the distance s ahead with curvature κ, its yaw rate over its speed, allows
    v² <= a_lat/|κ| + 2 b s. Of two poses only the later one counts if it allows less now: it will
    then do so until it is passed.
    """

    def __init__(self, lateral: float, braking: float) -> None:
        """`lateral` acceleration in bends, and `braking` before them (m/s²)."""
        self._lateral = lateral
        self._braking = braking
        self._path: deque[tuple[float, float, float, float]] = deque(maxlen=CAPACITY)
        self._bends: deque[tuple[float, float]] = deque(maxlen=CAPACITY)
        self._newest_at = 0

    def add(self, pose: ReceivedPose) -> None:
        """Take a pose; late ones are ignored."""
        if pose.measured_at <= self._newest_at:
            return
        self._newest_at = pose.measured_at
        station = 0.0
        if self._path:
            before, east, north, _ = self._path[-1]
            moved = hypot(pose.east - east, pose.north - north)
            if moved < SPACING:
                return
            station = before + moved
        self._path.append((station, pose.east, pose.north, pose.yaw))
        if pose.speed < MIN_SPEED or pose.yaw_rate == 0.0:
            return
        bends = self._bends
        squared = self._lateral * pose.speed / abs(pose.yaw_rate) + 2.0 * self._braking * station
        while bends and bends[-1][1] >= squared:
            bends.pop()
        bends.append((station, squared))

    def allowed(self, east: float, north: float) -> tuple[float, float] | None:
        """Squared speed (m²/s²) allowed at a position (m), and distance (m) of the bend.

        None without a bend ahead.
        """
        path, bends = self._path, self._bends
        if not path:
            return None
        while len(path) > 1 and _station_along(path[1], east, north) >= path[1][0]:
            path.popleft()
        station = _station_along(path[0], east, north)
        while bends and bends[0][0] < station:
            bends.popleft()
        if not bends:
            return None
        at, squared = bends[0]
        return squared - 2.0 * self._braking * station, at - station


def _station_along(point: tuple[float, float, float, float], east: float, north: float) -> float:
    """Station (m) of a position by its distance ahead of a `point`."""
    station, point_east, point_north, yaw = point
    return station + along(yaw, east - point_east, north - point_north)
