"""Errors of a receiver's positions over a run, except plain white noise.

The drift of carrier-phase receivers is a Gauss–Markov process (Hoffmann, 2020, uses two). Nearby
receivers share errors from satellites and atmosphere, so their relative error is smaller.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp
from typing import NamedTuple

from numpy.random import Generator

from vehicles.car.dynamics import Body
from vehicles.car.positioning.drift import GaussMarkov, draw_truncated, restarted
from vehicles.car.positioning.error_term import ErrorProcess, ErrorTerm, ReceiverContext, begin_term
from vehicles.car.positioning.fix_states import FixStates, StateInterval, StateSchedule
from vehicles.car.positioning.gnss_settings import (
    NO_DRIFT,
    STATES_WITH_FIX,
    GnssSettings,
    StateErrors,
)
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
