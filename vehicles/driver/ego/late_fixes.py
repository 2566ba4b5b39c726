"""Own fixes that are known late: the estimate of then is corrected, and carried on to now.

A Kalman filter takes measurements in order of time. So it stands still at the last fix, with the
readings since then put by; a fix that comes late finds it brought up to its own instant, and what
follows is done again (out-of-sequence measurements by recomputation; Y. Bar-Shalom, X. R. Li,
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
        """`estimator` knows where the car starts, if the first fix comes after the start."""
        self._past, self._present = estimator, estimator.twin()
        self._latency = latency
        self._readings: deque[tuple[int, Motion]] = deque()

    def update(self, now: int, fix: Fix | None, motion: Motion | Body | None) -> None:
        """Take in what is known at `now` (ns): a reading of now, a fix of earlier (Kalman)."""
        if motion is not None:
            self._readings.append((now, Motion(motion.speed, motion.yaw_rate)))
            self._present.move(now, motion.speed, motion.yaw_rate)
        # No fix that is still to come is older, so what is put by does not grow in a tunnel.
        self._recall(now - self._latency if fix is None else fix.measured_at)
        if fix is not None:
            self._past.correct(fix)
            self._present = self._past.twin()
            for at, reading in self._readings:
                self._present.move(at, reading.speed, reading.yaw_rate)

    def _recall(self, until: int) -> None:
        """Bring the filter of then up to `until` (ns)."""
        while self._readings and self._readings[0][0] <= until:
            at, reading = self._readings.popleft()
            self._past.move(at, reading.speed, reading.yaw_rate)

    def assume(self, parameters: VehicleParameters) -> None:
        """Take other parameters of the car for its slip, by eqs. (1), (2), from now on."""
        self._past.assume(parameters)  # which its twins share

    def at(self, now: int) -> Pose:
        """Pose at `now` (ns) by dead reckoning from the last fix (Kalman).

        ValueError before the first.
        """
        return self._present.at(now)
