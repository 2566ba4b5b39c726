"""Position errors that are added to those of the fix state, one table of `[gnss]` each."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Final, Literal, Protocol

import numpy as np
from numpy.random import Generator

from vehicles.car.dynamics import Body
from vehicles.schedule import MILLISECOND, SECOND, nanoseconds
from vehicles.setting import Problem, Setting, must_exceed

Streams = Callable[[str], Generator]  # Random stream of a purpose, always the same


@dataclass(frozen=True, slots=True)
class ReceiverContext:
    """What the errors of one receiver need at the start of a run.

    start_at              start of the run (ns)
    distance_behind_lead  initial distance behind the lead (m)
    own_streams           returns the NumPy generator of this receiver for a purpose
    shared_streams        returns the generator that all receivers share
    """

    start_at: int
    distance_behind_lead: float
    own_streams: Streams
    shared_streams: Streams

    def for_entry(self, index: int) -> "ReceiverContext":
        """Context of an entry of a list, with random streams of its own."""
        own, shared = self.own_streams, self.shared_streams
        return replace(
            self,
            own_streams=lambda purpose: own(f"errors {index} {purpose}"),
            shared_streams=lambda purpose: shared(f"errors {index} {purpose}"),
        )


class ErrorProcess(Protocol):
    """A position error over one run; calls must be in order of time."""

    def at(self, body: Body, now: int) -> tuple[float, float]:
        """East and north (m) of the error at `now` (ns).

        `body` is the true state of the car: `east`, `north` (m), `yaw` (rad), `speed` (m/s),
        `distance` driven (m).
        """
        ...


class ErrorTerm(ABC):
    """Settings of a position error: a frozen dataclass whose fields are its parameters.

    `begin(context)` returns the error over a run, an object with the method `at` of `ErrorProcess`.
    Random numbers come only from the streams of the context, so that the same seed gives the same
    run. Followers assume the `variance`.
    """

    __slots__ = ()

    shared: ClassVar[bool] = False
    """Whether all receivers share the error, so that it cancels between vehicles."""

    @property
    @abstractmethod
    def variance(self) -> float:
        """Variance (m²) per axis of the random part."""

    @abstractmethod
    def begin(self, context: ReceiverContext) -> ErrorProcess:
        """Draw the random numbers of a run."""


@dataclass(frozen=True, slots=True)
class Bias(ErrorTerm):
    """A constant error: a configured offset plus a random one per vehicle (m)."""

    deviation: Annotated[float, Setting("of the random part, per axis", "m", 0, 1000)] = 0.0
    east: Annotated[float, Setting("configured part, east", "m", -1000, 1000)] = 0.0
    north: Annotated[float, Setting("configured part, north", "m", -1000, 1000)] = 0.0

    @property
    def variance(self) -> float:
        return self.deviation**2

    def begin(self, context: ReceiverContext) -> ErrorProcess:
        east, north = context.own_streams("bias").standard_normal(2).tolist()
        return replace(
            self, east=self.east + self.deviation * east, north=self.north + self.deviation * north
        )

    def at(self, body: Body, now: int) -> tuple[float, float]:
        return self.east, self.north


# ---- Drifting errors: a first-order Gauss–Markov process in two axes, independent of the rate
#
# The process is defined on a grid of 10 ms from the start of the run, and constant in between. So
# its statistics do not depend on the rate of measurements. Receivers that measure at the same
# instant, in any operating-system process, get bit-identical values.


GRID = 10 * MILLISECOND  # Grid spacing (ns); automotive receivers measure at 20 Hz at most
BLOCK = 512  # Number of points computed at once


@dataclass(frozen=True, slots=True)
class Drift:
    """First-order Gauss–Markov drift: standard deviation (m, per axis), and time constant (s).

    The time constant is at least 0.1 s: below it the grid is too coarse.
    """

    deviation: Annotated[float, Setting("deviation, per axis", "m", 0, 1000, example=0.016)]
    time_constant: Annotated[float, Setting("time constant", "s", 0.1, 100_000)] = 100.0


class GaussMarkov:
    """A stationary first-order Gauss–Markov process in two axes, the course of a drift.

    Exact discretisation: x[k] = r x[k-1] + sqrt(1 - r²) w[k] with r = exp(-grid / time constant)
    and white Gaussian w. The autocorrelation at lag t is exp(-t / time constant).
    """

    def __init__(self, drift: Drift, start_at: int, random: Generator) -> None:
        """Begin `drift` at `start_at` (ns)."""
        rate = GRID / SECOND / drift.time_constant
        steps = range(1, BLOCK + 1)
        # NumPy's exp is not used, as its last bit depends on the processor.
        self._kept = np.array([math.exp(-rate * k) for k in steps])
        spread = math.sqrt(-math.expm1(-2.0 * rate))
        self._scaled = np.array([spread * math.exp(rate * k) for k in steps])
        self._drift, self._start_at, self._random = drift, start_at, random
        self._jump: tuple[int, float, float] | None = None
        self._before = random.standard_normal(2)
        self._first, self._east, self._north = 0, *([one] for one in self._before.tolist())

    def at(self, body: Body, now: int) -> tuple[float, float]:
        """East and north (m) at `now` (ns); calls must be in order of time."""
        index = (now - self._start_at) // GRID - self._first
        while index >= len(self._east):  # the recursion as a cumulative sum of scaled terms
            index -= len(self._east)
            self._first += len(self._east)
            drawn = self._random.standard_normal((2, BLOCK))
            path = self._kept * (self._before[:, None] + np.cumsum(self._scaled * drawn, axis=1))
            self._before = path[:, -1]
            self._east, self._north = path.tolist()
        deviation, jump = self._drift.deviation, self._jump
        east, north = deviation * self._east[index], deviation * self._north[index]
        if jump is None:
            return east, north
        kept = math.exp(-(now - jump[0]) / SECOND / self._drift.time_constant)
        return east + kept * jump[1], north + kept * jump[2]

    def restart(self, body: Body, now: int, radius: float, random: Generator) -> None:
        """Restart within `radius` (m) of 0 at `now` (ns); the change decays exponentially."""
        self._jump = None
        east, north = self.at(body, now)
        first, second = random.random(2).tolist()
        to_east, to_north = draw_truncated(self._drift.deviation, radius, (first, second))
        self._jump = now, to_east - east, to_north - north


def draw_truncated(
    deviation: float, radius: float, draws: tuple[float, float]
) -> tuple[float, float]:
    """Draw a normal position (m), truncated to a circle of `radius` (m) around 0.

    `deviation` (m) is the standard deviation per axis, `draws` are uniform in [0, 1). Inverts the
    distribution function of Rayleigh's distribution.
    """
    if deviation <= 0.0 or radius <= 0.0:
        return 0.0, 0.0
    probability = -math.expm1(-0.5 * (radius / deviation) ** 2)
    far = deviation * math.sqrt(-2.0 * math.log1p(-draws[0] * probability))
    distance, angle = min(far, radius), 2.0 * math.pi * draws[1]
    return distance * math.cos(angle), distance * math.sin(angle)


@dataclass(frozen=True, slots=True)
class CommonDrift(Drift, ErrorTerm):
    """Drift shared by all receivers (satellites, atmosphere); it keeps distances between cars."""

    shared = True

    @property
    def variance(self) -> float:
        return self.deviation**2

    def begin(self, context: ReceiverContext) -> ErrorProcess:
        return GaussMarkov(self, context.start_at, context.shared_streams("drift"))


# ---- Times and places without a fix, as in a tunnel: state 0 of NMEA 0183


FAR = 1_000_000  # Limit (m) of coordinates and distances in scenario files


@dataclass(frozen=True, slots=True)
class FixOutageWindow:
    """No fix between two times after the start of the run."""

    begin: Annotated[int, Setting("start, inclusive", "s", 0, 86_400, name="from", example=20.0)]
    end: Annotated[int, Setting("end, exclusive", "s", 0, 86_400, name="to", example=25.0)]

    def covers(self, body: Body, now: int, context: ReceiverContext) -> bool:
        """Whether the receiver has no fix at `now` (ns), with the car in state `body`."""
        return self.begin <= now - context.start_at < self.end

    def problems(self) -> Iterator[Problem]:
        yield from must_exceed("to_s", self.end / SECOND, self.begin / SECOND)


@dataclass(frozen=True, slots=True)
class FixOutageStretch:
    """No fix on a stretch of road, by arc length from the lead's start; it continues over laps.

    Outages of [links] are by arc length from the first point of the path instead.
    """

    begin: Annotated[float, Setting("start, inclusive", "m", -FAR, FAR, name="from", example=300.0)]
    end: Annotated[float, Setting("end, exclusive", "m", -FAR, FAR, name="to", example=400.0)]

    def covers(self, body: Body, now: int, context: ReceiverContext) -> bool:
        return self.begin <= body.distance - context.distance_behind_lead < self.end

    def problems(self) -> Iterator[Problem]:
        yield from must_exceed("to_m", self.end, self.begin)


@dataclass(frozen=True, slots=True)
class FixOutageCircle:
    """No fix within a circle in the plane."""

    east: Annotated[float, Setting("centre, east", "m", -FAR, FAR, example=500.0)]
    north: Annotated[float, Setting("centre, north", "m", -FAR, FAR, example=0.0)]
    radius: Annotated[float, Setting("radius", "m", above=0, maximum=FAR, example=40.0)]

    def covers(self, body: Body, now: int, context: ReceiverContext) -> bool:
        return math.hypot(body.east - self.east, body.north - self.north) <= self.radius

    def problems(self) -> Iterator[Problem]:
        yield from ()


FixOutage = FixOutageWindow | FixOutageStretch | FixOutageCircle
OUTAGES: Mapping[str, type[FixOutage]] = {
    "time": FixOutageWindow,
    "road": FixOutageStretch,
    "circle": FixOutageCircle,
}


# ---- Fix states of a receiver over time, by schedule or random
#
# They correspond to the quality field of an NMEA 0183 GGA sentence: 4 fixed, 5 float, 1 single,
# 0 none.


ReceiverState = Literal["fixed", "float", "single", "none"]  # "none": without a fix
NO_END: Final = 2**63 - 1  # An instant (ns) after every run: runs may start up to the year 2200


@dataclass(frozen=True, slots=True)
class StateInterval:
    """A state from the instant `since` (ns) to `until` (ns), excluded."""

    state: ReceiverState
    since: int
    until: int


@dataclass(frozen=True, slots=True)
class StateEntry:
    """The fix state from `at_s` on."""

    at: Annotated[float, Setting("time after the start of the run", "s", 0, example=10.0)]
    state: Annotated[ReceiverState, Setting("state from then on", example="float")]


@dataclass(frozen=True, slots=True)
class ScheduledStates:
    """Listed fix states; before the first entry, the state is `gnss.fix`."""

    entries: Annotated[tuple[StateEntry, ...], Setting("states in order of time", nonempty=True)]

    def intervals(self, first: ReceiverState, context: ReceiverContext) -> Iterator[StateInterval]:
        """Yield the states of a run that starts in the state `first`; the last has no end."""
        state, since = first, context.start_at
        for entry in self.entries:
            until = context.start_at + nanoseconds(entry.at)
            if since < until:  # an entry at the start leaves no time for the first state
                yield StateInterval(state, since, until)
            state, since = entry.state, until
        yield StateInterval(state, since, NO_END)

    def states(self) -> set[ReceiverState]:
        return {entry.state for entry in self.entries}

    def problems(self, first: ReceiverState) -> Iterator[Problem]:
        at = -1.0
        for index, entry in enumerate(self.entries):
            key = f"entries[{index}]"
            yield from must_exceed(f"{key}.at_s", entry.at, at, "the previous entry")
            if entry.state == first:
                yield f"{key}.state", f'given "{entry.state}", which is already the state'
            first, at = entry.state, entry.at


@dataclass(frozen=True, slots=True)
class Transition:
    """A transition of the fix state, after an exponentially distributed time (mean in s)."""

    state: Annotated[ReceiverState, Setting("state before", example="fixed")]
    to: Annotated[ReceiverState, Setting("state after", example="float")]
    mean: Annotated[float, Setting("mean time in the state", "s", 0.01, 1e9, example=890.0)]


@dataclass(frozen=True, slots=True)
class ChainOfStates:
    """Fix states by a Markov chain, random for each vehicle; the first state is `gnss.fix`.

    Each transition has an exponential waiting time, and the earliest one out of a state is taken.
    So the time in a state is also exponential, with the sum of the rates.
    """

    transitions: Annotated[tuple[Transition, ...], Setting("all transitions", nonempty=True)]

    def intervals(self, first: ReceiverState, context: ReceiverContext) -> Iterator[StateInterval]:
        random, state, since = context.own_streams("states"), first, context.start_at
        while waits := [
            (nanoseconds(each.mean * random.standard_exponential()), each.to)
            for each in self.transitions
            if each.state == state
        ]:
            wait, following = min(waits, key=lambda candidate: candidate[0])
            yield StateInterval(state, since, until := since + max(wait, 1))
            state, since = following, until
        yield StateInterval(state, since, NO_END)

    def states(self) -> set[ReceiverState]:
        return {transition.to for transition in self.transitions}

    def problems(self, first: ReceiverState) -> Iterator[Problem]:
        pairs = [(each.state, each.to) for each in self.transitions]
        for index, (state, to) in enumerate(pairs):
            key = f"transitions[{index}].to"
            if state == to:
                yield key, f'given "{to}", allowed another state'
            elif (state, to) in pairs[:index]:
                yield key, f'from "{state}" to "{to}" is given twice, allowed once'


FixStateLaw = ScheduledStates | ChainOfStates
FIX_STATE_LAWS: Mapping[str, type[FixStateLaw]] = {
    "schedule": ScheduledStates,
    "chain": ChainOfStates,
}
