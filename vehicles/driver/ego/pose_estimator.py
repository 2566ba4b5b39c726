"""Pose estimate of the own car: dead reckoning, corrected by its own fixes.

An error-state Kalman filter. The pose is predicted from the readings of the inertial sensor, with
the lateral slip of the single-track model (`vehicles.car.dead_reckoning`). A fix corrects position,
heading and the sensor biases. The gains follow from the stated noise of both and the covariance
since the last fix, so there is nothing to tune.

At 30 m/s with the usual sensors (50 Hz; fixes of 2 cm and 0.1 deg at 20 Hz) the gain of a fix is
0.1 on a straight, and 0.3 on an arc of 500 m, where the slip is uncertain because the load is
unknown.

Errors of fixes are assumed white. Lasting errors (drift, bias) cannot be distinguished from the
car's motion: the estimate follows them, smoothed, and its covariance is too small.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Final

from vehicles.car.dead_reckoning import DriftModel, SlipModel
from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import InertialNoise, Motion
from vehicles.car.parameters import VehicleParameters
from vehicles.car.positioning.noise import GnssNoise
from vehicles.driver.ego.covariance import AcrossCovariance, AlongCovariance
from vehicles.driver.ego.own_state import Pose
from vehicles.geometry.geodesy import wrap_angle
from vehicles.schedule import SECOND

GATE: Final = 6.0
"""Innovations beyond this number of standard deviations are outliers."""

JUMP_DISTANCE: Final = 0.5
JUMP_GROWTH: Final = 3.0
"""Largest distance of a sliding car from dead reckoning (m, and m/s times the age of the last fix).
"""

JUMP_HEADING: Final = 0.1
JUMP_TURNING: Final = 0.5
"""The same for its heading (rad, rad/s)."""

JUMPS_ACCEPTED: Final = 3
"""After this number of consecutive outliers that agree with one another the filter restarts."""

ACCELERATION: Final = 3.0
YAW_ACCELERATION: Final = 1.0
"""Assumed rates of change (m/s², rad/s²) of speed and yaw rate since the last reading."""


class PoseEstimator:
    """Kalman filter for the pose of a vehicle with `parameters` (integrated GPS and IMU of V-D).

    `imu_rate_hz` is the rate of the readings. Before the first reading, speed and yaw rate are
    those of the first fix. `by_accuracy` weights each fix by the accuracy stated by its receiver,
    instead of `gnss`. `start` serves as the first fix if the pose is requested before there is one.
    """

    def __init__(
        self,
        parameters: VehicleParameters,
        gnss: GnssNoise | None = None,
        imu: InertialNoise | None = None,
        imu_rate_hz: float = 50.0,
        *,
        by_accuracy: bool = False,
        start: Fix | None = None,
    ) -> None:
        slip, noise = SlipModel(parameters), imu or InertialNoise()
        drift = DriftModel(slip, noise, imu_rate_hz)
        self._model = _Model(slip, drift, gnss or GnssNoise(), noise, by_accuracy)
        self._parameters, self._imu_rate_hz = parameters, imu_rate_hz
        self._start = start
        self._motion: Motion | None = None
        self._track: _Track | None = None
        self._rival: _Track | None = None

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
        """Copy the estimate without its outliers; the copies share the model."""
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
            motion = self._motion or Motion(fix.speed, fix.yaw_rate)
            self._track = _Track.from_fix(fix, motion, self._model)
        elif fix.measured_at > self._track.fixed_at and fix.measured_at >= self._track.at:
            self._correct(self._track, fix)

    def _correct(self, track: "_Track", fix: Fix) -> None:
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
            self.correct(self._start)
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
        along, across = self._track.along, self._track.across
        return math.sqrt(along.aa), math.sqrt(across.cc), math.sqrt(across.hh)


@dataclass(slots=True)
class _Model:
    """Models of the car's slip, of the drift of dead reckoning, and of the sensor noise."""

    slip: SlipModel
    drift: DriftModel
    gnss: GnssNoise
    imu: InertialNoise
    by_accuracy: bool
    heading: float = field(init=False)
    speed: float = field(init=False)
    yaw_rate: float = field(init=False)

    def __post_init__(self) -> None:
        gnss, imu = self.gnss, self.imu
        self.heading = gnss.heading**2
        self.speed = gnss.speed**2 + imu.speed**2
        self.yaw_rate = gnss.yaw_rate**2 + imu.yaw_rate**2

    def position(self, fix: Fix) -> float:
        return fix.accuracy if self.by_accuracy else self.gnss.position


@dataclass(slots=True, eq=False, kw_only=True)
class _Track:
    """An estimate, its instant (ns), its covariance and its number of fixes."""

    at: int
    fixed_at: int
    read_at: int
    fixes: int = 1
    east: float
    north: float
    yaw: float
    along: AlongCovariance
    across: AcrossCovariance
    _model: _Model
    _speed: float
    _yaw_rate: float
    _lateral_speed: float
    _speed_bias: float = 0.0
    _yaw_rate_bias: float = 0.0

    @classmethod
    def from_fix(cls, fix: Fix, motion: Motion, model: _Model) -> "_Track":
        place = model.position(fix) ** 2
        gnss, imu = model.gnss, model.imu
        return cls(
            at=fix.measured_at,
            fixed_at=fix.measured_at,
            read_at=fix.measured_at,
            east=fix.east,
            north=fix.north,
            yaw=wrap_angle(fix.yaw),
            along=AlongCovariance(place, imu.speed_bias**2),
            across=AcrossCovariance(place, gnss.heading**2, imu.yaw_rate_bias**2),
            _model=model,
            _speed=motion.speed,
            _yaw_rate=motion.yaw_rate,
            _lateral_speed=model.slip.steady(motion.speed, motion.yaw_rate),
        )

    def copy(self) -> "_Track":
        return replace(self, along=replace(self.along), across=replace(self.across))

    def restarted(self, fix: Fix) -> "_Track":
        """Start another track at `fix`, keeping the sensor biases."""
        other = _Track.from_fix(fix, Motion(self._speed, self._yaw_rate), self._model)
        other._speed_bias, other._yaw_rate_bias = self._speed_bias, self._yaw_rate_bias
        other.along.ss, other.across.gg = self.along.ss, self.across.gg
        other.read_at = self.read_at
        return other

    def read(self, now: int, speed: float, yaw_rate: float) -> None:
        self.move(now, speed, yaw_rate)
        self.read_at = now

    def pose(self, now: int) -> Pose:
        speed = self._speed - self._speed_bias
        speed = speed if speed > 0.0 else 0.0
        yaw_rate = self._yaw_rate - self._yaw_rate_bias
        span = (now - self.at) / SECOND
        if span <= 0.0:
            return Pose(self.east, self.north, self.yaw, speed, yaw_rate)
        sideways = 0.5 * (
            self._lateral_speed
            + self._model.slip.after(span, speed, yaw_rate, yaw_rate, self._lateral_speed)
        )
        return Pose(*self._moved(span, speed, sideways, yaw_rate), speed, yaw_rate)

    def move(self, now: int, speed: float, yaw_rate: float) -> None:
        """Predict pose and covariance to a reading at `now` (ns)."""
        span = (now - self.at) / SECOND
        if span > 0.0:
            slip, drift = self._model.slip, self._model.drift
            forward = 0.5 * (self._speed + speed) - self._speed_bias
            forward = forward if forward > 0.0 else 0.0
            first, last = self._yaw_rate - self._yaw_rate_bias, yaw_rate - self._yaw_rate_bias
            turning = 0.5 * (first + last)
            before = self._lateral_speed
            self._lateral_speed = slip.after(span, forward, first, last, before)
            sideways = 0.5 * (before + self._lateral_speed)
            self.east, self.north, self.yaw = self._moved(span, forward, sideways, turning)
            self.along.grow(span, drift.along)
            across = drift.across(forward, turning)
            lever = slip.steady(forward, 1.0)
            self.across.grow(span, forward * span, lever, across, drift.heading)
            self.at = now
        self._speed, self._yaw_rate = speed, yaw_rate

    def _moved(
        self, span: float, speed: float, sideways: float, yaw_rate: float
    ) -> tuple[float, float, float]:
        """East, north, yaw after `span` (s) at constant speeds and yaw rate, exactly."""
        half = 0.5 * yaw_rate * span
        # At a constant yaw rate the displacement is the chord, turned by half the change of yaw.
        chord = span * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
        cos, sin = math.cos(self.yaw + half), math.sin(self.yaw + half)
        return (
            self.east + chord * (speed * cos - sideways * sin),
            self.north + chord * (speed * sin + sideways * cos),
            wrap_angle(self.yaw + 2.0 * half),
        )

    def correct(self, fix: Fix) -> bool:
        """Correct by `fix`, which is not older; returns False, uncorrected, for an outlier."""
        since = (fix.measured_at - self.fixed_at) / SECOND
        self.move(fix.measured_at, self._speed, self._yaw_rate)
        east, north = fix.east - self.east, fix.north - self.north
        turned = wrap_angle(fix.yaw - self.yaw)
        variance = self._model.position(fix) ** 2
        if not self._is_plausible(math.hypot(east, north), turned, since, variance):
            return False
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        along = self._correct_along(east * cos + north * sin, fix, variance)
        across = self._correct_across(north * cos - east * sin, turned, fix, variance)
        self.east += along * cos - across * sin
        self.north += along * sin + across * cos
        self.fixed_at = fix.measured_at
        self.fixes += 1
        return True

    def _is_plausible(self, away: float, turned: float, since: float, variance: float) -> bool:
        """Whether a fix of this position variance (m²) may be `away` (m) and `turned` (rad)."""
        position = self.along.aa + self.across.cc + 2.0 * variance
        heading = self.across.hh + self._model.heading
        reach = JUMP_DISTANCE + JUMP_GROWTH * since + GATE * math.sqrt(position)
        turn = JUMP_HEADING + JUMP_TURNING * since + GATE * math.sqrt(heading)
        return away <= reach and abs(turned) <= turn

    def _correct_along(self, innovation: float, fix: Fix, variance: float) -> float:
        """Correct the speed bias; returns the correction (m) of the position along the body."""
        position, bias = self.along.by_position(innovation, variance)
        self._speed_bias += bias
        age = (self.at - self.read_at) / SECOND
        residual = self._speed - fix.speed - self._speed_bias
        variance = self._model.speed + (ACCELERATION * age) ** 2
        if residual * residual <= GATE**2 * (variance + self.along.ss):
            more, bias = self.along.by_bias(residual, variance)
            self._speed_bias += bias
            position += more
        return position

    def _correct_across(self, innovation: float, turned: float, fix: Fix, variance: float) -> float:
        """Correct yaw and gyroscope bias; returns the correction (m) across the body."""
        position, heading, bias = self.across.by_position(innovation, variance)
        more = self.across.by_heading(turned - heading, self._model.heading)
        position, heading, bias = position + more[0], heading + more[1], bias + more[2]
        age = (self.at - self.read_at) / SECOND
        residual = self._yaw_rate - fix.yaw_rate - self._yaw_rate_bias - bias
        variance = self._model.yaw_rate + (YAW_ACCELERATION * age) ** 2
        if residual * residual <= GATE**2 * (variance + self.across.gg):
            more = self.across.by_bias(residual, variance)
            position, heading, bias = position + more[0], heading + more[1], bias + more[2]
        self.yaw = wrap_angle(self.yaw + heading)
        self._yaw_rate_bias += bias
        return position
