"""How a receiver knows its place from time to time: by schedule, by chance, and where it is blind.

The states are those of the quality field of an NMEA 0183 GGA sentence: 4 fixed, 5 float, 1 single,
0 none.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from typing import Literal, Protocol

from numpy.random import Generator

from vehicles.car.dynamics import Body
from vehicles.messages import FixState
from vehicles.schedule import nanoseconds

ReceiverState = FixState | Literal["none"]
"""With "none" a receiver gives no fix."""
EVER = 2**63 - 1
"""An instant (ns) after every run: runs may begin up to the year 2200."""


@dataclass(frozen=True, slots=True)
class Sojourn:
    """A stay in one state of NMEA 0183, from an instant (ns) until before another one."""

    state: ReceiverState
    since: int
    until: int


class FixStates(Protocol):
    """Tells the state of NMEA 0183 that a receiver is in."""

    def at(self, now: int) -> Sojourn:
        """Stay at `now` (ns), which is not before what was asked last (NMEA 0183)."""
        ...


class StateSchedule:
    """States of NMEA 0183 by a list: `entries` are seconds after the start, and the state then."""

    def __init__(
        self, first: ReceiverState, entries: Sequence[tuple[float, ReceiverState]], start_at: int
    ) -> None:
        """`first` is the state before the first entry; entries are in order of time."""
        begins = [start_at, *(start_at + nanoseconds(at) for at, _ in entries)]
        states = [first, *(state for _, state in entries)]
        ends = [*begins[1:], EVER]
        # An entry at the start itself leaves nothing of what was before it.
        self._stays = [
            Sojourn(*one) for one in zip(states, begins, ends, strict=True) if one[1] < one[2]
        ]
        self._place = 0

    def at(self, now: int) -> Sojourn:
        """Stay at `now` (ns) by the list (NMEA 0183)."""
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
        """`random` is the chain's alone: one number per transition out of each state entered."""
        self._means = means
        self._random = random
        self._stay, self._next = self._entered(first, start_at)

    def at(self, now: int) -> Sojourn:
        """Stay at `now` (ns), which is not before what was asked last (NMEA 0183)."""
        while now >= self._stay.until:
            self._stay, self._next = self._entered(self._next, self._stay.until)
        return self._stay

    def _entered(self, state: ReceiverState, at: int) -> tuple[Sojourn, ReceiverState]:
        waits = [
            (nanoseconds(mean * self._random.standard_exponential()), following)
            for following, mean in self._means.get(state, {}).items()
        ]
        if not waits:
            return Sojourn(state, at, EVER), state
        wait, following = min(waits, key=lambda one: one[0])
        return Sojourn(state, at, at + max(wait, 1)), following


class ForcedStates:
    """States of NMEA 0183 by a law of their own, but while one is forced upon the receiver.

    The law goes on meanwhile, unseen.
    """

    def __init__(self, law: FixStates) -> None:
        """Without force `law` decides."""
        self._law = law
        self._forced: Sojourn | None = None

    def force(self, state: ReceiverState | None, since: int, until: int = EVER) -> None:
        """Let the state be this one from `since` until before `until` (ns); None ends it.

        Of NMEA 0183.
        """
        self._forced = None if state is None else Sojourn(state, since, until)

    def is_forced(self, now: int) -> bool:
        """Whether the state at `now` (ns) is not that of the law (NMEA 0183)."""
        return self._forced is not None and self._forced.since <= now < self._forced.until

    def at(self, now: int) -> Sojourn:
        """Stay at `now` (ns), forced or by the law (NMEA 0183)."""
        own = self._law.at(now)
        return self._forced if self._forced is not None and self.is_forced(now) else own


class Outage(Protocol):
    """Where or when nothing is received, as in a tunnel: state 0 of NMEA 0183."""

    def covers(self, body: Body, now: int) -> bool:
        """Whether the car is blind there, at `now` (ns) (NMEA 0183)."""
        ...


@dataclass(frozen=True, slots=True)
class TimeOutage:
    """Blind from an instant (ns) until before another one: state 0 of NMEA 0183."""

    since: int
    until: int

    def covers(self, body: Body, now: int) -> bool:  # noqa: ARG002 - everywhere
        """Whether it is that time (state 0 of NMEA 0183)."""
        return self.since <= now < self.until


@dataclass(frozen=True, slots=True)
class RoadOutage:
    """Blind on a stretch of road (m), by the way driven: state 0 of NMEA 0183.

    `behind` (m) is how far behind the zero of the stretch the car started.
    """

    begin: float
    end: float
    behind: float

    def covers(self, body: Body, now: int) -> bool:  # noqa: ARG002 - at any time
        """Whether the car is on that stretch (state 0 of NMEA 0183)."""
        return self.begin <= body.distance - self.behind < self.end


@dataclass(frozen=True, slots=True)
class BlindCircle:
    """Blind within a circle of the plane (m): state 0 of NMEA 0183."""

    east: float
    north: float
    radius: float

    def covers(self, body: Body, now: int) -> bool:  # noqa: ARG002 - at any time
        """Whether the car is in that circle (state 0 of NMEA 0183)."""
        return hypot(body.east - self.east, body.north - self.north) <= self.radius
