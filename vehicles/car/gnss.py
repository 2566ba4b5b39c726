"""The GNSS receiver, and its fixes as messages.

It emulates RTK positions aided by an inertial unit, at a fixed rate. Internally a fix is in the
east-north plane with yaw; on the wire it is WGS84 with a compass course.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from numpy.random import Generator

from vehicles.car.dynamics import Body
from vehicles.car.gnss_error_terms import NO_END, ReceiverState
from vehicles.car.gnss_errors import ReceiverErrors
from vehicles.car.noise import GnssNoise
from vehicles.geometry.geodesy import LocalPlane, heading_from_yaw
from vehicles.geometry.sampled_path import NO_HISTORY, HistoryDeltas
from vehicles.messages import NO_ANNOUNCEMENT, Announcement, FixState, GpsPose
from vehicles.schedule import Cadence

BLOCK: Final = 64  # Measurements whose noise is drawn at once; changes no number


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


class GnssReceiver:
    """GPS receiver of Section III-A, measuring every 1/`rate_hz` s from `start_at` (ns) on.

    `random` belongs to this receiver: it draws five normal numbers per measurement, with or without
    a fix. `errors` replace the position noise; if they are white noise only, they apply only while
    a fix state is forced by `force`.
    """

    def __init__(
        self,
        noise: GnssNoise,
        rate_hz: float,
        start_at: int,
        random: Generator,
        errors: ReceiverErrors | None = None,
    ) -> None:
        self._noise = noise
        self._cadence = Cadence(start_at, rate_hz)
        self._random = random
        self._drawn: list[float] = []
        self._errors = errors
        self._is_plain = errors is None or errors.settings.has_only_white_noise
        self._latency = errors.settings.latency if errors else 0
        self._pending: deque[Fix] = deque()

    def measure(self, body: Body, now: int) -> Fix | None:
        """Measure `body` if `now` (ns) is an instant of measurement; return the fix available now.

        With a latency this is an earlier fix. Each quantity has its own white Gaussian noise
        (Section III-A has that of the position).
        """
        fix = self._measured(body, now)
        if not self._latency:
            return fix
        if fix is not None:
            self._pending.append(fix)
        if self._pending and self._pending[0].measured_at + self._latency <= now:
            return self._pending.popleft()
        return None

    def force(self, state: ReceiverState | None, since: int, until: int = NO_END) -> None:
        """Force a fix state from `since` (ns) to `until`, excluded; None ends it.

        Outages still apply. Raises ValueError for a receiver without fix states.
        """
        if self._errors is None:
            raise ValueError("this receiver has no fix states, only white noise")
        self._errors.states.force(state, since, until)

    def _measured(self, body: Body, now: int) -> Fix | None:
        seq = self._cadence.index(now)
        if seq is None:
            return None
        if not self._drawn:
            self._drawn = self._random.standard_normal(5 * BLOCK).tolist()
            self._drawn.reverse()
        draw, noise, errors = self._drawn.pop, self._noise, self._errors
        east, north, yaw, speed, yaw_rate = draw(), draw(), draw(), draw(), draw()
        fix = Fix(
            seq,
            now,
            body.east + noise.position * east,
            body.north + noise.position * north,
            math.remainder(body.yaw + noise.heading * yaw, math.tau),
            max(0.0, body.speed + noise.speed * speed),
            body.yaw_rate + noise.yaw_rate * yaw_rate,
            "fixed",
            noise.position,
        )
        if errors is None or (self._is_plain and not errors.states.is_forced(now)):
            return fix
        error = errors.at(body, now)
        if error is None:
            return None
        off_east, off_north, fix.state, white, fix.accuracy = error
        fix.east = errors.rounded(body.east + white * east + off_east)
        fix.north = errors.rounded(body.north + white * north + off_north)
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
    history: HistoryDeltas = NO_HISTORY,
) -> GpsPose:
    """Convert a fix to message `seq` (WGS84, compass course), sent at `sent_at` (ns).

    `true_position` holds the vehicle's true east, north and distance driven (m). The course is
    relative to the plane's north, which differs from true north by the convergence of meridians,
    about 0.01 deg per km of easting at middle latitudes.
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
        leaving=announcement.leaving,
        relayed_stops_at_ns=announcement.relayed_stops_at_ns,
        achieved_acceleration_mps2=announcement.achieved_acceleration_mps2,
        true_east_m=true_position[0],
        true_north_m=true_position[1],
        true_distance_m=true_position[2],
        history_latitude_e7deg=history[0],
        history_longitude_e7deg=history[1],
        history_age_cs=history[2],
    )
