"""Own fixes that arrive late.

A Kalman filter needs measurements in order of time. So one filter stays at the instant of the last
fix, and later readings are stored. A late fix corrects it at the fix's own instant, and the stored
readings are then applied again (out-of-sequence measurements by recomputation; Y. Bar-Shalom,
X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001).
"""

from collections import deque

from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.parameters import VehicleParameters
from vehicles.car.sensors.imu import Motion
from vehicles.driver.ego.own_state import Pose
from vehicles.driver.ego.pose_estimator import PoseEstimator


class LatePoseEstimator:
    """A `PoseEstimator` (Kalman, Section V-D) for fixes that arrive `latency` (ns) late."""

    def __init__(self, estimator: PoseEstimator, latency: int) -> None:
        """`estimator` needs a `start` if the first fix arrives after the first reading."""
        self._past, self._present = estimator, estimator.copy()
        self._latency = latency
        self._readings: deque[tuple[int, Motion]] = deque()

    def update(self, now: int, fix: Fix | None, motion: Motion | Body | None) -> None:
        if motion is not None:
            self._readings.append((now, Motion(motion.speed, motion.yaw_rate)))
            self._present.move(now, motion.speed, motion.yaw_rate)
        # No later fix is older than this, so stored readings do not accumulate in a tunnel.
        until = now - self._latency if fix is None else fix.measured_at
        while self._readings and self._readings[0][0] <= until:
            at, reading = self._readings.popleft()
            self._past.move(at, reading.speed, reading.yaw_rate)
        if fix is not None:
            self._past.correct(fix)
            self._present = self._past.copy()
            for at, reading in self._readings:
                self._present.move(at, reading.speed, reading.yaw_rate)

    def assume(self, parameters: VehicleParameters) -> None:
        self._past.assume(parameters)  # its copies share the model

    @property
    def deviations(self) -> tuple[float, float, float]:
        return self._present.deviations

    @property
    def lateral_deviation(self) -> float:
        return self._present.lateral_deviation

    def at(self, now: int) -> Pose:
        return self._present.at(now)
