"""How heavily the car is laden, learned on the way from how it answers its steering.

The understeer gradient K_sg of eq. (6) and the steady slip l = b - m a v²/(L C_r) both change with
the load, which the paper's controller does not know (Section V-B). One number holds both: the ratio
of the true mass to the assumed one, or, which comes to the same, of assumed to true stiffness.

Beside the car run two linear models of it (eqs. (1), (2), (4)), one as it is assumed and one laden,
fed with the same commands. How far the measured yaw rate lies from the one towards the other is the
ratio; on straights it says nothing, and there the gyroscope's bias is learned. Ratio and bias are
the states of a Kalman filter (R. E. Kalman, "A new approach to linear filtering and prediction
problems", Journal of Basic Engineering 82, 1960) with one measurement, so no steady state is waited
for, and the uncertainty is told. Tyres near their limit answer as if the car were heavier, and need
what a heavier car does.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

from vehicles.car.dynamics import Body
from vehicles.car.imu import Motion
from vehicles.car.integration import actuator
from vehicles.car.parameters import VehicleParameters
from vehicles.car.tyres import lateral_coefficients
from vehicles.schedule import SECOND

LADEN = 1.3
"""Mass of the second model, as a ratio; a full car of Section V-B has 1.25."""
INERTIA_PER_MASS = 1.5
"""By how much faster than the mass the yaw inertia grows with a load (Section V-B: 1.4 to 1.6)."""
PRIOR = 0.3
"""Standard deviation of the ratio before anything is known."""
DRIFT = 0.003
"""By how much the ratio may wander, per square root of a second: passengers stay seated."""
BIAS_PRIOR, BIAS_DRIFT = 0.002, 5e-5
"""Bias of the yaw rate (rad/s) and its wander per square root of a second."""
LEAST_NOISE = 2e-4
"""Noise (rad/s) that even exact measurements are taken to have: the models are approximations."""
DELAY = 0.01
"""Unmodelled delay (s), by which a change of the yaw rate counts as noise."""
LINEAR_UP_TO = 4.0
"""Lateral acceleration (m/s²) beyond which tyres are not linear and nothing is learned."""
LIGHTEST, HEAVIEST = 0.7, 1.6
NEWS = 0.002
"""Change of the ratio that is passed on."""
LONGEST_STEP = 0.01
"""Longest step (s) of the models: at 20 ms the trapezoidal rule alone is worth 5 % of load."""
SLOWEST = 3.0
"""Speed (m/s) below which the models are the kinematic one."""
LEARNS_FROM = 8.0
"""Speed (m/s) from which a load shows: below, K_sg v² is less than a hundredth of the wheelbase."""


def with_load(p: VehicleParameters, ratio: float) -> VehicleParameters:
    """Scale the mass by `ratio`, and the yaw inertia as a load does (Section V-B)."""
    inertia = p.yaw_inertia * (1.0 + INERTIA_PER_MASS * (ratio - 1.0))
    return replace(p, mass=p.mass * ratio, yaw_inertia=inertia)


class _Answer:
    """Lateral speed (m/s) and yaw rate (rad/s) by eqs. (1), (2), by the trapezoidal rule."""

    def __init__(self, p: VehicleParameters) -> None:
        self._a, self._b, self._c, self._d, self._e, self._f = lateral_coefficients(p)
        self.lateral_speed = self.yaw_rate = 0.0

    def move(self, h: float, v: float, steering: float) -> None:
        """Move on by h (s) at speed v (m/s) with the mean steering angle (rad) of the step."""
        half = 0.5 * h
        a, b, d, e = (
            half * self._a / v, half * (self._b / v - v), half * self._d / v, half * self._e / v
        )  # fmt: skip
        y, r = self.lateral_speed, self.yaw_rate
        right_y = y + a * y + b * r + h * self._c * steering
        right_r = r + d * y + e * r + h * self._f * steering
        determinant = (1.0 - a) * (1.0 - e) - b * d
        self.lateral_speed = ((1.0 - e) * right_y + b * right_r) / determinant
        self.yaw_rate = ((1.0 - a) * right_r + d * right_y) / determinant


class SlipEstimator:
    """Learns the load, and with it K_sg of eq. (6) and the steady slip, from yaw rate and commands.

    `ratio` is the true mass over the assumed one as far as known, `deviation` its standard
    deviation.
    """

    def __init__(self, parameters: VehicleParameters, yaw_rate_noise: float) -> None:
        """`parameters` are those assumed; the noise (rad/s) is that of the measured yaw rate."""
        self._assumed = parameters
        self._noise = max(yaw_rate_noise, LEAST_NOISE)
        self._models = (_Answer(parameters), _Answer(with_load(parameters, LADEN)))
        self._steering = self._steering_rate = 0.0
        self.ratio = 1.0
        self._bias = 0.0
        self._variance, self._bias_variance, self._covariance = PRIOR**2, BIAS_PRIOR**2, 0.0
        self._turning = 0.0

    @property
    def deviation(self) -> float:
        """Standard deviation of the ratio, by the filter of Kalman, 1960."""
        return math.sqrt(self._variance)

    @property
    def parameters(self) -> VehicleParameters:
        """The car as it is estimated, after Section V-B."""
        return with_load(self._assumed, self.ratio)

    def move(self, span: float, speed: float, command: float) -> None:
        """Go on by `span` (s) at `speed` (m/s) with a command (rad) held, by eqs. (1), (2), (4)."""
        if span <= 0.0:
            return
        parts = math.ceil(span / LONGEST_STEP - 1e-9)
        for _ in range(parts):
            self._move(span / parts, speed, command)
        self._variance += DRIFT * DRIFT * span
        self._bias_variance += BIAS_DRIFT * BIAS_DRIFT * span

    def _move(self, span: float, speed: float, command: float) -> None:
        mean = self._steer(span, command)
        before = self._models[0].yaw_rate
        for model in self._models:
            if speed > SLOWEST:
                model.move(span, speed, mean)
            else:
                model.yaw_rate = speed * mean / self._assumed.wheelbase
                model.lateral_speed = self._assumed.rear_axle_distance * model.yaw_rate
        self._turning = (self._models[0].yaw_rate - before) / span

    def _steer(self, span: float, command: float) -> float:
        """Move the wheels by eq. (4), by the trapezoidal rule; returns their mean angle (rad)."""
        car, half = self._assumed, 0.5 * span
        square, damping = actuator(car)
        angle, rate = self._steering, self._steering_rate
        push = rate + half * (square * (2.0 * command - 2.0 * angle - half * rate) - damping * rate)
        after = push / (1.0 + half * (damping + half * square))
        most = car.steering_rate_limit
        self._steering_rate = min(max(after, -most), most)
        self._steering = angle + half * (rate + self._steering_rate)
        return 0.5 * (angle + self._steering)

    def correct(self, yaw_rate: float, speed: float) -> None:
        """Take a yaw rate (rad/s) measured now at a speed (m/s): Kalman, 1960."""
        empty, laden = self._models[0].yaw_rate, self._models[1].yaw_rate
        if speed < LEARNS_FROM or abs(yaw_rate) * speed > LINEAR_UP_TO:
            return
        gain = (laden - empty) / (LADEN - 1.0)
        late = DELAY * self._turning
        p, q, c = self._variance, self._bias_variance, self._covariance
        with_ratio, with_bias = gain * p + c, gain * c + q
        total = gain * with_ratio + with_bias + self._noise * self._noise + late * late
        off = yaw_rate - empty - (self.ratio - 1.0) * gain - self._bias
        to_ratio, to_bias = with_ratio / total, with_bias / total
        self.ratio = min(max(self.ratio + to_ratio * off, LIGHTEST), HEAVIEST)
        self._bias += to_bias * off
        self._variance = p - to_ratio * with_ratio
        self._bias_variance = q - to_bias * with_bias
        self._covariance = c - to_ratio * with_bias


@runtime_checkable
class Assuming(Protocol):
    """What works with parameters of the car that it does not know for sure (Section V-B)."""

    def assume(self, parameters: VehicleParameters) -> None:
        """Go on with other parameters; Section V-B."""
        ...


class LoadWatch:
    """Keeps a driver's idea of its car (Section V-B) up to date, if it has an estimator of it."""

    def __init__(
        self, estimator: SlipEstimator | None = None, told: Sequence[Assuming] = ()
    ) -> None:
        """`told` are those who are to work with the car as it is estimated."""
        self._estimator = estimator
        self._told = told
        self._ratio = 1.0
        self._command = self._speed = 0.0
        self._at: int | None = None

    def observe(self, now: int, motion: Motion | Body | None) -> None:
        """Go on to `now` (ns), and learn from the reading made then, if there is one; Section V-B.

        To be called at every step, before anything is decided.
        """
        if self._estimator is None:
            return
        if self._at is not None:
            self._estimator.move((now - self._at) / SECOND, self._speed, self._command)
        self._at = now
        if motion is None or not math.isfinite(motion.yaw_rate + motion.speed):
            return
        self._speed = motion.speed
        self._estimator.correct(motion.yaw_rate, motion.speed)
        if abs(self._estimator.ratio - self._ratio) > NEWS:
            self._ratio = self._estimator.ratio
            parameters = self._estimator.parameters
            for one in self._told:
                one.assume(parameters)

    def commanded(self, steering: float) -> None:
        """Take the steering command (rad) that holds from now on, δ_c of eq. (4)."""
        self._command = steering
