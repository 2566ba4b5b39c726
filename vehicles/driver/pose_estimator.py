"""Pose estimate of the own car: dead reckoning, corrected by its own fixes.

An error-state Kalman filter. The pose is predicted from the readings of the inertial sensor, with
the lateral slip of the single-track model (`vehicles.car.imu`). A fix corrects position, heading
and the sensor biases. The gains follow from the stated noise of both and the covariance since the
last fix (`joint_covariance`), so there is nothing to tune.

At 30 m/s with the usual sensors (50 Hz; fixes of 2 cm and 0.1 deg at 20 Hz) the gain of a fix is
0.1 on a straight, and 0.3 on an arc of 500 m, where the slip is uncertain because the load is
unknown.

Without `stated` errors, those of fixes are assumed white. Lasting errors (drift, bias) would then
be followed, smoothed, and the covariance would be too small. With the error model that the receiver
states, its lasting errors are estimated as well; a receiver that states a wrong accuracy still
misleads the filter.

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
from vehicles.car.gnss_errors import StatedErrors
from vehicles.car.gnss_settings import STATES_WITH_FIX
from vehicles.car.imu import DriftModel, InertialNoise, Motion, SlipModel
from vehicles.car.noise import GnssNoise
from vehicles.car.parameters import VehicleParameters
from vehicles.driver.joint_covariance import GATE, HEADING, JointCovariance
from vehicles.driver.own_state import Pose
from vehicles.messages import FixState
from vehicles.schedule import SECOND

JUMPS_ACCEPTED: Final = 3  # Consecutive outliers in agreement that restart the filter

JUMP_DISTANCE: Final = 0.5
JUMP_GROWTH: Final = 3.0
"""Largest distance of a sliding car from dead reckoning (m, and m/s times the age of the last fix).
"""

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
        gnss: GnssNoise | None = None,
        imu: InertialNoise | None = None,
        imu_rate_hz: float = 50.0,
        *,
        stated: StatedErrors | None = None,
        start: Fix | None = None,
        latency: int = 0,
    ) -> None:
        gnss, imu = gnss or GnssNoise(), imu or InertialNoise()
        self._slip = SlipModel(parameters)
        drift = DriftModel(self._slip, imu, imu_rate_hz)
        self._joint = JointCovariance(
            stated or StatedErrors(dict.fromkeys(STATES_WITH_FIX, LEAST_VARIANCE), (), 0.0, 0.0, 0),
            (drift.along, drift.across(0.0, 0.0), drift.heading),
            (imu.speed_bias, imu.yaw_rate_bias),
        )
        self._heading = gnss.heading**2 + LEAST_VARIANCE
        self._speed_noise = gnss.speed**2 + imu.speed**2 + LEAST_VARIANCE
        self._yaw_rate_noise = gnss.yaw_rate**2 + imu.yaw_rate**2 + LEAST_VARIANCE
        self._start, self._latency = start, latency
        self._pose: Pose | None = None  # with the speed and yaw rate of the last reading
        self._lateral_speed = self._speed_bias = self._yaw_rate_bias = 0.0
        self._at = self._read_at = self._fixed_at = 0
        self._past: deque[tuple[int, Pose]] = deque()
        self._refused: tuple[int, list[float]] | None = None
        self._refusals = 0

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
        if self._latency:
            self._past.append((self._at, pose))
            while len(self._past) > 1 and self._past[1][0] <= now - self._latency:
                self._past.popleft()
        self._pose, self._at = Pose(east, north, yaw, speed, yaw_rate), now
        return self._pose

    def correct(self, fix: Fix) -> None:
        """Correct by a fix of the own receiver; fixes are in order of measurement.

        The first one initialises the filter. Fixes that are not finite, not newer than the last
        fix, or later than the latency are ignored, as are outliers (see GATE). The third
        consecutive outlier that agrees with the others by dead reckoning restarts the filter.
        """
        if not math.isfinite(fix.east + fix.north + fix.yaw + fix.speed + fix.yaw_rate):
            return
        pose, at = self._pose, fix.measured_at
        if pose is None:
            self.begin(fix, fix.state)
        elif at > self._fixed_at and at >= self._at:
            pose = self._predict(pose, at, pose.speed, pose.yaw_rate)
            self._correct(fix, self._read_at, pose, pose)
        elif at > self._fixed_at and self._past and at >= self._past[0][0]:
            read_at, then = next(one for one in reversed(self._past) if one[0] <= at)
            speed, yaw_rate = then.speed - self._speed_bias, then.yaw_rate - self._yaw_rate_bias
            sideways = self._slip.steady(speed, yaw_rate)
            place = _moved(then, (at - read_at) / SECOND, speed, sideways, yaw_rate)
            self._correct(fix, read_at, Pose(*place, then.speed, then.yaw_rate), pose)

    def begin(self, start: Fix, state: FixState | None = None) -> None:
        """Initialise by a fix in `state`, or by a known pose with white errors without one."""
        self._pose = Pose(
            start.east, start.north, remainder(start.yaw, tau), start.speed, start.yaw_rate
        )
        self._lateral_speed = self._slip.steady(start.speed, start.yaw_rate)
        self._at = self._read_at = self._fixed_at = start.measured_at
        white = start.accuracy**2 if state is None else self._joint.white_variance(start)
        self._joint.start(white, self._heading, state, start.measured_at)

    def _correct(self, fix: Fix, read_at: int, then: Pose, pose: Pose) -> None:
        """Correct by a fix, at whose instant the estimate was `then`; it is now `pose`.

        The last reading before the fix was at `read_at` (ns).
        """
        joint, at = self._joint, fix.measured_at
        joint.enter(fix.state, at)
        off = [
            fix.east - then.east,
            fix.north - then.north,
            remainder(fix.yaw - then.yaw, tau),
            then.speed - fix.speed - self._speed_bias,
            then.yaw_rate - fix.yaw_rate - self._yaw_rate_bias,
        ]
        age, white = (at - read_at) / SECOND, joint.white_variance(fix)
        speed_noise = self._speed_noise + (ACCELERATION * age) ** 2
        yaw_rate_noise = self._yaw_rate_noise + (YAW_ACCELERATION * age) ** 2
        noise = white, white, self._heading, speed_noise, yaw_rate_noise
        change = joint.correct(fix.state, off, noise, _free((at - self._fixed_at) / SECOND))
        if change is None:
            self._refuse(fix, off)
            return
        east, north, turned, speed_bias, yaw_rate_bias = change
        self._speed_bias += speed_bias
        self._yaw_rate_bias += yaw_rate_bias
        for one in (*[past for _, past in self._past], pose):
            ahead_east, ahead_north = pose.east - one.east, pose.north - one.north
            one.east += east + turned * ahead_north
            one.north += north - turned * ahead_east
            one.yaw = remainder(one.yaw + turned, tau)
        self._fixed_at, self._refused = at, None

    def _refuse(self, fix: Fix, off: list[float]) -> None:
        """Count an outlier, `off` the estimate (m, rad), and restart at the third in agreement."""
        agrees, noise = False, 2.0 * GATE * math.sqrt(self._heading)
        if self._refused is not None:
            at, before = self._refused
            reach, turn = _free((fix.measured_at - at) / SECOND)
            away = math.hypot(off[0] - before[0], off[1] - before[1])
            turned = abs(remainder(off[2] - before[2], tau))
            agrees = away <= reach + 2.0 * GATE * fix.accuracy and turned <= turn + noise
        self._refusals = self._refusals + 1 if agrees else 1
        self._refused = fix.measured_at, off
        if self._refusals >= JUMPS_ACCEPTED:
            self.begin(fix, fix.state)
            self._past.clear()
            self._refused = None

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


def _free(span: float) -> tuple[float, float]:
    """Largest distance (m) and angle (rad) from dead reckoning that a car slides in `span` (s)."""
    return JUMP_DISTANCE + JUMP_GROWTH * span, JUMP_HEADING + JUMP_TURNING * span


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
