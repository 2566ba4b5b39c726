"""Pose estimate of the own car: dead reckoning, corrected by its own fixes.

An error-state Kalman filter. The pose is predicted from the readings of the inertial sensor, with
the lateral slip of the single-track model (`vehicles.car.imu`). A fix corrects position,
heading and the sensor biases. The gains follow from the stated noise of both and the covariance
since the last fix, so there is nothing to tune.

At 30 m/s with the usual sensors (50 Hz; fixes of 2 cm and 0.1 deg at 20 Hz) the gain of a fix is
0.1 on a straight, and 0.3 on an arc of 500 m, where the slip is uncertain because the load is
unknown.

Without `stated` errors, those of fixes are assumed white. Lasting errors (drift, bias) would then
be followed, smoothed, and the covariance would be too small. With the error model that the receiver
states, its lasting errors are estimated as well; a receiver that states a wrong accuracy still
misleads the filter.
"""

import math
from collections import deque
from math import nan
from typing import Final

from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.gnss_errors import StatedErrors
from vehicles.car.imu import DriftModel, InertialNoise, Motion, SlipModel
from vehicles.car.noise import GnssNoise
from vehicles.car.parameters import VehicleParameters
from vehicles.driver.own_state import Pose
from vehicles.driver.own_track import OwnTrack, TrackModel

JUMPS_ACCEPTED: Final = 3  # Consecutive outliers in agreement that restart the filter


class PoseEstimator:
    """Kalman filter for the pose of a vehicle with `parameters` (integrated GPS and IMU of V-D).

    `imu_rate_hz` is the rate of the readings. Before the first reading, speed and yaw rate are
    those of the first fix. `by_accuracy` weights each fix by the accuracy stated by its receiver,
    instead of `gnss`. `stated` is the error model of the receiver, if its errors may last. `start`
    serves as the first fix if the pose is requested before there is one.
    """

    def __init__(
        self,
        parameters: VehicleParameters,
        gnss: GnssNoise | None = None,
        imu: InertialNoise | None = None,
        imu_rate_hz: float = 50.0,
        *,
        by_accuracy: bool = False,
        stated: StatedErrors | None = None,
        start: Fix | None = None,
    ) -> None:
        slip, noise = SlipModel(parameters), imu or InertialNoise()
        drift = DriftModel(slip, noise, imu_rate_hz)
        self._model = TrackModel(slip, drift, gnss or GnssNoise(), noise, by_accuracy, stated)
        self._parameters, self._imu_rate_hz = parameters, imu_rate_hz
        self._start = start
        self._motion: Motion | None = None
        self._track: OwnTrack | None = None
        self._rival: OwnTrack | None = None

    def update(self, now: int, fix: Fix | None, motion: Motion | Body | None) -> None:
        """Process the measurements at `now` (ns): first the reading, then the fix."""
        if motion is not None:
            self.move(now, motion.speed, motion.yaw_rate)
        if fix is not None:
            self.correct(fix)

    def move(self, now: int, speed: float, yaw_rate: float) -> None:
        """Predict to a reading at `now` (ns) by eqs. (1), (2), interpolating linearly.

        Readings that are not finite, or older than the estimate, are ignored.
        """
        if not math.isfinite(speed + yaw_rate):
            return
        if self._track is None:
            self._motion = Motion(speed, yaw_rate)
        elif now >= self._track.at:
            self._track.read(now, speed, yaw_rate)
            if self._rival is not None:
                self._rival.read(now, speed, yaw_rate)

    def assume(self, parameters: VehicleParameters) -> None:
        """Assume other parameters of the car for its slip, by eqs. (1), (2), from now on."""
        slip = SlipModel(parameters)
        self._model.slip = slip
        self._model.drift = DriftModel(slip, self._model.imu, self._imu_rate_hz)

    def copy(self) -> "PoseEstimator":
        other = PoseEstimator(self._parameters, imu_rate_hz=self._imu_rate_hz, start=self._start)
        other._model, other._motion = self._model, self._motion
        other._track = self._track and self._track.copy()
        return other

    def correct(self, fix: Fix) -> None:
        """Correct by a fix of the own receiver; fixes are in order of measurement.

        The first one initialises the filter. Fixes that are not finite, older than the estimate or
        not newer than the last fix are ignored, as are outliers (see GATE). The third consecutive
        outlier that agrees with the others by dead reckoning restarts the filter.
        """
        if not math.isfinite(fix.east + fix.north + fix.yaw + fix.speed + fix.yaw_rate):
            return
        if self._track is None:
            self._track = OwnTrack.from_fix(fix, self._motion_at(fix), self._model)
        elif fix.measured_at > self._track.fixed_at and fix.measured_at >= self._track.at:
            self._correct(self._track, fix)

    def begin(self, start: Fix) -> None:
        """Initialise by a known pose with white errors, which is not from the receiver."""
        self._track = OwnTrack.from_known(start, self._motion_at(start), self._model)

    def _motion_at(self, fix: Fix) -> Motion:
        return self._motion or Motion(fix.speed, fix.yaw_rate)

    def _correct(self, track: OwnTrack, fix: Fix) -> None:
        if track.correct(fix):
            self._rival = None
            return
        if self._rival is None or not self._rival.correct(fix):
            self._rival = track.restarted(fix)
        if self._rival.fixes >= JUMPS_ACCEPTED:
            self._track, self._rival = self._rival, None

    def at(self, now: int) -> Pose:
        """Pose at `now` (ns) by dead reckoning; ValueError before the first fix."""
        if self._track is None and self._start is not None:
            self.begin(self._start)
        if self._track is None:
            raise ValueError("no pose before the first fix")
        return self._track.pose(now)

    @property
    def deviations(self) -> tuple[float, float, float]:
        """Standard deviations along (m), across (m) and in heading (rad) at the last measurement.

        Raises ValueError before the first fix.
        """
        if self._track is None:
            raise ValueError("no pose before the first fix")
        return self._track.deviations

    @property
    def lateral_deviation(self) -> float:
        return nan if self._track is None else self._track.lateral_deviation  # m


# ---- Own fixes that arrive late
#
# A Kalman filter needs measurements in order of time. So one filter stays at the instant of the
# last fix, and later readings are stored. A late fix corrects it at the fix's own instant, and the
# stored readings are then applied again (out-of-sequence measurements by recomputation; Y. Bar-
# Shalom, X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation",
# 2001).


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
