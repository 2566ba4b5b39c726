"""The GNSS receiver, and its fixes as messages.

It emulates RTK positions aided by an inertial unit, at a fixed rate. Internally a fix is in the
east-north plane with yaw; on the wire it is WGS84 with a compass course.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from numpy.random import Generator

from vehicles.car.dynamics import Body
from vehicles.car.gnss_error_terms import (
    NO_END,
    ErrorProcess,
    ErrorTerm,
    GaussMarkov,
    ReceiverContext,
    ReceiverState,
    ScheduledStates,
    StateInterval,
)
from vehicles.car.gnss_settings import STATES_WITH_FIX, GnssSettings
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
    """GPS receiver of Section III-A, measuring every 1/`rate` s from the start of a run on.

    `random` draws five normal numbers per measurement, with or without a fix. Other errors have
    random streams of their own, from the `context`. Calls must be in order of time.
    """

    def __init__(
        self,
        settings: GnssSettings,
        context: ReceiverContext,
        random: Generator,
        begin: Callable[[ErrorTerm, ReceiverContext], ErrorProcess] | None = None,
    ) -> None:
        """`begin` begins an error term; by default its own method does."""
        self._settings, self._context, self._random = settings, context, random
        self._cadence = Cadence(context.start_at, settings.rate)
        self._drawn: list[float] = []
        self._pending: deque[Fix] = deque()
        law, own = settings.fix_states or ScheduledStates(()), context.own_streams
        self._intervals = law.intervals(settings.fix, context)
        self._scheduled = next(self._intervals)
        self._forced: StateInterval | None = None
        # The receiver has been running: the first state is not entered at the start.
        self._present: StateInterval | None = self._scheduled
        self._errors = {state: settings.errors_in(state) for state in STATES_WITH_FIX}
        self._deviations = {state: settings.deviation(state) for state in STATES_WITH_FIX}
        self._drifts = {
            state: GaussMarkov(errors.drift, context.start_at, own(f"drift {state}"))
            for state, errors in self._errors.items()
            if errors.drift
        }
        self._jumps = own("jump")
        entries = {id(term): context.for_entry(k) for k, term in enumerate(settings.errors)}
        contexts = ((term, entries.get(id(term), context)) for term in settings.error_terms)
        self._terms = [begin(*one) if begin else one[0].begin(one[1]) for one in contexts]

    def measure(self, body: Body, now: int) -> Fix | None:
        """Measure `body` if `now` (ns) is an instant of measurement; return the fix available now.

        With a latency this is an earlier fix. Each quantity has its own white Gaussian noise
        (Section III-A has that of the position).
        """
        seq, latency = self._cadence.index(now), self._settings.latency
        fix = None if seq is None else self._measured(seq, body, now)
        if not latency:
            return fix
        if fix is not None:
            self._pending.append(fix)
        if self._pending and self._pending[0].measured_at + latency <= now:
            return self._pending.popleft()
        return None

    def force(self, state: ReceiverState | None, since: int, until: int = NO_END) -> None:
        """Force a fix state from `since` (ns) to `until`, excluded; None ends it.

        Outages still apply. The scheduled or random states continue in the background.
        """
        self._forced = None if state is None else StateInterval(state, since, until)

    def _measured(self, seq: int, body: Body, now: int) -> Fix | None:
        if not self._drawn:
            self._drawn = self._random.standard_normal(5 * BLOCK).tolist()
            self._drawn.reverse()
        draw, settings = self._drawn.pop, self._settings
        east, north, yaw, speed, yaw_rate = draw(), draw(), draw(), draw(), draw()
        while now >= self._scheduled.until:
            self._scheduled = next(self._intervals)
        interval, forced = self._scheduled, self._forced
        if forced is not None and forced.since <= now < forced.until:
            interval = forced
        state, outages = interval.state, settings.outages
        if state == "none" or (
            outages and any(outage.covers(body, now, self._context) for outage in outages)
        ):
            self._present = None
            return None
        errors, drift = self._errors[state], self._drifts.get(state)
        if drift and errors.entry_jump is not None and interval is not self._present:
            drift.restart(body, now, errors.entry_jump, self._jumps)
        self._present = interval
        off_east, off_north = drift.at(body, now) if drift else (0.0, 0.0)
        for term in self._terms:
            more_east, more_north = term.at(body, now)
            off_east, off_north = off_east + more_east, off_north + more_north
        east = body.east + errors.position_noise * east + off_east
        north = body.north + errors.position_noise * north + off_north
        if step := settings.quantisation:
            east, north = step * round(east / step), step * round(north / step)
        return Fix(
            seq,
            now,
            east,
            north,
            math.remainder(body.yaw + settings.heading_noise * yaw, math.tau),
            max(0.0, body.speed + settings.speed_noise * speed),
            body.yaw_rate + settings.yaw_rate_noise * yaw_rate,
            state,
            errors.accuracy * self._deviations[state],
        )


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
        **announcement._asdict(),
        true_east_m=true_position[0],
        true_north_m=true_position[1],
        true_distance_m=true_position[2],
        history_latitude_e7deg=history[0],
        history_longitude_e7deg=history[1],
        history_age_cs=history[2],
    )
