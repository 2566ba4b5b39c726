"""Errors of a receiver's positions over a run, except plain white noise.

The drift of carrier-phase receivers is a Gauss–Markov process (Hoffmann, 2020, uses two). Nearby
receivers share errors from satellites and atmosphere, so their relative error is smaller.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import exp, expm1, hypot, inf, isinf, sqrt
from typing import NamedTuple

from numpy.random import Generator

from vehicles.car.dynamics import Body
from vehicles.car.gnss_error_terms import (
    CommonDrift,
    ErrorProcess,
    ErrorTerm,
    FixStates,
    GaussMarkov,
    ReceiverContext,
    StateInterval,
    StateSchedule,
    begin_term,
    draw_truncated,
    restarted,
)
from vehicles.car.gnss_settings import NO_DRIFT, STATES_WITH_FIX, GnssSettings, StateErrors
from vehicles.messages import FixState
from vehicles.schedule import SECOND


class PositionError(NamedTuple):
    """Error without white noise, deviation of that noise, and reported accuracy (m)."""

    east: float
    north: float
    white_deviation: float
    state: FixState
    accuracy: float


@dataclass(slots=True)
class _Restart:
    """Restart of the drift: instant (ns), undisturbed value, and value after the jump."""

    at: int
    first: tuple[float, float]
    jump: tuple[float, float]


class ReceiverErrors:
    """The errors of one receiver in one run; calls must be in order of time."""

    def __init__(
        self,
        settings: GnssSettings,
        context: ReceiverContext,
        begin: Callable[[ErrorTerm, ReceiverContext], ErrorProcess] = begin_term,
    ) -> None:
        """`begin` begins an error term."""
        self.settings = settings
        law = settings.fix_states
        self.states: FixStates = (
            law.begin(settings.fix, context)
            if law
            else StateSchedule(settings.fix, (), context.start_at)
        )
        self._context = context
        entries = {id(term): context.for_entry(k) for k, term in enumerate(settings.errors)}
        self._terms: list[ErrorProcess] = [
            begin(term, entries.get(id(term), context)) for term in settings.error_terms
        ]
        self._errors = {state: settings.errors_in(state) for state in STATES_WITH_FIX}
        self._deviations = {state: settings.deviation(state) for state in STATES_WITH_FIX}
        self._drifts = {
            state: GaussMarkov(
                errors.drift.time_constant, context.start_at, context.own_streams(f"drift {state}")
            )
            for state, errors in self._errors.items()
            if errors.drift and errors.drift.deviation > 0.0
        }
        self._jumps: Generator = context.own_streams("jump")
        self._interval: StateInterval | None = None
        self._restart: _Restart | None = None
        self._is_running = False

    def at(self, body: Body, now: int) -> PositionError | None:
        """Error of a fix at `now` (ns): drift of the state plus error terms; None without a fix."""
        interval = self.states.at(now)
        outages = self.settings.outages
        if interval.state == "none" or any(
            outage.covers(body, now, self._context) for outage in outages
        ):
            self._interval, self._is_running = None, True
            return None
        state, errors = interval.state, self._errors[interval.state]
        east, north = self._drift(state, errors, interval, now)
        for term in self._terms:
            more_east, more_north = term.at(body, now)
            east, north = east + more_east, north + more_north
        accuracy = errors.accuracy * self._deviations[state]
        return PositionError(east, north, errors.position_noise, state, accuracy)

    def rounded(self, coordinate: float) -> float:
        """Round a coordinate (m) to the nearest multiple of the quantisation step."""
        quantum = self.settings.quantisation
        return quantum * round(coordinate / quantum) if quantum else coordinate

    def _drift(
        self, state: FixState, errors: StateErrors, interval: StateInterval, now: int
    ) -> tuple[float, float]:
        """Own drift (m) in this state; it restarts when the state is entered."""
        drift, process = errors.drift or NO_DRIFT, self._drifts.get(state)
        deviation = drift.deviation
        east, north = process.at(now) if process else (0.0, 0.0)
        value = deviation * east, deviation * north
        if interval != self._interval:
            self._restart = None
            # No jump at the start: the receiver is assumed to have been running.
            if self._is_running and errors.entry_jump is not None:
                first, second = self._jumps.random(2).tolist()
                jump = draw_truncated(deviation, errors.entry_jump, (first, second))
                self._restart = _Restart(now, value, jump)
            self._interval, self._is_running = interval, True
        if self._restart is None:
            return value
        kept = exp(-(now - self._restart.at) / SECOND / drift.time_constant)
        return restarted(value, self._restart.first, self._restart.jump, kept)


# ---- The error model that a receiver states: what an estimator may know of its errors
#
# It is that of the settings, scaled by the ratio of the reported accuracy to the true one. A
# receiver that reports a wrong accuracy therefore misleads its estimator.


LEAST_NOISE = 0.001  # Least white noise (m) of a position: receivers report millimetres


@dataclass(frozen=True, slots=True)
class LastingError:
    """An error per axis that lasts from fix to fix: a stationary Gauss–Markov process.

    Standard deviation (m), time constant (s, infinite for a constant error). It is part of the
    fixes in `states`, and restarts with the deviation `entry_deviation` (m) whenever such a state
    is entered, if given.
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

    `white` is the variance (m²) of the white noise by fix state, `period` (ns) that of fixes.
    `common` is shared by all receivers, so it does not change relative positions.
    """

    white: Mapping[FixState, float]
    lasting: tuple[LastingError, ...]
    common: LastingError | None
    period: int

    def is_white(self, state: FixState) -> bool:
        return self.common is None and not any(state in error.states for error in self.lasting)

    @property
    def common_variance(self) -> float:
        return self.common.deviation**2 if self.common else 0.0

    @property
    def common_density(self) -> float:
        """Random walk (m²/s) per axis of the shared error, 2 σ²/τ of a Gauss–Markov process."""
        return 2.0 * self.common_variance / self.common.time_constant if self.common else 0.0


def stated_errors(settings: GnssSettings) -> StatedErrors:
    """Error model that a receiver with these settings states.

    A configured bias counts with its size, not its direction, as in a data sheet.
    """
    lasting = [error for state in settings.states for error in _drift(settings, state)]
    bias = settings.bias
    if bias is not None:
        size = hypot(bias.deviation, hypot(bias.east, bias.north) / sqrt(2.0))
        everywhere = frozenset(STATES_WITH_FIX)
        lasting.append(LastingError(settings.accuracy * size, inf, everywhere))
    return StatedErrors(
        white={state: _white(settings, state) for state in STATES_WITH_FIX},
        lasting=tuple(error for error in lasting if error.deviation > 0.0),
        common=_common(settings.common_drift, settings.accuracy),
        period=round(SECOND / settings.rate),
    )


def _white(settings: GnssSettings, state: FixState) -> float:
    """Variance of the white noise in a state; rounding to a step q has q²/12."""
    errors = settings.errors_in(state)
    noise = hypot(errors.position_noise, settings.quantisation / sqrt(12.0))
    return max(errors.accuracy * noise, LEAST_NOISE) ** 2


def _drift(settings: GnssSettings, state: FixState) -> list[LastingError]:
    errors = settings.errors_in(state)
    drift = errors.drift or NO_DRIFT
    if drift.deviation <= 0.0:
        return []
    entry = _entry_deviation(errors, drift.deviation)
    deviation = errors.accuracy * drift.deviation
    return [LastingError(deviation, drift.time_constant, frozenset({state}), entry)]


def _entry_deviation(errors: StateErrors, deviation: float) -> float | None:
    """Stated deviation (m) per axis of a drift that restarts within `entry_jump` (m) of 0.

    The distance has Rayleigh's distribution, truncated: half its mean square is
    σ² (1 - u / (e^u - 1)) with u = r² / 2σ².
    """
    radius = errors.entry_jump
    if radius is None:
        return None
    u = 0.5 * (radius / deviation) ** 2
    share = 1.0 - u / expm1(u) if 0.0 < u < 700.0 else float(u > 0.0)
    return errors.accuracy * deviation * sqrt(share)


def _common(drift: CommonDrift | None, accuracy: float) -> LastingError | None:
    if drift is None or drift.deviation <= 0.0 or isinf(drift.time_constant):
        return None
    states = frozenset(STATES_WITH_FIX)
    return LastingError(accuracy * drift.deviation, drift.time_constant, states)
