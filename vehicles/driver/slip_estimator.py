"""The load of the car, estimated from its response to steering.

The understeer gradient K_sg of eq. (6) and the steady slip l = b - m a v²/(L C_r) both change with
the load, which the paper's controller does not know (Section V-B). One number describes both: the
ratio of true to assumed mass or, equivalently, of assumed to true stiffness.

Two linear models of the car (eqs. (1), (2), (4)), one with assumed parameters and one laden, follow
the same commands. Interpolating the measured yaw rate between theirs gives the ratio; on straights
it is undetermined, and the gyroscope bias is estimated instead. Ratio and bias are the states of a
Kalman filter with one measurement (R. E. Kalman, "A new approach to linear filtering and prediction
problems", Journal of Basic Engineering 82, 1960), so no steady state is needed. Tyres near their
limit respond as if the car were heavier, and need the same steering.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

from vehicles.car.dynamics import Body, actuator
from vehicles.car.imu import Motion
from vehicles.car.parameters import VehicleParameters
from vehicles.car.tyres import lateral_coefficients
from vehicles.schedule import SECOND

LADEN = 1.3  # Mass ratio of the second model; a full car of Section V-B has 1.25
INERTIA_PER_MASS = 1.5  # Relative growth of the yaw inertia (Section V-B: 1.4 to 1.6)
PRIOR = 0.3  # Initial standard deviation of the ratio
DRIFT = 0.003  # Random walk of the ratio, per square root of a second
BIAS_PRIOR, BIAS_DRIFT = 0.002, 5e-5  # Bias of the yaw rate (rad/s, and per √s)
MIN_NOISE = 2e-4  # Noise (rad/s) of exact measurements, as models are approximate
DELAY = 0.01  # Unmodelled delay (s); the change of the yaw rate within it counts as noise
LINEAR_LIMIT = 4.0  # Lateral acceleration (m/s²) above which tyres are not linear
MIN_RATIO, MAX_RATIO = 0.7, 1.6
UPDATE_THRESHOLD = 0.002  # Change of the ratio that is passed on to controllers and filters
STEP = 0.0025  # Step (s) of the models by Euler's method
MIN_LEARNING_SPEED = 8.0
"""Below it (m/s) K_sg v² is less than 1 % of the wheelbase; the models stay at it."""


def with_load(p: VehicleParameters, ratio: float) -> VehicleParameters:
    """Scale mass and yaw inertia by a load with the mass `ratio` (Section V-B)."""
    inertia = p.yaw_inertia * (1.0 + INERTIA_PER_MASS * (ratio - 1.0))
    return replace(p, mass=p.mass * ratio, yaw_inertia=inertia)


class SlipEstimator:
    """Estimates the load, and thus K_sg of eq. (6) and the slip, from yaw rate and commands.

    `ratio` is the estimated mass over the assumed one, `variance` its variance.
    """

    def __init__(self, parameters: VehicleParameters, yaw_rate_noise: float) -> None:
        """`parameters` are the assumed ones, `yaw_rate_noise` (rad/s) is that of measurements."""
        self._assumed = parameters
        self._noise = max(yaw_rate_noise, MIN_NOISE)
        cars = parameters, with_load(parameters, LADEN)
        self._coefficients = [lateral_coefficients(car) for car in cars]
        self._motions = [(0.0, 0.0), (0.0, 0.0)]  # lateral speed (m/s), yaw rate (rad/s)
        self._actuator = actuator(parameters)
        self._steering = self._steering_rate = 0.0
        self._bias = self._turning = 0.0
        self.variance, self._bias_variance, self._covariance = PRIOR**2, BIAS_PRIOR**2, 0.0
        self.ratio = 1.0

    @property
    def parameters(self) -> VehicleParameters:
        return with_load(self._assumed, self.ratio)

    def move(self, span: float, speed: float, command: float) -> None:
        """Predict by `span` (s) at `speed` (m/s) with a held command (rad): eqs. (1), (2), (4)."""
        if span <= 0.0:
            return
        parts, before = math.ceil(span / STEP - 1e-9), self._motions[0][1]
        (square, damping), limit = self._actuator, self._assumed.steering_rate_limit
        h, v, motions = span / parts, max(speed, MIN_LEARNING_SPEED), self._motions
        for _ in range(parts):
            for k, (a, b, c, d, e, f) in enumerate(self._coefficients):
                y, r = motions[k]
                sideways = (a * y + b * r) / v - v * r + c * self._steering
                motions[k] = y + h * sideways, r + h * ((d * y + e * r) / v + f * self._steering)
            push = square * (command - self._steering) - damping * self._steering_rate
            self._steering_rate = min(max(self._steering_rate + h * push, -limit), limit)
            self._steering += h * self._steering_rate
        self._turning = (motions[0][1] - before) / span
        self.variance += DRIFT * DRIFT * span
        self._bias_variance += BIAS_DRIFT * BIAS_DRIFT * span

    def correct(self, yaw_rate: float, speed: float) -> None:
        """Correct by a measured yaw rate (rad/s) at a speed (m/s)."""
        (_, empty), (_, laden) = self._motions
        if speed < MIN_LEARNING_SPEED or abs(yaw_rate) * speed > LINEAR_LIMIT:
            return
        gain = (laden - empty) / (LADEN - 1.0)
        late = DELAY * self._turning
        p, q, c = self.variance, self._bias_variance, self._covariance
        with_ratio, with_bias = gain * p + c, gain * c + q
        total = gain * with_ratio + with_bias + self._noise * self._noise + late * late
        innovation = yaw_rate - empty - (self.ratio - 1.0) * gain - self._bias
        to_ratio, to_bias = with_ratio / total, with_bias / total
        self.ratio = min(max(self.ratio + to_ratio * innovation, MIN_RATIO), MAX_RATIO)
        self._bias += to_bias * innovation
        self.variance = p - to_ratio * with_ratio
        self._bias_variance = q - to_bias * with_bias
        self._covariance = c - to_ratio * with_bias


@runtime_checkable
class ParameterUser(Protocol):
    """Uses assumed parameters of the car, which may be replaced (Section V-B)."""

    def assume(self, parameters: VehicleParameters) -> None: ...


@dataclass(eq=False)
class LoadWatch:
    """Keeps the parameters assumed by controllers and filters up to date, given an estimator."""

    estimator: SlipEstimator | None = None
    users: Sequence[ParameterUser] = ()
    _ratio: float = 1.0
    _command: float = 0.0
    _speed: float = 0.0
    _at: int | None = None

    def observe(self, now: int, motion: Motion | Body | None) -> None:
        """Predict to `now` (ns), and correct by a reading; call at every step before deciding."""
        if self.estimator is None:
            return
        if self._at is not None:
            self.estimator.move((now - self._at) / SECOND, self._speed, self._command)
        self._at = now
        if motion is None or not math.isfinite(motion.yaw_rate + motion.speed):
            return
        self._speed = motion.speed
        self.estimator.correct(motion.yaw_rate, motion.speed)
        if abs(self.estimator.ratio - self._ratio) > UPDATE_THRESHOLD:
            self._ratio = self.estimator.ratio
            parameters = self.estimator.parameters
            for user in self.users:
                user.assume(parameters)

    def record_command(self, steering: float) -> None:
        """Set the steering command (rad), δ_c of eq. (4), that holds from now on."""
        self._command = steering
