"""Fix states of a receiver over time, by schedule or random.

They correspond to the quality field of an NMEA 0183 GGA sentence: 4 fixed, 5 float, 1 single,
0 none.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Final, Literal, Protocol

from numpy.random import Generator

from vehicles.car.positioning.error_term import ReceiverContext
from vehicles.schedule import nanoseconds
from vehicles.setting import Problem, Setting, must_exceed

ReceiverState = Literal["fixed", "float", "single", "none"]  # "none": without a fix
NO_END: Final = 2**63 - 1  # An instant (ns) after every run: runs may start up to the year 2200


@dataclass(frozen=True, slots=True)
class StateInterval:
    """A state from the instant `since` (ns) to `until` (ns), excluded."""

    state: ReceiverState
    since: int
    until: int


class FixStates(Protocol):
    """The fix states of a receiver over time."""

    def at(self, now: int) -> StateInterval:
        """State at `now` (ns); calls must be in order of time."""
        ...


class StateSchedule:
    """Listed states: each entry has a time (s) after the start, and the state from then on."""

    def __init__(
        self, first: ReceiverState, entries: Sequence[tuple[float, ReceiverState]], start_at: int
    ) -> None:
        begins = [start_at, *(start_at + nanoseconds(at) for at, _ in entries)]
        states = [first, *(state for _, state in entries)]
        ends = [*begins[1:], NO_END]
        self._intervals = [
            StateInterval(state, begin, end)
            for state, begin, end in zip(states, begins, ends, strict=True)
            if begin < end  # an entry at the start leaves no time for the first state
        ]
        self._index = 0

    def at(self, now: int) -> StateInterval:
        while now >= self._intervals[self._index].until:
            self._index += 1
        return self._intervals[self._index]


class StateChain:
    """A continuous-time Markov chain: each transition has an exponential waiting time.

    `means` (s) are by state and next state. The earliest transition out of a state is taken, so
    the time in a state is also exponential, with the sum of the rates.
    """

    def __init__(
        self,
        first: ReceiverState,
        means: Mapping[ReceiverState, Mapping[ReceiverState, float]],
        start_at: int,
        random: Generator,
    ) -> None:
        """Draw one number per transition out of each entered state."""
        self._means = means
        self._random = random
        self._current, self._next = self._enter(first, start_at)

    def at(self, now: int) -> StateInterval:
        while now >= self._current.until:
            self._current, self._next = self._enter(self._next, self._current.until)
        return self._current

    def _enter(self, state: ReceiverState, at: int) -> tuple[StateInterval, ReceiverState]:
        waits = [
            (nanoseconds(mean * self._random.standard_exponential()), following)
            for following, mean in self._means.get(state, {}).items()
        ]
        if not waits:
            return StateInterval(state, at, NO_END), state
        wait, following = min(waits, key=lambda candidate: candidate[0])
        return StateInterval(state, at, at + max(wait, 1)), following


class ForcedStates:
    """States by a law, which continues in the background while a state is forced by hand."""

    def __init__(self, law: FixStates) -> None:
        self._law = law
        self._forced: StateInterval | None = None

    def force(self, state: ReceiverState | None, since: int, until: int = NO_END) -> None:
        """Force a state from `since` (ns) to `until`, excluded; None ends it."""
        self._forced = None if state is None else StateInterval(state, since, until)

    def is_forced(self, now: int) -> bool:
        return self._forced is not None and self._forced.since <= now < self._forced.until

    def at(self, now: int) -> StateInterval:
        own = self._law.at(now)
        return self._forced if self._forced is not None and self.is_forced(now) else own


class FixStateLaw(ABC):
    """Settings of a sequence of fix states: each subclass is a kind of `[gnss.fix_states]`."""

    __slots__ = ()

    @abstractmethod
    def begin(self, first: ReceiverState, context: ReceiverContext) -> FixStates:
        """Return the states of a run that starts in the state `first`."""

    @abstractmethod
    def states(self) -> set[ReceiverState]:
        """States that can be entered."""

    @abstractmethod
    def problems(self, first: ReceiverState) -> Iterator[Problem]:
        """Yield keys that contradict others."""


@dataclass(frozen=True, slots=True)
class StateEntry:
    """The fix state from `at_s` on."""

    at: Annotated[float, Setting("time after the start of the run", "s", 0, example=10.0)]
    state: Annotated[ReceiverState, Setting("state from then on", example="float")]


@dataclass(frozen=True, slots=True)
class ScheduledStates(FixStateLaw):
    """Listed fix states; before the first entry, the state is `gnss.fix`."""

    entries: Annotated[tuple[StateEntry, ...], Setting("states in order of time", nonempty=True)]

    def begin(self, first: ReceiverState, context: ReceiverContext) -> FixStates:
        entries = [(entry.at, entry.state) for entry in self.entries]
        return StateSchedule(first, entries, context.start_at)

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
class ChainOfStates(FixStateLaw):
    """Fix states by a Markov chain, random for each vehicle; the first state is `gnss.fix`."""

    transitions: Annotated[
        tuple[Transition, ...], Setting("all transitions of the chain", nonempty=True)
    ]

    def begin(self, first: ReceiverState, context: ReceiverContext) -> FixStates:
        means: dict[ReceiverState, dict[ReceiverState, float]] = {}
        for transition in self.transitions:
            means.setdefault(transition.state, {})[transition.to] = transition.mean
        return StateChain(first, means, context.start_at, context.own_streams("states"))

    def states(self) -> set[ReceiverState]:
        return {transition.to for transition in self.transitions}

    def problems(self, first: ReceiverState) -> Iterator[Problem]:
        seen: set[tuple[ReceiverState, ReceiverState]] = set()
        for index, transition in enumerate(self.transitions):
            key = f"transitions[{index}].to"
            pair = transition.state, transition.to
            if transition.state == transition.to:
                yield key, f'given "{transition.to}", allowed another state'
            elif pair in seen:
                yield key, f'from "{pair[0]}" to "{pair[1]}" is given twice, allowed once'
            seen.add(pair)


FIX_STATE_LAWS: Mapping[str, type[FixStateLaw]] = {
    "schedule": ScheduledStates,
    "chain": ChainOfStates,
}
