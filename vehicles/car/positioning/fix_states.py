"""Fix states of a receiver over time: by schedule or by chance.

The states are those of the quality field of an NMEA 0183 GGA sentence: 4 fixed, 5 float, 1 single,
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

ReceiverState = Literal["fixed", "float", "single", "none"]
"""With "none" a receiver gives no fix."""
NO_END: Final = 2**63 - 1
"""An instant (ns) after every run: runs may begin up to the year 2200."""


@dataclass(frozen=True, slots=True)
class StateInterval:
    """A stay in one state, from an instant (ns) until before another one."""

    state: ReceiverState
    since: int
    until: int


class FixStates(Protocol):
    """The fix states of a receiver over time."""

    def at(self, now: int) -> StateInterval:
        """Stay at `now` (ns), in order of time."""
        ...


class StateSchedule:
    """States by a list: `entries` are seconds after the start, and the state from then on."""

    def __init__(
        self, first: ReceiverState, entries: Sequence[tuple[float, ReceiverState]], start_at: int
    ) -> None:
        begins = [start_at, *(start_at + nanoseconds(at) for at, _ in entries)]
        states = [first, *(state for _, state in entries)]
        ends = [*begins[1:], NO_END]
        # Without stays of no length, as before an entry at the start.
        self._stays = [
            StateInterval(*one) for one in zip(states, begins, ends, strict=True) if one[1] < one[2]
        ]
        self._place = 0

    def at(self, now: int) -> StateInterval:
        while now >= self._stays[self._place].until:
            self._place += 1
        return self._stays[self._place]


class StateChain:
    """A Markov chain in continuous time: each transition has its own exponential waiting time.

    `means` (s) are by state and next state; of those that leave a state, the one that comes first
    is taken. So a stay is exponential, too, with the sum of the rates.
    """

    def __init__(
        self,
        first: ReceiverState,
        means: Mapping[ReceiverState, Mapping[ReceiverState, float]],
        start_at: int,
        random: Generator,
    ) -> None:
        """One number of `random` is drawn per transition out of each state entered."""
        self._means = means
        self._random = random
        self._stay, self._next = self._entered(first, start_at)

    def at(self, now: int) -> StateInterval:
        while now >= self._stay.until:
            self._stay, self._next = self._entered(self._next, self._stay.until)
        return self._stay

    def _entered(self, state: ReceiverState, at: int) -> tuple[StateInterval, ReceiverState]:
        waits = [
            (nanoseconds(mean * self._random.standard_exponential()), following)
            for following, mean in self._means.get(state, {}).items()
        ]
        if not waits:
            return StateInterval(state, at, NO_END), state
        wait, following = min(waits, key=lambda one: one[0])
        return StateInterval(state, at, at + max(wait, 1)), following


class ForcedStates:
    """States by a law, which continues in the background while a state is forced."""

    def __init__(self, law: FixStates) -> None:
        self._law = law
        self._forced: StateInterval | None = None

    def force(self, state: ReceiverState | None, since: int, until: int = NO_END) -> None:
        """Force a state from `since` until before `until` (ns); None ends it."""
        self._forced = None if state is None else StateInterval(state, since, until)

    def is_forced(self, now: int) -> bool:
        return self._forced is not None and self._forced.since <= now < self._forced.until

    def at(self, now: int) -> StateInterval:
        own = self._law.at(now)
        return self._forced if self._forced is not None and self.is_forced(now) else own


class FixStateLaw(ABC):
    """Settings of how the fix state changes: each subclass is a kind of `[gnss.fix_states]`."""

    __slots__ = ()

    @abstractmethod
    def begin(self, first: ReceiverState, context: ReceiverContext) -> FixStates:
        """States of a run that starts in the state `first`."""

    @abstractmethod
    def states(self) -> set[ReceiverState]:
        """States that it leads to."""

    @abstractmethod
    def problems(self, first: ReceiverState) -> Iterator[Problem]:
        """Yield keys that contradict others."""


@dataclass(frozen=True, slots=True)
class StateEntry:
    """The fix state from a time (s) after the start on."""

    at: Annotated[float, Setting("after the start", "s", 0, example=10.0)]
    state: Annotated[ReceiverState, Setting("from then on", example="float")]


@dataclass(frozen=True, slots=True)
class ScheduledStates(FixStateLaw):
    """Fix states by a list; before its first entry that of the receiver."""

    entries: Annotated[tuple[StateEntry, ...], Setting("in order of time", nonempty=True)]

    def begin(self, first: ReceiverState, context: ReceiverContext) -> FixStates:
        return StateSchedule(first, [(one.at, one.state) for one in self.entries], context.start_at)

    def states(self) -> set[ReceiverState]:
        return {one.state for one in self.entries}

    def problems(self, first: ReceiverState) -> Iterator[Problem]:
        at = -1.0
        for index, one in enumerate(self.entries):
            key = f"entries[{index}]"
            yield from must_exceed(f"{key}.at_s", one.at, at, "the one before")
            if one.state == first:
                yield f"{key}.state", f'given "{one.state}", which it is already'
            first, at = one.state, one.at


@dataclass(frozen=True, slots=True)
class Transition:
    """A transition of the fix state, after a time with an exponential law (mean in s)."""

    state: Annotated[ReceiverState, Setting("left", example="fixed")]
    to: Annotated[ReceiverState, Setting("entered", example="float")]
    mean: Annotated[float, Setting("time in between", "s", 0.01, 1e9, example=890.0)]


@dataclass(frozen=True, slots=True)
class ChainOfStates(FixStateLaw):
    """Fix states by a Markov chain, drawn for each vehicle; it begins in that of the receiver."""

    transitions: Annotated[tuple[Transition, ...], Setting("all that can occur", nonempty=True)]

    def begin(self, first: ReceiverState, context: ReceiverContext) -> FixStates:
        means: dict[ReceiverState, dict[ReceiverState, float]] = {}
        for one in self.transitions:
            means.setdefault(one.state, {})[one.to] = one.mean
        return StateChain(first, means, context.start_at, context.own_streams("states"))

    def states(self) -> set[ReceiverState]:
        return {one.to for one in self.transitions}

    def problems(self, first: ReceiverState) -> Iterator[Problem]:  # noqa: ARG002
        seen: set[tuple[ReceiverState, ReceiverState]] = set()
        for index, one in enumerate(self.transitions):
            key = f"transitions[{index}].to"
            if one.state == one.to:
                yield key, f'given "{one.to}", allowed another state than the one it leaves'
            elif (one.state, one.to) in seen:
                yield key, f'from "{one.state}" to "{one.to}" is given twice, allowed once'
            seen.add((one.state, one.to))


FIX_STATE_LAWS: Mapping[str, type[FixStateLaw]] = {
    "schedule": ScheduledStates,
    "chain": ChainOfStates,
}
"""Laws of the fix state by the `kind` of their table."""
