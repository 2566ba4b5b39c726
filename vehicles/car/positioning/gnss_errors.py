"""Errors of a receiver's positions over a run, apart from plain white noise.

The drift of carrier-phase receivers is a Gauss–Markov process (Hoffmann, 2020, takes two); the
errors between two receivers nearby are smaller than each one's, because satellites and atmosphere
are the same.
"""

from dataclasses import dataclass
from math import exp
from typing import NamedTuple

from numpy.random import Generator

from vehicles.car.dynamics import Body
from vehicles.car.positioning.drift import GaussMarkov, draw_truncated, restarted
from vehicles.car.positioning.error_term import ErrorProcess, ReceiverContext
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
    """Error of a position (m) without white noise, deviation of that noise, stated accuracy (m)."""

    east: float
    north: float
    white: float
    state: FixState
    accuracy: float


@dataclass(slots=True)
class _Entered:
    """Restart of the drift: instant, value of the stationary process then, initial value."""

    at: int
    first: tuple[float, float]
    jump: tuple[float, float]


class ReceiverErrors:
    """The errors of one receiver in one run, in order of time."""

    def __init__(self, settings: GnssSettings, context: ReceiverContext) -> None:
        self.settings = settings
        law = settings.fix_states
        self.states: FixStates = (
            law.begin(settings.fix, context)
            if law
            else StateSchedule(settings.fix, (), context.start_at)
        )
        self._context = context
        self._added: list[ErrorProcess] = [error.begin(context) for error in settings.error_terms]
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
        self._stay: StateInterval | None = None
        self._entered: _Entered | None = None
        self._begun = False

    def at(self, body: Body, now: int) -> PositionError | None:
        """Error of a fix at `now` (ns): the state's drift and added errors; None without a fix."""
        stay = self.states.at(now)
        outages = self.settings.outages
        if stay.state == "none" or any(one.covers(body, now, self._context) for one in outages):
            self._stay, self._begun = None, True
            return None
        state, errors = stay.state, self._errors[stay.state]
        east, north = self._drift(state, errors, stay, now)
        for course in self._added:
            more_east, more_north = course.at(body, now)
            east, north = east + more_east, north + more_north
        accuracy = errors.accuracy * self._deviations[state]
        return PositionError(east, north, errors.position_noise, state, accuracy)

    def rounded(self, coordinate: float) -> float:
        """Coordinate (m) to the nearest multiple of the quantum."""
        quantum = self.settings.quantisation
        return quantum * round(coordinate / quantum) if quantum else coordinate

    def _drift(
        self, state: FixState, errors: StateErrors, stay: StateInterval, now: int
    ) -> tuple[float, float]:
        """Own drift (m) in this state; it restarts if the state was entered since."""
        drift, path = errors.drift or NO_DRIFT, self._drifts.get(state)
        deviation = drift.deviation
        east, north = path.at(now) if path else (0.0, 0.0)
        value = deviation * east, deviation * north
        if stay != self._stay:
            # Not at the start: the receiver has been on for long.
            self._entered = None
            if self._begun and errors.entry_jump is not None:
                first, second = self._jumps.random(2).tolist()
                jump = draw_truncated(deviation, errors.entry_jump, (first, second))
                self._entered = _Entered(now, value, jump)
            self._stay, self._begun = stay, True
        if self._entered is None:
            return value
        kept = exp(-(now - self._entered.at) / SECOND / drift.time_constant)
        return restarted(value, self._entered.first, self._entered.jump, kept)
