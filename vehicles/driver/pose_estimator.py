"""Pose estimate of the own car: dead reckoning, corrected by its own fixes.

An error-state Kalman filter. The pose is predicted from the readings of the inertial sensor, with
the lateral slip of the single-track model (`vehicles.car.imu`). A fix corrects position, heading
and the sensor biases. The gains follow from the stated noise of both and the covariance since the
last fix (`joint_covariance`), so there is nothing to tune. At 30 m/s with the usual sensors the
gain of a fix is 0.1 on a straight, and 0.3 on an arc of 500 m, where the load makes the slip
uncertain.

With the error model that the receiver states, lasting errors of fixes (drift, bias) are estimated
as well; without it they would be followed, and the covariance would be too small. A receiver that
states a wrong accuracy misleads the filter.

A late fix is compared with the estimate at its own instant, and corrects the present one by the
gains of a present fix. Up to a latency of 200 ms, lateral errors are within 3 % of those of a
filter that is restarted at each fix with stored readings.
"""

import math
from collections import deque
from math import nan, remainder, tau
from typing import Final

from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.gnss_settings import STATES_WITH_FIX, GnssSettings, StatedErrors
from vehicles.car.imu import DriftModel, ImuSettings, Motion, SlipModel
from vehicles.car.parameters import VehicleParameters
from vehicles.driver.joint_covariance import HEADING, JointCovariance
from vehicles.driver.own_state import ExactState, Pose
from vehicles.messages import FixState
from vehicles.schedule import SECOND

JUMPS_ACCEPTED: Final = 3  # Consecutive outliers that restart the filter
JUMP_DISTANCE: Final = 0.5
JUMP_GROWTH: Final = 3.0  # Largest slide of a car (m, m/s) beyond dead reckoning since a fix
JUMP_HEADING: Final = 0.1
JUMP_TURNING: Final = 0.5  # The same for its heading (rad, rad/s)
ACCELERATION: Final = 3.0
YAW_ACCELERATION: Final = 1.0  # Assumed rates (m/s², rad/s²) since the last reading
LEAST_VARIANCE: Final = 1e-12  # Of a measurement, so that an exact one of an exact state is usable


class PoseEstimator:
    """Kalman filter for the pose of a vehicle with `parameters` (integrated GPS and IMU of V-D).

    `imu_rate_hz` is the rate of the readings. Before the first reading, speed and yaw rate are
    those of the first fix. Fixes are weighted by the accuracy that their receiver states, with its
    error model `stated` if its errors may last. `start` serves as the first fix if the pose is
    requested before there is one. Fixes arrive up to `latency` (ns) late.
    """

    def __init__(
        self,
        parameters: VehicleParameters,
        gnss: GnssSettings | None = None,
        imu: ImuSettings | None = None,
        imu_rate_hz: float = 50.0,
        *,
        stated: StatedErrors | None = None,
        start: Fix | None = None,
        latency: int = 0,
    ) -> None:
        gnss, imu = gnss or GnssSettings(), imu or ImuSettings()
        self._slip = SlipModel(parameters)
        drift = DriftModel(self._slip, imu, imu_rate_hz)
        self._joint = JointCovariance(
            stated or StatedErrors(dict.fromkeys(STATES_WITH_FIX, LEAST_VARIANCE), (), 0.0, 0.0, 0),
            (drift.along, drift.across(0.0, 0.0), drift.heading),
            (imu.speed_bias, imu.yaw_rate_bias),
        )
        self._heading = gnss.heading_noise**2 + LEAST_VARIANCE
        self._speed_noise = gnss.speed_noise**2 + imu.speed_noise**2 + LEAST_VARIANCE
        self._yaw_rate_noise = gnss.yaw_rate_noise**2 + imu.yaw_rate_noise**2 + LEAST_VARIANCE
        self._start = start
        self._pose: Pose | None = None  # with the speed and yaw rate of the last reading
        self._lateral_speed = self._speed_bias = self._yaw_rate_bias = 0.0
        self._at = self._read_at = self._fixed_at = 0
        stored = math.ceil(latency / SECOND * imu_rate_hz) + 2 if latency else 0
        self._past: deque[tuple[int, Pose]] = deque(maxlen=stored)
        self._outliers = 0

    def update(self, now: int, fix: Fix | None, motion: Motion | Body | None) -> None:
        """Process the measurements at `now` (ns): first the reading, then the fix."""
        if motion is not None:
            self.move(now, motion.speed, motion.yaw_rate)
        if fix is not None:
            self.correct(fix)

    def assume(self, parameters: VehicleParameters) -> None:
        """Assume other parameters of the car for its slip, by eqs. (1), (2), from now on."""
        self._slip = SlipModel(parameters)

    def move(self, now: int, speed: float, yaw_rate: float) -> None:
        """Predict to a reading at `now` (ns) by eqs. (1), (2), interpolating linearly.

        Readings that are not finite, or older than the estimate, are ignored.
        """
        if self._pose is not None and math.isfinite(speed + yaw_rate) and now >= self._at:
            self._predict(self._pose, now, speed, yaw_rate)
            self._read_at = now

    def _predict(self, pose: Pose, now: int, speed: float, yaw_rate: float) -> Pose:
        """Predict pose and covariance to `now` (ns), where speed and yaw rate are these."""
        span, slip = (now - self._at) / SECOND, self._slip
        if span <= 0.0:
            self._pose = Pose(pose.east, pose.north, pose.yaw, speed, yaw_rate)
            return self._pose
        forward = 0.5 * (pose.speed + speed) - self._speed_bias
        forward = forward if forward > 0.0 else 0.0
        first, last = pose.yaw_rate - self._yaw_rate_bias, yaw_rate - self._yaw_rate_bias
        turning, before = 0.5 * (first + last), self._lateral_speed
        self._lateral_speed = slip.after(span, forward, first, last, before)
        sideways = 0.5 * (before + self._lateral_speed)
        east, north, yaw = _moved(pose, span, forward, sideways, turning)
        effect = span * slip.load_effect(forward, turning)
        self._joint.grow(span, east - pose.east, north - pose.north, pose.yaw, effect)
        self._past.append((self._at, pose))
        self._pose, self._at = Pose(east, north, yaw, speed, yaw_rate), now
        return self._pose

    def correct(self, fix: Fix) -> None:
        """Correct by a fix of the own receiver; fixes are in order of measurement.

        The first one initialises the filter. Fixes that are not finite, not newer than the last
        fix, or older than the stored readings are ignored, as are outliers (`JointCovariance`). The
        third consecutive outlier restarts the filter.
        """
        if not math.isfinite(fix.east + fix.north + fix.yaw + fix.speed + fix.yaw_rate):
            return
        pose, at = self._pose, fix.measured_at
        if pose is None:
            self.begin(fix, fix.state)
        elif at > self._fixed_at:
            if at >= self._at:
                pose = self._predict(pose, at, pose.speed, pose.yaw_rate)
            states = [*self._past, (self._at, pose)]
            before = [state for state in states if state[0] <= at]
            if before:
                self._correct(fix, *before[-1], [state for _, state in states])

    def begin(self, start: Fix, state: FixState | None = None) -> None:
        """Initialise by a fix in `state`, or by a known pose with white errors without one."""
        self._pose = Pose(
            start.east, start.north, remainder(start.yaw, tau), start.speed, start.yaw_rate
        )
        self._lateral_speed = self._slip.steady(start.speed, start.yaw_rate)
        self._at = self._read_at = self._fixed_at = start.measured_at
        self._past.clear()
        self._outliers = 0
        white = start.accuracy**2 if state is None else self._joint.white_variance(start)
        self._joint.start(white, self._heading, state, start.measured_at)

    def _correct(self, fix: Fix, before_at: int, before: Pose, poses: list[Pose]) -> None:
        """Correct `poses`, of which the last one is the present one, by a fix.

        The last of them before the fix is `before`, at `before_at` (ns).
        """
        joint, at = self._joint, fix.measured_at
        joint.enter(fix.state, at)
        speed, yaw_rate = before.speed - self._speed_bias, before.yaw_rate - self._yaw_rate_bias
        sideways = self._slip.steady(speed, yaw_rate)
        east, north, yaw = _moved(before, (at - before_at) / SECOND, speed, sideways, yaw_rate)
        turned = math.remainder(fix.yaw - yaw, math.tau)
        speed_off, yaw_rate_off = speed - fix.speed, yaw_rate - fix.yaw_rate
        off = [fix.east - east, fix.north - north, turned, speed_off, yaw_rate_off]
        age, white = (at - min(before_at, self._read_at)) / SECOND, joint.white_variance(fix)
        speed_noise = self._speed_noise + (ACCELERATION * age) ** 2
        yaw_rate_noise = self._yaw_rate_noise + (YAW_ACCELERATION * age) ** 2
        noise = white, white, self._heading, speed_noise, yaw_rate_noise
        span = (at - self._fixed_at) / SECOND
        free = JUMP_DISTANCE + JUMP_GROWTH * span, JUMP_HEADING + JUMP_TURNING * span
        change = joint.correct(fix.state, off, noise, free)
        self._outliers = 0 if change else self._outliers + 1
        if self._outliers >= JUMPS_ACCEPTED:
            self.begin(fix, fix.state)
        if change is None:
            return
        east, north, turned, speed_bias, yaw_rate_bias = change
        self._speed_bias += speed_bias
        self._yaw_rate_bias += yaw_rate_bias
        for one in poses:
            ahead_east, ahead_north = poses[-1].east - one.east, poses[-1].north - one.north
            one.east += east + turned * ahead_north
            one.north += north - turned * ahead_east
            one.yaw = math.remainder(one.yaw + turned, math.tau)
        self._fixed_at = at

    def at(self, now: int) -> Pose:
        """Pose at `now` (ns) by dead reckoning; ValueError before the first fix."""
        if self._pose is None and self._start is not None:
            self.begin(self._start)
        pose = self._pose
        if pose is None:
            raise ValueError("no pose before the first fix")
        speed, yaw_rate = pose.speed - self._speed_bias, pose.yaw_rate - self._yaw_rate_bias
        speed = speed if speed > 0.0 else 0.0
        span = (now - self._at) / SECOND
        if span <= 0.0:
            return Pose(pose.east, pose.north, pose.yaw, speed, yaw_rate)
        before = self._lateral_speed
        sideways = 0.5 * (before + self._slip.after(span, speed, yaw_rate, yaw_rate, before))
        return Pose(*_moved(pose, span, speed, sideways, yaw_rate), speed, yaw_rate)

    @property
    def deviations(self) -> tuple[float, float, float]:
        """Standard deviations along (m), across (m), in heading (rad) at the last measurement."""
        along = nan if self._pose is None else self._joint.deviation(self._pose.yaw)
        return along, self.lateral_deviation, math.sqrt(self._joint.values[HEADING, HEADING])

    @property
    def lateral_deviation(self) -> float:
        return nan if self._pose is None else self._joint.deviation(self._pose.yaw + 0.5 * math.pi)


def _moved(
    pose: Pose, span: float, speed: float, sideways: float, yaw_rate: float
) -> tuple[float, float, float]:
    """East, north, yaw after `span` (s) at constant speeds and yaw rate, exactly."""
    half = 0.5 * yaw_rate * span
    # At a constant yaw rate the displacement is the chord, turned by half the change of yaw.
    chord = span * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
    cos, sin = math.cos(pose.yaw + half), math.sin(pose.yaw + half)
    return (
        pose.east + chord * (speed * cos - sideways * sin),
        pose.north + chord * (speed * sin + sideways * cos),
        remainder(pose.yaw + 2.0 * half, tau),
    )


OwnState = PoseEstimator | ExactState
"""Estimates the own pose: the vehicle block of Fig. 1, with the integration of V-D."""
