"""The own pose of a car, by its estimator or exact."""

import math
from dataclasses import dataclass

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


class ExactState:
    """The true state of the car, from an exact sensor (the simulations of Section V-C)."""

    lateral_deviation = 0.0

    def __init__(self) -> None:
        self._pose: Pose | None = None

    def update(self, now: int, fix: Fix | None, motion: Motion | Body | None) -> None:
        if isinstance(motion, Body):
            yaw = math.remainder(motion.yaw, math.tau)
            self._pose = Pose(motion.east, motion.north, yaw, motion.speed, motion.yaw_rate)

    def at(self, now: int) -> Pose:
        if self._pose is None:
            raise ValueError("no pose before the first reading")
        return self._pose
