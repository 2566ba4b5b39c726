"""The own pose of a car: interface of its estimators, and the exact state."""

import math
from dataclasses import dataclass
from typing import Protocol

from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import Motion


@dataclass(slots=True)
class Pose:
    """Position (m, world frame), yaw (rad, within (-pi, pi]), speed (m/s), yaw rate (rad/s)."""

    east: float
    north: float
    yaw: float
    speed: float
    yaw_rate: float


class OwnState(Protocol):
    """Estimates the own pose: the vehicle block of Fig. 1, with the integration of V-D."""

    def update(self, now: int, fix: Fix | None, motion: Motion | Body | None) -> None:
        """Process the measurements at `now` (ns): an own fix, a reading, both or none."""
        ...

    def at(self, now: int) -> Pose:
        """Pose at `now` (ns), not before the last update; ValueError before the first."""
        ...

    @property
    def lateral_deviation(self) -> float:
        """Standard deviation (m) of the position across the body; NaN if it is unknown."""
        ...


class ExactState:
    """The true state of the car, from an exact sensor (the simulations of Section V-C)."""

    def __init__(self) -> None:
        self._pose: Pose | None = None

    def update(self, now: int, fix: Fix | None, motion: Motion | Body | None) -> None:
        if isinstance(motion, Body):
            yaw = math.remainder(motion.yaw, math.tau)
            self._pose = Pose(motion.east, motion.north, yaw, motion.speed, motion.yaw_rate)

    @property
    def lateral_deviation(self) -> float:
        return 0.0

    def at(self, now: int) -> Pose:
        if self._pose is None:
            raise ValueError("no pose before the first reading")
        return self._pose
