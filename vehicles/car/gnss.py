"""The receiver that measures the car, and its measurements as messages.

A receiver of the kind used for automated driving: RTK positions aided by an inertial unit, at a
fixed rate. Inside, a fix is in the east-north plane with yaw; on the wire it is WGS84 with a
compass course.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from numpy.random import Generator

from vehicles.car.dynamics import Body
from vehicles.car.positioning.fix_states import NO_END, ForcedStates, ReceiverState
from vehicles.car.positioning.gnss_errors import ReceiverErrors
from vehicles.car.positioning.noise import GnssNoise
from vehicles.geometry.geodesy import LocalPlane, heading_from_yaw, wrap_angle
from vehicles.messages import NO_ANNOUNCEMENT, Announcement, FixState, GpsPose
from vehicles.schedule import Cadence

BLOCK: Final = 64
"""Measurements whose noise is drawn at once; the numbers are the same whatever the block."""


@dataclass(slots=True)
class Fix:
    """One measurement: the output of the vehicle block of Fig. 1.

    Number, instant (ns), position (m), yaw of the body within (-pi, pi] (rad), speed along the
    body (m/s, never negative), yaw rate (rad/s); state of the fix, and stated accuracy (m, standard
    deviation per axis).
    """

    seq: int
    measured_at: int
    east: float
    north: float
    yaw: float
    speed: float
    yaw_rate: float
    state: FixState = "fixed"
    accuracy: float = 0.02

    def __init__(  # noqa: PLR0917 - its fields
        self,
        seq: int,
        measured_at: int,
        east: float,
        north: float,
        yaw: float,
        speed: float,
        yaw_rate: float,
        state: FixState = "fixed",
        accuracy: float = 0.02,
    ) -> None:
        self.seq = seq
        self.measured_at = measured_at
        self.east = east
        self.north = north
        self.yaw = yaw
        self.speed = speed
        self.yaw_rate = yaw_rate
        self.state = state
        self.accuracy = accuracy


_State = tuple[list[float], ReceiverErrors | None, ForcedStates | None, deque[Fix]]


class GnssReceiver:
    """Measures at `start_at` (ns) and every 1/`rate_hz` s after it, each rounded to 1 ns.

    GPS of Section III-A, at 20 Hz at most. `random` belongs to this receiver alone: five normal
    numbers are drawn per measurement, with a fix or without. `errors` replace the position noise;
    those of plain settings count only while a fix state is forced by `force`.
    """

    def __init__(
        self,
        noise: GnssNoise,
        rate_hz: float,
        start_at: int,
        random: Generator,
        errors: ReceiverErrors | None = None,
    ) -> None:
        if not (math.isfinite(rate_hz) and rate_hz > 0.0):
            raise ValueError(f"the measuring rate must be positive, not {rate_hz} Hz")
        self._noise = noise
        self._cadence = Cadence(start_at, rate_hz)
        self._random = random
        self._drawn: list[float] = []
        self._forced: ForcedStates | None = None
        if errors is not None:
            self._forced = errors.states = ForcedStates(errors.states)
        self._take(errors)
        self._coming: deque[Fix] = deque()

    def __reduce__(self) -> "tuple[type[GnssReceiver], tuple[object, ...], _State]":
        made_of = self._noise, self._cadence.rate_hz, self._cadence.start_at, self._random
        return GnssReceiver, made_of, (self._drawn, self._errors, self._forced, self._coming)

    def __setstate__(self, state: "_State") -> None:
        self._drawn, errors, self._forced, self._coming = state
        self._take(errors)

    def _take(self, errors: ReceiverErrors | None) -> None:
        self._errors = errors
        self._plain = errors is None or errors.settings.has_only_white_noise
        self._latency = errors.settings.latency if errors else 0

    def measure(self, body: Body, now: int) -> Fix | None:
        """Measure `body` if `now` (ns) is an instant of measurement; returns the fix known then.

        With a latency that is an earlier fix. Each quantity has its own white Gaussian noise
        (Section III-A names that of the position).
        """
        fix = self._measured(body, now)
        if not self._latency:
            return fix
        if fix is not None:
            self._coming.append(fix)
        if self._coming and self._coming[0].measured_at + self._latency <= now:
            return self._coming.popleft()
        return None

    def force(self, state: ReceiverState | None, since: int, until: int = NO_END) -> None:
        """Force a fix state from `since` until before `until` (ns); None ends it.

        Outages stay. Raises ValueError for a receiver without fix states.
        """
        if self._forced is None:
            raise ValueError("this receiver has white noise alone")
        self._forced.force(state, since, until)

    def redraw(self, random: Generator) -> None:
        """Draw the white noise from another stream from now on; the other errors stay."""
        self._random = random
        self._drawn.clear()

    def _measured(self, body: Body, now: int) -> Fix | None:
        seq = self._cadence.index(now)
        if seq is None:
            return None
        if not self._drawn:
            self._drawn = self._random.standard_normal(5 * BLOCK).tolist()
            self._drawn.reverse()
        draw, noise = self._drawn.pop, self._noise
        east, north, yaw, speed, yaw_rate = draw(), draw(), draw(), draw(), draw()
        fix = Fix(
            seq,
            now,
            body.east + noise.position * east,
            body.north + noise.position * north,
            wrap_angle(body.yaw + noise.heading * yaw),
            max(0.0, body.speed + noise.speed * speed),
            body.yaw_rate + noise.yaw_rate * yaw_rate,
            "fixed",
            noise.position,
        )
        forced = self._forced is not None and self._forced.is_forced(now)
        if self._errors is None or (self._plain and not forced):
            return fix
        error = self._errors.at(body, now)
        if error is None:
            return None
        rounded = self._errors.rounded
        fix.east = rounded(body.east + error.white * east + error.east)
        fix.north = rounded(body.north + error.white * north + error.north)
        fix.state, fix.accuracy = error.state, error.accuracy
        return fix


def to_message(
    fix: Fix,
    vehicle: str,
    plane: LocalPlane,
    *,
    seq: int,
    sent_at: int,
    true_position: tuple[float, float, float],
    announcement: Announcement = NO_ANNOUNCEMENT,
) -> GpsPose:
    """Convert a fix to message `seq` (WGS84, compass course), sent at `sent_at` (ns).

    `true_place` is the true east, north and distance driven (m) of the vehicle.

    The course is counted from the plane's north; true north at the vehicle differs from it by
    the convergence of meridians, about 0.01 deg per km of easting at middle latitudes.
    """
    latitude_deg, longitude_deg, altitude_m = plane.to_geodetic(fix.east, fix.north)
    return GpsPose(
        vehicle=vehicle,
        seq=seq,
        measured_at_ns=fix.measured_at,
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        altitude_m=altitude_m,
        heading_deg=heading_from_yaw(fix.yaw),
        speed_mps=fix.speed,
        yaw_rate_radps=fix.yaw_rate,
        sent_at_ns=sent_at,
        fix=fix.state,
        position_accuracy_m=fix.accuracy,
        mode=announcement.mode,
        hazard=announcement.hazard,
        acceleration_mps2=announcement.acceleration_mps2,
        path_offset_m=announcement.path_offset_m,
        stops_at_ns=announcement.stops_at_ns,
        true_east_m=true_position[0],
        true_north_m=true_position[1],
        true_distance_m=true_position[2],
    )
