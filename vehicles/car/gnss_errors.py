"""Errors of a receiver's positions over a run, except plain white noise.

The drift of carrier-phase receivers is a Gauss–Markov process (Hoffmann, 2020, uses two). Nearby
receivers share errors from satellites and atmosphere, so their relative error is smaller.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import cos, exp, expm1, hypot, inf, log1p, pi, sin, sqrt

from vehicles.car.dynamics import Body
from vehicles.car.gnss_error_terms import (
    ErrorProcess,
    ErrorTerm,
    FixStates,
    GaussMarkov,
    ReceiverContext,
    ScheduledStates,
    StateInterval,
)
from vehicles.car.gnss_settings import NO_DRIFT, STATES_WITH_FIX, GnssSettings
from vehicles.messages import FixState
from vehicles.schedule import SECOND


class ReceiverErrors:
    """The errors of one receiver in one run; calls must be in order of time."""

    def __init__(
        self,
        settings: GnssSettings,
        context: ReceiverContext,
        begin: Callable[[ErrorTerm, ReceiverContext], ErrorProcess] | None = None,
    ) -> None:
        """`begin` begins an error term; by default its own method does."""
        self.settings = settings
        law = settings.fix_states or ScheduledStates(())
        self.states = FixStates(law.intervals(settings.fix, context))
        self._context, own = context, context.own_streams
        entries = {id(term): context.for_entry(k) for k, term in enumerate(settings.errors)}
        contexts = ((term, entries.get(id(term), context)) for term in settings.error_terms)
        self._terms = [begin(*one) if begin else one[0].begin(one[1]) for one in contexts]
        self._errors = {state: settings.errors_in(state) for state in STATES_WITH_FIX}
        self._deviations = {state: settings.deviation(state) for state in STATES_WITH_FIX}
        self._drifts = {
            state: GaussMarkov(errors.drift, context.start_at, own(f"drift {state}"))
            for state, errors in self._errors.items()
            if errors.drift and errors.drift.deviation > 0.0
        }
        self._jumps = own("jump")
        self._interval: StateInterval | None = None
        self._entered_at = 0  # Instant (ns) at which the drift restarted
        self._shift = (0.0, 0.0)  # Change of the drift (m) by its restart, at that instant
        self._is_running = False

    def at(self, body: Body, now: int) -> tuple[float, float, FixState, float, float] | None:
        """Error of a fix at `now` (ns): drift of the state plus error terms; None without a fix.

        East and north (m) without white noise, fix state, deviation of the white noise (m, per
        axis), and reported accuracy (m).
        """
        interval = self.states.at(now)
        outages = self.settings.outages
        if interval.state == "none" or any(
            outage.covers(body, now, self._context) for outage in outages
        ):
            self._interval, self._is_running = None, True
            return None
        state, errors = interval.state, self._errors[interval.state]
        east, north = self._drift(state, interval, body, now)
        for term in self._terms:
            more_east, more_north = term.at(body, now)
            east, north = east + more_east, north + more_north
        accuracy = errors.accuracy * self._deviations[state]
        return east, north, state, errors.position_noise, accuracy

    def rounded(self, coordinate: float) -> float:
        """Round a coordinate (m) to the nearest multiple of the quantisation step."""
        quantum = self.settings.quantisation
        return quantum * round(coordinate / quantum) if quantum else coordinate

    def _drift(
        self, state: FixState, interval: StateInterval, body: Body, now: int
    ) -> tuple[float, float]:
        """Own drift (m) in this state; the change by its restart decays exponentially."""
        errors, process = self._errors[state], self._drifts.get(state)
        east, north = process.at(body, now) if process else (0.0, 0.0)
        drift = errors.drift or NO_DRIFT
        if interval is not self._interval:
            self._shift = 0.0, 0.0
            # No jump at the start: the receiver is assumed to have been running.
            if self._is_running and errors.entry_jump is not None:
                first, second = self._jumps.random(2).tolist()
                jump = draw_truncated(drift.deviation, errors.entry_jump, (first, second))
                self._shift, self._entered_at = (jump[0] - east, jump[1] - north), now
            self._interval, self._is_running = interval, True
        if self._shift == (0.0, 0.0):
            return east, north
        kept = exp(-(now - self._entered_at) / SECOND / drift.time_constant)
        return east + kept * self._shift[0], north + kept * self._shift[1]


def draw_truncated(
    deviation: float, radius: float, draws: tuple[float, float]
) -> tuple[float, float]:
    """Draw a normal position (m), truncated to a circle of `radius` (m) around 0.

    `deviation` (m) is the standard deviation per axis, `draws` are uniform in [0, 1). Inverts the
    distribution function of Rayleigh's distribution.
    """
    if deviation <= 0.0 or radius <= 0.0:
        return 0.0, 0.0
    probability = -expm1(-0.5 * (radius / deviation) ** 2)
    distance = min(deviation * sqrt(-2.0 * log1p(-draws[0] * probability)), radius)
    angle = 2.0 * pi * draws[1]
    return distance * cos(angle), distance * sin(angle)


# ---- The error model that a receiver states: what an estimator may know of its errors
#
# It is that of the settings, scaled by the ratio of the reported accuracy to the true one. A
# receiver that reports a wrong accuracy therefore misleads its estimator.


LEAST_NOISE = 0.001  # Least white noise (m) of a position: receivers report millimetres


@dataclass(frozen=True, slots=True)
class LastingError:
    """An error per axis that lasts from fix to fix: a stationary Gauss–Markov process.

    Standard deviation (m), time constant (s, infinite for a constant error). It is part of fixes in
    `states`, and restarts with `entry_deviation` (m), if given, when such a state is entered.
    """

    deviation: float
    time_constant: float
    states: frozenset[FixState]
    entry_deviation: float | None = None

    def kept(self, span: float) -> float:
        """Share of the error that is left after `span` (s): exp(-t / time constant)."""
        return exp(-span / self.time_constant)

    def growth(self, span: float) -> float:
        """Variance (m²) that is added in `span` (s); the stationary variance remains."""
        return -(self.deviation**2) * expm1(-2.0 * span / self.time_constant)


@dataclass(frozen=True, slots=True)
class StatedErrors:
    """Errors of a receiver's positions, per axis.

    `white` is the variance (m²) of the white noise by fix state, `period` (ns) that of fixes. The
    error shared by all receivers, which does not change relative positions, has `common_variance`
    (m²) and `common_density` (m²/s), its random walk, 2 σ²/τ of a Gauss–Markov process.
    """

    white: Mapping[FixState, float]
    lasting: tuple[LastingError, ...]
    common_variance: float
    common_density: float
    period: int

    def is_white(self, state: FixState) -> bool:
        return not self.common_variance and not any(state in one.states for one in self.lasting)


def stated_errors(settings: GnssSettings) -> StatedErrors:
    """Error model that a receiver with these settings states.

    A configured bias counts with its size, not its direction, as in a data sheet. Rounding to a
    step q has the variance q²/12.
    """
    white, lasting = {}, []
    for state in STATES_WITH_FIX:
        errors = settings.errors_in(state)
        noise = hypot(errors.position_noise, settings.quantisation / sqrt(12.0))
        white[state] = max(errors.accuracy * noise, LEAST_NOISE) ** 2
        if state in settings.states and errors.drift is not None and errors.drift.deviation > 0.0:
            drift, entry = errors.drift, errors.entry_jump
            deviation = errors.accuracy * drift.deviation
            entered = None if entry is None else deviation * _entry_share(entry / drift.deviation)
            lasting.append(
                LastingError(deviation, drift.time_constant, frozenset({state}), entered)
            )
    bias, common = settings.bias, settings.common_drift
    if bias is not None:
        size = hypot(bias.deviation, hypot(bias.east, bias.north) / sqrt(2.0))
        lasting.append(LastingError(settings.accuracy * size, inf, frozenset(STATES_WITH_FIX)))
    variance = (settings.accuracy * common.deviation) ** 2 if common else 0.0
    return StatedErrors(
        white,
        tuple(error for error in lasting if error.deviation > 0.0),
        variance,
        2.0 * variance / common.time_constant if common else 0.0,
        round(SECOND / settings.rate),
    )


def _entry_share(radius: float) -> float:
    """Deviation per axis of a drift that restarts within `radius` of 0, both over its deviation.

    The distance has Rayleigh's distribution, truncated: half its mean square is
    σ² (1 - u / (e^u - 1)) with u = r² / 2σ².
    """
    u = 0.5 * radius**2
    return sqrt(1.0 - u / expm1(u) if 0.0 < u < 700.0 else float(u > 0.0))
