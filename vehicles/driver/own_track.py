"""One estimate of the own pose, and its covariance.

While fixes arrive and their errors are white, two small covariances with explicit formulas suffice
(`covariance`). From the first outage on, or the first fix whose errors last, as the receiver states
them, all errors are estimated jointly (`joint_covariance`).
"""

import math
from dataclasses import dataclass, field, replace
from typing import Final

from vehicles.car.gnss import Fix
from vehicles.car.gnss_errors import StatedErrors
from vehicles.car.imu import DriftModel, InertialNoise, Motion, SlipModel
from vehicles.car.noise import GnssNoise
from vehicles.driver.joint_covariance import GYRO_BIAS, HEADING, SPEED_BIAS, JointCovariance, Step
from vehicles.driver.own_state import AcrossCovariance, AlongCovariance, Pose
from vehicles.geometry.geodesy import wrap_angle
from vehicles.schedule import SECOND

GATE: Final = 6.0  # Innovations beyond this number of standard deviations are outliers

JUMP_DISTANCE: Final = 0.5
JUMP_GROWTH: Final = 3.0
"""Largest distance of a sliding car from dead reckoning (m, and m/s times the age of the last fix).
"""

JUMP_HEADING: Final = 0.1
JUMP_TURNING: Final = 0.5  # The same for its heading (rad, rad/s)

OUTAGE: Final = SECOND
OUTAGE_FIXES: Final = 3  # Without fixes for this long (ns, fixes) dead reckoning is on its own

ACCELERATION: Final = 3.0
YAW_ACCELERATION: Final = 1.0  # Assumed rates (m/s², rad/s²) since the last reading


@dataclass(slots=True)
class TrackModel:
    """Models of the car's slip, of the drift of dead reckoning, and of the sensor noise."""

    slip: SlipModel
    drift: DriftModel
    gnss: GnssNoise
    imu: InertialNoise
    by_accuracy: bool
    stated: StatedErrors | None = None
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
class OwnTrack:
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
    _model: TrackModel
    _speed: float
    _yaw_rate: float
    _lateral_speed: float
    _speed_bias: float = 0.0
    _yaw_rate_bias: float = 0.0
    _joint: JointCovariance | None = None

    @classmethod
    def from_known(cls, fix: Fix, motion: Motion, model: TrackModel) -> "OwnTrack":
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

    @classmethod
    def from_fix(cls, fix: Fix, motion: Motion, model: TrackModel) -> "OwnTrack":
        track, stated = cls.from_known(fix, motion, model), model.stated
        if stated is not None and not stated.is_white(fix.state):
            biases = model.imu.speed_bias, model.imu.yaw_rate_bias
            deviations = model.gnss.heading, *biases
            track._joint = JointCovariance.at_fix(stated, fix.state, fix.measured_at, deviations)
        return track

    def copy(self) -> "OwnTrack":
        joint = None if self._joint is None else self._joint.copy()
        return replace(self, along=replace(self.along), across=replace(self.across), _joint=joint)

    def restarted(self, fix: Fix) -> "OwnTrack":
        """Start another track at `fix`, keeping the sensor biases."""
        other = OwnTrack.from_fix(fix, Motion(self._speed, self._yaw_rate), self._model)
        other._speed_bias, other._yaw_rate_bias = self._speed_bias, self._yaw_rate_bias
        other.along.ss, other.across.gg = self.along.ss, self.across.gg
        if self._joint is not None and other._joint is not None:
            other._joint.adopt_biases(self._joint)
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
            east, north, yaw = self.east, self.north, self.yaw
            self.east, self.north, self.yaw = self._moved(span, forward, sideways, turning)
            lever = slip.steady(forward, 1.0)
            if self._joint is None and now - self.fixed_at > OUTAGE:
                self._begin_outage()
            if self._joint is None:
                self.along.grow(span, drift.along)
                across = drift.across(forward, turning)
                self.across.grow(span, forward * span, lever, across, drift.heading)
            else:
                step = Step(
                    span,
                    self.east - east,
                    self.north - north,
                    yaw,
                    lever,
                    span * slip.load_effect(forward, turning),
                    drift.along,
                    drift.across(forward, 0.0),  # the load is one of the states
                    drift.heading,
                )
                self._joint.grow(step)
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
        joint = self._joint_for(fix)
        if joint is not None:
            return self._correct_jointly(joint, fix, since, (east, north, turned))
        variance = self._model.position(fix) ** 2
        position = self.along.aa + self.across.cc + 2.0 * variance
        heading = self.across.hh + self._model.heading
        if not _is_plausible(math.hypot(east, north), turned, since, position, heading):
            return False
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        along = self._correct_along(east * cos + north * sin, fix, variance)
        across = self._correct_across(north * cos - east * sin, turned, fix, variance)
        self.east += along * cos - across * sin
        self.north += along * sin + across * cos
        self.fixed_at = fix.measured_at
        self.fixes += 1
        return True

    def _begin_outage(self) -> None:
        """Estimate jointly while fixes are missing: errors across the body turn with the car."""
        stated = self._model.stated
        if stated is not None and self.at - self.fixed_at > OUTAGE_FIXES * stated.period:
            self._joint = JointCovariance.joined(stated, self.along, self.across, self.yaw)

    def _joint_for(self, fix: Fix) -> JointCovariance | None:
        """The joint covariance, from the first fix on whose errors last."""
        if self._joint is None:
            stated = self._model.stated
            if stated is None or stated.is_white(fix.state):
                return None
            self._joint = JointCovariance.joined(stated, self.along, self.across, self.yaw)
        self._joint.enter(fix.state, fix.measured_at)
        return self._joint

    def _correct_jointly(
        self, joint: JointCovariance, fix: Fix, since: float, off: tuple[float, float, float]
    ) -> bool:
        """Correct by a fix that is `off` the estimate in east, north (m) and heading (rad)."""
        east, north, turned = off
        away = math.hypot(*joint.without_errors(east, north, fix.state))
        position = joint.position_variance(fix.state)
        heading = joint.variance(HEADING) + self._model.heading
        if not _is_plausible(away, turned, since, position, heading):
            return False
        joint.by_position(east, north, fix.state)
        joint.by_state(HEADING, turned, self._model.heading)
        age = (self.at - self.read_at) / SECOND
        speed = self._speed - fix.speed - self._speed_bias
        variance = self._model.speed + (ACCELERATION * age) ** 2
        joint.by_state(SPEED_BIAS, speed, variance, GATE)
        yaw_rate = self._yaw_rate - fix.yaw_rate - self._yaw_rate_bias
        variance = self._model.yaw_rate + (YAW_ACCELERATION * age) ** 2
        joint.by_state(GYRO_BIAS, yaw_rate, variance, GATE)
        east, north, turned, speed_bias, yaw_rate_bias, _ = joint.taken()
        self.east += east
        self.north += north
        self.yaw = wrap_angle(self.yaw + turned)
        self._speed_bias += speed_bias
        self._yaw_rate_bias += yaw_rate_bias
        self.fixed_at = fix.measured_at
        self.fixes += 1
        return True

    @property
    def deviations(self) -> tuple[float, float, float]:
        """Standard deviations along (m), across (m) and in heading (rad)."""
        if self._joint is not None:
            return self._joint.deviations(self.yaw)
        along, across = self.along, self.across
        return math.sqrt(along.aa), math.sqrt(across.cc), math.sqrt(across.hh)

    @property
    def lateral_deviation(self) -> float:
        if self._joint is not None:
            return self._joint.deviations(self.yaw)[1]
        return math.sqrt(self.across.cc)

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


def _is_plausible(
    away: float, turned: float, since: float, position: float, heading: float
) -> bool:
    """Whether a fix may be `away` (m) and `turned` (rad), `since` (s) after the last one.

    `position` (m²) and `heading` (rad²) are the variances of both.
    """
    reach = JUMP_DISTANCE + JUMP_GROWTH * since + GATE * math.sqrt(position)
    turn = JUMP_HEADING + JUMP_TURNING * since + GATE * math.sqrt(heading)
    return away <= reach and abs(turned) <= turn
