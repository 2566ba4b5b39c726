"""On-board sensor of the gap to the predecessor and of its rate, such as a radar; SI units."""

import cmath
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

from numpy.random import Generator

from vehicles.car.dynamics import Body
from vehicles.car.parameters import VehicleParameters
from vehicles.messages import TruePose
from vehicles.schedule import MILLISECOND, SECOND, Cadence, Timer
from vehicles.setting import Setting

MISSED = 2  # Number of periods after which a measurement is no longer used: one may be missing
OLDEST_POSE = SECOND // 10  # Age (ns) up to which a true pose is predicted


@dataclass(frozen=True, slots=True, kw_only=True)
class GapSensorSettings:
    """An on-board sensor of the gap to the predecessor and of its rate, such as a radar.

    It measures the straight line between the bumpers, from the middle of the own front bumper to
    the middle of the predecessor's rear bumper, and the rate of its length. It recognises the
    predecessor without fail, and loses it beyond its range and angle of view. The controllers that
    use it ("acc", and "cacc", "ploeg", "flatbed" and "consensus" without data of the predecessor)
    take the newest measurement, predicted to the present by its rate, for up to the latency and two
    periods. With the reaction "degrade" it also replaces the poses of the predecessor from 2.5
    periods without a message on; without a known path the car still stops. 20 Hz is the usual rate
    of radars in openpilot. The latency must exceed that of the transport.
    """

    reach: Annotated[float, Setting("longest gap; 0: no sensor", "m", 0, 1000, name="range")] = 0.0
    rate: Annotated[
        float, Setting("rate, at instants of control; up to control.rate_hz", "hz", 0.1, 500)
    ] = 20.0
    latency: Annotated[int, Setting("time until it is available", "ms", 5, 1000)] = 50 * MILLISECOND
    field_of_view: Annotated[float, Setting("angle of view", "deg", 1, 180)] = math.radians(90.0)
    gap_noise: Annotated[float, Setting("white noise of the gap", "m", 0, 100)] = 0.1
    gap_rate_noise: Annotated[float, Setting("white noise of its rate", "mps", 0, 100)] = 0.1


@dataclass(frozen=True, slots=True)
class GapMeasurement:
    """Gap (m) and its rate (m/s) at `measured_at` (ns), of use until `valid_until` (ns).

    NaN without a predecessor in view.
    """

    measured_at: int
    valid_until: int
    gap: float = math.nan
    rate: float = math.nan

    def at(self, now: int) -> tuple[float, float]:
        """Gap (m) predicted to `now` (ns) by its rate, and the rate (m/s).

        NaN once it is too old.
        """
        if now > self.valid_until:
            return math.nan, math.nan
        return self.gap + self.rate * ((now - self.measured_at) / SECOND), self.rate


TargetAt = Callable[[int], TruePose | None]  # Newest true pose by an instant (ns)


class GapSensor:
    """Sensor that measures every 1/`rate` s, at the next instant of control.

    True poses of both cars exist at these instants only. `random` belongs to this sensor: it draws
    two normal numbers per measurement, in order of time, with or without a predecessor in view.
    """

    def __init__(
        self,
        settings: GapSensorSettings,
        own: VehicleParameters,
        target: VehicleParameters,
        control: Cadence,
        random: Generator,
    ) -> None:
        """`own` and `target` are this car and its predecessor; it starts with the `control`."""
        self._settings = settings
        self._front = own.body_offset + 0.5 * own.length
        self._rear = target.body_offset - 0.5 * target.length
        self._control = control
        period = round(SECOND / min(settings.rate, control.rate_hz))
        self._due = Timer(period, control.start_at, steady=True)
        self._valid_for = settings.latency + MISSED * period
        self._random = random
        self._pending: deque[tuple[int, Body, float, float]] = deque()

    def measure(self, body: Body, now: int, target_at: TargetAt) -> GapMeasurement | None:
        """Measure if `now` (ns) is an instant of measurement; return what becomes available now.

        The measurement is that of `latency` ago. Its pose of the predecessor is `target_at` that
        instant, which arrives in the meantime.
        """
        if self._control.due(now) and self._due.is_due(now):
            self._pending.append((now, body, *self._random.standard_normal(2).tolist()))
        made: GapMeasurement | None = None
        while self._pending and self._pending[0][0] + self._settings.latency <= now:
            at, own, gap_noise, rate_noise = self._pending.popleft()
            made = self._measured(at, own, target_at(at), gap_noise, rate_noise)
        return made

    def _measured(
        self, at: int, own: Body, target: TruePose | None, gap_noise: float, rate_noise: float
    ) -> GapMeasurement:
        settings, valid_until = self._settings, at + self._valid_for
        nothing = GapMeasurement(at, valid_until)
        if target is None or at - target.true_at_ns > OLDEST_POSE:
            return nothing
        # Complex numbers are vectors, east and north, or along and left of a body.
        ahead, ux, there = self._front, cmath.rect(1.0, own.yaw), cmath.rect(1.0, target.yaw_rad)
        # Messages have instants of their own: the predecessor goes straight on to this one.
        behind = self._rear + target.speed_mps * (at - target.true_at_ns) / SECOND
        turning = target.lateral_speed_mps + target.yaw_rate_radps * self._rear
        sight = complex(target.east_m - own.east, target.north_m - own.north)
        sight += behind * there - ahead * ux
        apart = there * complex(target.speed_mps, turning)
        apart -= ux * complex(own.speed, own.lateral_speed + own.yaw_rate * ahead)
        gap, bearing = abs(sight), cmath.phase(sight / ux)
        if not 0.0 < gap <= settings.reach or abs(bearing) > 0.5 * settings.field_of_view:
            return nothing
        rate = (sight.conjugate() * apart).real / gap
        return GapMeasurement(
            at,
            valid_until,
            max(gap + settings.gap_noise * gap_noise, 0.0),
            rate + settings.gap_rate_noise * rate_noise,
        )
