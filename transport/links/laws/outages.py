"""When and where a link carries nothing: windows of time, stretches of road, circles, by chance.

Each is judged at the instant at which the message was sent, and by where both ends truly were then;
the delay on the way plays no part. Spans are half open: what lies at their end is outside again.
"""

from dataclasses import dataclass, field
from math import exp, hypot, inf
from typing import Literal

from transport.links.laws.effect import Draw, Passage, Whereabouts
from transport.reasons import DropReason
from vehicles.schedule import SECOND

Who = Literal["sender", "receiver", "either", "both"]
"""Which end has to be inside."""


@dataclass(frozen=True, slots=True)
class Extent:
    """From `start` to before `end`, and again each `every`; the unit is that of what is asked."""

    start: float
    end: float
    every: float = inf

    def holds(self, value: float) -> bool:
        """Whether a value lies in it; NaN does not."""
        if self.every < inf and value >= self.start:
            return (value - self.start) % self.every < self.end - self.start
        return self.start <= value < self.end

    def in_words(self, unit: str) -> str:
        """Say it with a unit."""
        again = f", again every {self.every:g} {unit}" if self.every < inf else ""
        return f"from {self.start:g} to {self.end:g} {unit}{again}"


class PlacedOutage:
    """Base of outages that depend on when or where: how many are lost, the law does not know."""

    __slots__ = ()

    @property
    def mean_loss_ratio(self) -> float | None:
        """Unknown beforehand."""
        return None

    @property
    def mean_burst_messages(self) -> float | None:
        """Unknown beforehand."""
        return None


@dataclass(frozen=True, slots=True)
class TimedOutage(PlacedOutage):
    """Drops what is sent in a span of ns since the run's `start_at` (ns), for a `reason`."""

    start: int
    end: int
    start_at: int
    every: int = 0
    reason: DropReason = "outage"

    @property
    def mean_loss_ratio(self) -> float | None:
        """The share of time, where it repeats."""
        return (self.end - self.start) / self.every if self.every else None

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop by the instant of sending; whole nanoseconds, so that bounds are exact."""
        since = passage.sent_at - self.start_at - self.start
        if self.every and since >= 0:
            since %= self.every
        return self.reason if 0 <= since < self.end - self.start else 0

    def in_words(self) -> str:
        """Say the span in s."""
        every = self.every / SECOND if self.every else inf
        span = Extent(self.start / SECOND, self.end / SECOND, every)
        return f"{self.reason.replace('_', ' ')} {span.in_words('s')}"


@dataclass(frozen=True, slots=True)
class StretchOutage(PlacedOutage):
    """Drops what is sent while `who` is on a stretch of the road (m).

    The stations are those of the ends when the run starts; the metres driven are added.
    """

    stretch: Extent
    who: Who
    sender_station: float
    receiver_station: float

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop by the ends' stations."""
        sender = self.stretch.holds(self.sender_station + passage.sender.driven)
        receiver = self.stretch.holds(self.receiver_station + passage.receiver.driven)
        return "outage" if _inside(self.who, sender, receiver) else 0

    def in_words(self) -> str:
        """Say stretch and ends."""
        return f"outage with {self.who} on the road {self.stretch.in_words('m')}"


@dataclass(frozen=True, slots=True)
class CircleOutage(PlacedOutage):
    """Drops what is sent while `who` is within `radius` of a place in the plane (m)."""

    east: float
    north: float
    radius: float
    who: Who

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop by the ends' places."""
        sender, receiver = self._holds(passage.sender), self._holds(passage.receiver)
        return "outage" if _inside(self.who, sender, receiver) else 0

    def _holds(self, place: Whereabouts) -> bool:
        return hypot(place.east - self.east, place.north - self.north) < self.radius

    def in_words(self) -> str:
        """Say circle and ends."""
        where = f"{self.radius:g} m of east {self.east:g} m, north {self.north:g} m"
        return f"outage with {self.who} within {where}"


BY_CELL = "outage"
"""Begins the purposes of draws whose number is that of a cell of time, not of a message."""
REMEMBERED = 8
"""Cells of a random outage whose draws are kept."""


@dataclass(frozen=True, slots=True)
class RandomOutage:
    """Drops what is sent while the link is off; on and off last exponential times of given means.

    That is a Markov chain of two states, and it is found at any instant without its history: at
    the instants of a Poisson process, of rate 1/mean on + 1/mean off, the state is drawn anew,
    off with the long-run share of it, whatever it was (uniformisation: Jensen 1953). So the state
    is that of the last such instant, and stationary from the start. Time is cut into cells of
    about one instant each, whose number, places and states are keyed draws of the cell's number.

    All in ns; `purpose` is the word of its draws, its own among the outages of a link.
    """

    mean_on: int
    mean_off: int
    start_at: int
    purpose: str = BY_CELL
    cell: int = field(init=False, repr=False, compare=False)
    _cells: dict[int, tuple[tuple[int, bool], ...]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _owner: list[Draw] = field(default_factory=list, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Make a cell as long as the mean time from one instant of the process to the next."""
        mean = self.mean_on * self.mean_off / (self.mean_on + self.mean_off)
        object.__setattr__(self, "cell", max(round(mean), 1))

    @property
    def mean_loss_ratio(self) -> float:
        """The share of time that is off."""
        return self.mean_off / (self.mean_on + self.mean_off)

    @property
    def mean_burst_messages(self) -> None:
        """Depends on how often messages are sent."""
        return

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:
        """Drop if the link is off at the instant of sending."""
        return "outage" if self.is_off(draw, passage.sent_at - self.start_at) else 0

    def is_off(self, draw: Draw, since: int) -> bool:
        """Whether the link is off so many ns after the start."""
        if not self._owner or self._owner[0] is not draw:
            self._cells.clear()
            self._owner[:] = [draw]
        cell = since // self.cell
        while True:
            before = [one for one in self._instants(draw, cell) if one[0] <= since]
            if before:
                return max(before)[1]
            cell -= 1

    def _instants(self, draw: Draw, cell: int) -> tuple[tuple[int, bool], ...]:
        """Instants of one cell, each with whether the link is off from then on."""
        known = self._cells.get(cell)
        if known is None:
            length, off = self.cell, self.mean_loss_ratio
            count = _poisson(draw(f"{self.purpose} count", cell), length * self._rate)
            known = tuple(
                (
                    cell * length + int(draw(f"{self.purpose} at {k}", cell) * length),
                    draw(f"{self.purpose} off {k}", cell) < off,
                )
                for k in range(count)
            )
            self._cells[cell] = known
            if len(self._cells) > REMEMBERED:
                del self._cells[next(iter(self._cells))]
        return known

    @property
    def _rate(self) -> float:
        return 1.0 / self.mean_on + 1.0 / self.mean_off

    def in_words(self) -> str:
        """Say both means in s."""
        on, off = self.mean_on / SECOND, self.mean_off / SECOND
        return f"random outage, on for {on:g} s and off for {off:g} s on average"


def _inside(who: Who, sender: bool, receiver: bool) -> bool:
    if who == "either":
        return sender or receiver
    if who == "both":
        return sender and receiver
    return sender if who == "sender" else receiver


def _poisson(probability: float, mean: float) -> int:
    """The Poisson number at a probability: the first whose cumulative probability is above it."""
    count, term = 0, exp(-mean)
    total = term
    while probability >= total and term > 0.0:
        count += 1
        term *= mean / count
        total += term
    return count
