"""The inertial sensor of the car: gyroscope and wheel speed. Its readings are not broadcast."""

import math
from dataclasses import dataclass
from typing import Annotated, Final

from numpy.random import Generator

from vehicles.car.dynamics import Body
from vehicles.car.parameters import VehicleParameters
from vehicles.schedule import Cadence
from vehicles.setting import Setting

BLOCK: Final = 64  # Readings whose noise is drawn at once; changes no number


@dataclass(slots=True)
class Motion:
    """One reading: speed along the body (m/s, never negative) and yaw rate (rad/s) of eq. (1)."""

    speed: float
    yaw_rate: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuSettings:
    """The emulated inertial sensor of a vehicle: gyroscope and wheel speed.

    All values are standard deviations. Each reading has white Gaussian noise. Biases are constant
    over a run and drawn once per vehicle. Gyroscope: 0.1 deg/s of noise, which is 0.01
    deg/s/sqrt(Hz) over 100 Hz (data sheets of automotive MEMS gyroscopes such as ST's ASM330LHH
    state half that density), and 0.1 deg/s of bias, the rest of the zero-rate offset after
    averaging at a standstill. Wheel speed: 0.03 m/s of noise, as of the receiver, and a bias of 0.1
    m/s, which is 0.5 % of the tyre's radius at 20 m/s.
    """

    rate: Annotated[
        float | None, Setting("rate; default: control.rate_hz", "hz", 0.01, 1000, example=50.0)
    ] = None
    speed_noise: Annotated[float, Setting("white noise of the speed", "mps", 0, 10)] = 0.03
    speed_bias: Annotated[float, Setting("bias of the speed", "mps", 0, 10)] = 0.1
    yaw_rate_noise: Annotated[
        float, Setting("white noise of the yaw rate; the default equals 0.1 deg/s", "radps", 0, 1)
    ] = 0.00175
    yaw_rate_bias: Annotated[float, Setting("bias of the yaw rate", "radps", 0, 1)] = 0.00175


class InertialSensor:
    """Inertial unit of Section V-D, measuring every 1/`rate_hz` s from `start_at` (ns) on.

    `random` belongs to this sensor: it draws two normal numbers for the biases, then two per
    reading, in order of time.
    """

    def __init__(
        self, settings: ImuSettings, rate_hz: float, start_at: int, random: Generator
    ) -> None:
        self._settings = settings
        self._cadence = Cadence(start_at, rate_hz)
        self._random = random
        speed, yaw_rate = random.standard_normal(2).tolist()
        self._bias = Motion(settings.speed_bias * speed, settings.yaw_rate_bias * yaw_rate)
        self._drawn: list[float] = []

    def measure(self, body: Body, now: int) -> Motion | None:
        """Measure v_x and dθ/dt of eq. (1) at an instant `now` (ns) of measurement, else None."""
        if self._cadence.index(now) is None:
            return None
        if not self._drawn:
            self._drawn = self._random.standard_normal(2 * BLOCK).tolist()
            self._drawn.reverse()
        settings, bias, draw = self._settings, self._bias, self._drawn.pop
        speed = body.speed + bias.speed + settings.speed_noise * draw()
        yaw_rate = body.yaw_rate + bias.yaw_rate + settings.yaw_rate_noise * draw()
        return Motion(speed if speed > 0.0 else 0.0, yaw_rate)


class ExactSensor:
    """Measures the true state of the car at every instant, as in Section V-C."""

    def measure(self, body: Body, now: int) -> Body:
        return body


# ---- Dead reckoning with the inertial sensor, and the growth of its error
#
# The lateral speed follows from the yaw rate by the single-track model. The densities below are the
# process noise of a filter that corrects dead reckoning with fixes.


MIN_LAG: Final = 1e-3  # Lower bound (s) of the slip's time constant, for a car that hardly moves

UNKNOWN_LOAD: Final = 0.25
"""Error of the assumed load, as a share of the car's mass: four passengers with luggage are 480 kg
on 1896 kg (Section V-B). It scales the mass-dependent part of the steady slip."""

SLIP_ERROR_TIME: Final = 0.5
"""Correlation time (s) of the slip's error: half of the second that the paper assumes between two
changes of curvature (Section III-A)."""

SIDE_DRIFT: Final = 0.003  # Lateral speed (m/s) from causes outside the model: camber, wind
YAW_JERK: Final = 5.0  # Rate of yaw acceleration (rad/s³): emergency lane change at 30 m/s
JERK: Final = 10.0  # Rate of change of acceleration (m/s³): the onset of hard braking


class SlipModel:
    """Lateral speed (m/s) of the centre of mass from the yaw rate r, by eqs. (1), (2).

    Elimination of the front axle's force gives v_y' = (l r - v_y) / tau + (I / m a) r', with the
    steady slip l = b - s v² of `VehicleParameters.steady_slip_per_curvature`, tau = s v and
    s = m a / (L C_r). So the measured yaw rate also determines the slip in transients, given mass
    and tyres.
    """

    def __init__(self, parameters: VehicleParameters) -> None:
        p = parameters
        moment = p.mass * p.front_axle_distance
        self._rear = p.rear_axle_distance
        self._sag = moment / (p.wheelbase * p.rear_cornering_stiffness)
        self._kick = p.yaw_inertia / moment

    def steady(self, speed: float, yaw_rate: float) -> float:
        """Lateral speed (m/s) in steady cornering, eqs. (1), (2)."""
        return (self._rear - self._sag * speed * speed) * yaw_rate

    def after(
        self, span: float, speed: float, before: float, now: float, lateral_speed: float
    ) -> float:
        """Lateral speed after `span` (s > 0) with a linear yaw rate from `before` to `now`."""
        steady = self._rear - self._sag * speed * speed
        lag = self._sag * speed
        if lag < MIN_LAG:
            lag = MIN_LAG
        kept = math.exp(-span / lag)
        ramp = (self._kick - steady) * (now - before) * (lag * (1.0 - kept) / span)
        return kept * lateral_speed + steady * (now - kept * before) + ramp

    def load_effect(self, speed: float, yaw_rate: float) -> float:
        """Lateral speed (m/s) in steady cornering per relative error of the assumed load."""
        return -self._sag * speed * speed * yaw_rate

    def error(self, speed: float, yaw_rate: float) -> float:
        """Standard deviation (m/s) of the lateral speed, from unknown load and `SIDE_DRIFT`."""
        return UNKNOWN_LOAD * self._sag * speed * speed * abs(yaw_rate) + SIDE_DRIFT


class DriftModel:
    """Process noise of dead reckoning, without biases.

    Densities of random walks (variance per time): `along` and `across` the body (m²/s), `heading`
    (rad²/s). White noise of standard deviation s, constant over each T, has the density s² T.
    """

    def __init__(self, slip: SlipModel, settings: ImuSettings, rate_hz: float) -> None:
        self._slip = slip
        period = 1.0 / rate_hz
        between = period * period / 12.0  # error of linear interpolation between two readings
        self.along = period * (settings.speed_noise**2 + (JERK * between) ** 2)
        self.heading = period * (settings.yaw_rate_noise**2 + (YAW_JERK * between) ** 2)

    def across(self, speed: float, yaw_rate: float) -> float:
        """Density across the body (m²/s), 2 s² t of the slip's error s with correlation time t."""
        return 2.0 * SLIP_ERROR_TIME * self._slip.error(speed, yaw_rate) ** 2
