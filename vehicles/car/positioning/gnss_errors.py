"""What is wrong with a receiver's positions beside white noise.

Drift of each receiver and drift that all have in common, a constant bias, the errors of each fix
state, what is lost in outages, rounding, delay, and what the receiver says of all that. The drift
of carrier-phase receivers is a Gauss–Markov process (Hoffmann, 2020, takes two); the errors between
two receivers nearby are smaller than each one's, because satellites and atmosphere are the same.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import exp, sqrt
from typing import NamedTuple

from numpy.random import Generator

from vehicles.car.dynamics import Body
from vehicles.car.positioning.drift import GaussMarkov, begun, truncated
from vehicles.car.positioning.fix_states import FixStates, Outage, Sojourn
from vehicles.messages import FixState
from vehicles.schedule import SECOND

Streams = Callable[[str], Generator]
"""Gives the stream of random numbers of a purpose, always the same one for the same purpose."""


@dataclass(frozen=True, slots=True)
class Wander:
    """A first-order Gauss–Markov error: deviation per axis (m) and time constant (s)."""

    deviation: float = 0.0
    time_constant: float = 100.0


@dataclass(frozen=True, slots=True)
class StateErrors:
    """Errors of position while in one fix state: white noise (m, per axis), Gauss–Markov drift.

    With `entry_jump` (m) the drift begins anew when the state is entered, no further than that from
    0; else it goes on unseen while the receiver is in another state. The receiver says that its
    accuracy is the true deviation times `accuracy`.
    """

    white: float
    drift: Wander = Wander()
    entry_jump: float | None = None
    accuracy: float = 1.0


@dataclass(frozen=True, slots=True)
class Bias:
    """A constant error: drawn once with a deviation per axis (m), and given east and north (m).

    The zero of the Gauss–Markov drift, so to say.
    """

    deviation: float = 0.0
    east: float = 0.0
    north: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorModel:
    """All errors of a receiver's positions beside those of plain white noise (Gauss–Markov).

    `states` are the errors by fix state; `common` is shared by all receivers; positions are rounded
    to multiples of `quantum` (m), and known `latency` (ns) after they were measured.
    """

    states: Mapping[FixState, StateErrors]
    common: Wander = Wander()
    bias: Bias = Bias()
    quantum: float = 0.0
    latency: int = 0

    def deviation(self, state: FixState, *, shared: bool = True) -> float:
        """True standard deviation (m) per axis in a state, of independent Gauss–Markov parts.

        Without those that are `shared` by all receivers, that of one relative to another's zero.
        Rounding adds a twelfth of its square; a given bias is not known to anybody.
        """
        errors = self.states[state]
        variance = errors.white**2 + errors.drift.deviation**2 + self.bias.deviation**2
        variance += self.quantum**2 / 12.0 + (self.common.deviation**2 if shared else 0.0)
        return sqrt(variance)


class PositionError(NamedTuple):
    """Error of a position (m) but for white noise, that noise's deviation (m), and what is said.

    That is the state and the accuracy (m); the drift is a Gauss–Markov process.
    """

    east: float
    north: float
    white: float
    state: FixState
    accuracy: float


@dataclass(slots=True)
class _Entered:
    """Since when the drift began anew, where the stationary one was then, and where it began."""

    at: int
    first: tuple[float, float]
    jump: tuple[float, float]


@dataclass(slots=True)
class ReceiverErrors:
    """The errors of one receiver in one run, in order of time (Gauss–Markov)."""

    model: ErrorModel
    states: FixStates
    outages: Sequence[Outage]
    start_at: int
    own: Streams
    shared: Streams
    _drifts: dict[FixState, GaussMarkov] = field(default_factory=dict)
    _common: GaussMarkov | None = None
    _bias: tuple[float, float] = (0.0, 0.0)
    _stay: Sojourn | None = None
    _entered: _Entered | None = None
    _jumps: Generator = field(init=False)
    _begun: bool = False

    def __post_init__(self) -> None:
        """Draw the bias, and begin the paths."""
        model = self.model
        east, north = self.own("bias").standard_normal(2).tolist()
        bias = model.bias
        self._bias = bias.east + bias.deviation * east, bias.north + bias.deviation * north
        self._jumps = self.own("jump")
        if model.common.deviation > 0.0:
            stream = self.shared("drift")
            self._common = GaussMarkov(model.common.time_constant, self.start_at, stream)
        for state, errors in model.states.items():
            if errors.drift.deviation > 0.0:
                stream = self.own(f"drift {state}")
                path = GaussMarkov(errors.drift.time_constant, self.start_at, stream)
                self._drifts[state] = path

    def common_at(self, now: int) -> tuple[float, float]:
        """East and north (m) of the error that all receivers have at `now` (ns), Gauss–Markov."""
        if self._common is None:
            return 0.0, 0.0
        east, north = self._common.at(now)
        return self.model.common.deviation * east, self.model.common.deviation * north

    def at(self, body: Body, now: int) -> PositionError | None:
        """Error of a fix at `now` (ns) of the car there, None without a fix.

        The sum of bias, common and own Gauss–Markov drift.
        """
        stay = self.states.at(now)
        if stay.state == "none" or any(outage.covers(body, now) for outage in self.outages):
            self._stay, self._begun = None, True
            return None
        state, errors = stay.state, self.model.states[stay.state]
        own = self._drift(state, errors, stay, now)
        common = self.common_at(now)
        return PositionError(
            self._bias[0] + own[0] + common[0],
            self._bias[1] + own[1] + common[1],
            errors.white,
            state,
            errors.accuracy * self.model.deviation(state),
        )

    def rounded(self, coordinate: float) -> float:
        """Coordinate (m) to the nearest multiple of the quantum (IEEE 754)."""
        quantum = self.model.quantum
        return quantum * round(coordinate / quantum) if quantum else coordinate

    def _drift(
        self, state: FixState, errors: StateErrors, stay: Sojourn, now: int
    ) -> tuple[float, float]:
        """Own drift (m) in this state; it begins anew if the state was entered since."""
        path = self._drifts.get(state)
        deviation = errors.drift.deviation
        east, north = path.at(now) if path else (0.0, 0.0)
        value = deviation * east, deviation * north
        if stay != self._stay:
            # At the start nothing is entered: the receiver has been on for long.
            self._entered = None
            if self._begun and errors.entry_jump is not None:
                first, second = self._jumps.random(2).tolist()
                jump = truncated(deviation, errors.entry_jump, (first, second))
                self._entered = _Entered(now, value, jump)
            self._stay, self._begun = stay, True
        if self._entered is None:
            return value
        kept = exp(-(now - self._entered.at) / SECOND / errors.drift.time_constant)
        return begun(value, self._entered.first, self._entered.jump, kept)
