"""The inertial sensor of the car: gyroscope and wheel speed. Its readings are not broadcast."""

import math
from dataclasses import dataclass, fields
from typing import Final

from numpy.random import PCG64, Generator

from vehicles.car.dynamics import Body
from vehicles.schedule import Cadence

BLOCK: Final = 64  # Readings whose noise is drawn at once; changes no number


@dataclass(slots=True)
class Motion:
    """One reading: speed along the body (m/s, never negative) and yaw rate (rad/s) of eq. (1)."""

    speed: float
    yaw_rate: float


@dataclass(frozen=True, slots=True)
class InertialNoise:
    """Standard deviations of the errors of speed (m/s) and yaw rate (rad/s).

    Each reading has white Gaussian noise. Biases are constant over a run and drawn once per
    vehicle. Gyroscope: 0.1 deg/s of noise, which is 0.01 deg/s/sqrt(Hz) over 100 Hz (data sheets
    of automotive MEMS gyroscopes such as ST's ASM330LHH state half that density), and 0.1 deg/s of
    bias, the rest of the zero-rate offset after averaging at a standstill. Wheel speed: 0.03 m/s of
    noise, as of the receiver, and a bias of 0.1 m/s, which is 0.5 % of the tyre's radius at 20 m/s.
    """

    speed: float = 0.03
    yaw_rate: float = 0.00175
    speed_bias: float = 0.1
    yaw_rate_bias: float = 0.00175

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{field.name} noise must be at least 0, not {value}")


_State = tuple[Generator, Motion, list[float]]


class InertialSensor:
    """Inertial unit of Section V-D, measuring every 1/`rate_hz` s from `start_at` (ns) on.

    `random` belongs to this sensor: it draws two normal numbers for the biases, then two per
    reading, in order of time.
    """

    def __init__(
        self, noise: InertialNoise, rate_hz: float, start_at: int, random: Generator
    ) -> None:
        if not (math.isfinite(rate_hz) and rate_hz > 0.0):
            raise ValueError(f"the measuring rate must be positive, not {rate_hz} Hz")
        self._noise = noise
        self._cadence = Cadence(start_at, rate_hz)
        self._random = random
        speed, yaw_rate = random.standard_normal(2).tolist()
        self._bias = Motion(noise.speed_bias * speed, noise.yaw_rate_bias * yaw_rate)
        self._drawn: list[float] = []

    def __reduce__(self) -> "tuple[type[InertialSensor], tuple[object, ...], _State]":
        # The constructor draws numbers, so it must not get the pickled stream.
        arguments = self._noise, self._cadence.rate_hz, self._cadence.start_at, Generator(PCG64(0))
        return InertialSensor, arguments, (self._random, self._bias, self._drawn)

    def __setstate__(self, state: "_State") -> None:
        self._random, self._bias, self._drawn = state

    def measure(self, body: Body, now: int) -> Motion | None:
        """Measure `body` if `now` (ns) is an instant of measurement, else None.

        v_x and dθ/dt of eq. (1), plus constant bias and white Gaussian noise.
        """
        if self._cadence.index(now) is None:
            return None
        if not self._drawn:
            self._drawn = self._random.standard_normal(2 * BLOCK).tolist()
            self._drawn.reverse()
        noise, bias, draw = self._noise, self._bias, self._drawn.pop
        speed = body.speed + bias.speed + noise.speed * draw()
        yaw_rate = body.yaw_rate + bias.yaw_rate + noise.yaw_rate * draw()
        return Motion(speed if speed > 0.0 else 0.0, yaw_rate)


class ExactSensor:
    """Measures the true state of the car at every instant, as in Section V-C."""

    def measure(self, body: Body, now: int) -> Body:
        return body
