"""Own fixes that arrive late: the estimate of their instant is corrected, and predicted to now.

A Kalman filter takes measurements in order of time. So one filter waits at the last fix, with the
readings since then stored; a late fix finds it moved to its own instant, and the readings after it
are applied again (out-of-sequence measurements by recomputation; Y. Bar-Shalom, X. R. Li,
T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001).
"""

from collections import deque

from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import Motion
from vehicles.car.parameters import VehicleParameters
from vehicles.driver.ego.own_state import Pose
from vehicles.driver.ego.pose_estimator import PoseEstimator


class LatePoseEstimator:
    """A `PoseEstimator` (Kalman, Section V-D) of a car whose fixes come `latency` (ns) late."""

    def __init__(self, estimator: PoseEstimator, latency: int) -> None:
        """`estimator` has a start, if the first fix comes after the start."""
        self._past, self._present = estimator, estimator.copy()
        self._latency = latency
        self._readings: deque[tuple[int, Motion]] = deque()

    def update(self, now: int, fix: Fix | None, motion: Motion | Body | None) -> None:
        """Take in a reading of `now` (ns) and an earlier fix."""
        if motion is not None:
            self._readings.append((now, Motion(motion.speed, motion.yaw_rate)))
            self._present.move(now, motion.speed, motion.yaw_rate)
        # No later fix is older, so the stored readings do not grow in a tunnel.
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

    def at(self, now: int) -> Pose:
        """Pose at `now` (ns) by dead reckoning from the last fix; ValueError before the first."""
        return self._present.at(now)
