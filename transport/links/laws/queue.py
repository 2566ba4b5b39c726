"""What messages of one link do to one another: a queue of bounded rate, and arrival in order.

These are no effects: the verdict on a message depends on the messages around it, so it is a
function of the link and of the stream that was sent, by instants of sending and sizes, and not of
when bytes came. A stage is given the messages in the order of their numbers, and gives each of them
back as soon as its fate is known.

That the wall clock and virtual time agree follows from the floor, the least latency of the link.
A stage that has been told of all that was sent until an instant t decides what no later message can
change: a message that begins to be sent until t, or is thrown out by one sent until t. Neither can
be visible before t + floor. So a receiver lets the stages decide, at its tick at `now`, until now −
floor. All that was sent until then has come if the wire keeps below the floor, and all that becomes
visible until `now` is decided. What the wire brings later than that counts as late.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal, Protocol

from transport.links.laws.effect import Passage
from transport.reasons import DropReason
from vehicles.schedule import SECOND

UNSENT: frozenset[str] = frozenset({"rate", "transmitter_off"})
"""Reasons of effects that keep a message from being sent at all: it takes no turn in a queue."""


@dataclass(frozen=True, slots=True)
class Carried:
    """A message between the stages: when it will be visible (ns), and why it is dropped if it is.

    One that is dropped has the instant at which the receiver would have had it.
    """

    passage: Passage
    visible_at: int
    reason: DropReason | Literal[""] = ""


class Stage(Protocol):
    """The state of one link behind its effects; for one run."""

    def carry(self, arrived: Iterable[Carried], until: int) -> list[Carried]:
        """Take in the messages sent until instant `until` (ns); give those now decided."""


class StageLaw(Protocol):
    """What a stage does."""

    def stage(self) -> Stage:
        """Begin it, empty."""

    def in_words(self) -> str:
        """Say it in one line without a full stop, with units."""


@dataclass(frozen=True, slots=True)
class Queue:
    """A sender that sends `rate` bytes a second, first come first served, with `depth` waiting.

    A message takes its size over the rate to be sent, and what comes meanwhile waits. If `depth`
    wait already, the new one is dropped, or the one that has waited longest. What is being sent is
    not among those that wait. A message that is lost on its way has taken its turn all the same.
    """

    rate: float
    depth: int
    drop: Literal["newest", "oldest"] = "newest"

    def service(self, size: int) -> int:
        """Time in ns that `size` bytes take."""
        return round(size * SECOND / self.rate)

    def stage(self) -> Stage:
        """Begin with nothing to send."""
        return _Sender(self)

    def in_words(self) -> str:
        """Say all three."""
        return f"queue of {self.depth} messages at {self.rate:g} bytes/s, drops the {self.drop}"


@dataclass(slots=True)
class _Sender:
    """A queue in use: when the sender is free (ns), and who waits."""

    law: Queue
    free_at: int = 0
    waiting: deque[Carried] = field(default_factory=deque)

    def carry(self, arrived: Iterable[Carried], until: int) -> list[Carried]:
        """Send what can begin to be sent until each arrival, and until `until`.

        Of a message that arrives as another ends, the one that waits comes first.
        """
        decided: list[Carried] = []
        for one in arrived:
            self._send(one.passage.sent_at, decided)
            self._join(one, decided)
        self._send(until, decided)
        return decided

    def _send(self, until: int, decided: list[Carried]) -> None:
        while self.waiting:
            first = self.waiting[0]
            begins_at = max(self.free_at, first.passage.sent_at)
            if begins_at > until:
                return
            self.waiting.popleft()
            self.free_at = begins_at + self.law.service(first.passage.size)
            longer = self.free_at - first.passage.sent_at
            decided.append(Carried(first.passage, first.visible_at + longer, first.reason))

    def _join(self, one: Carried, decided: list[Carried]) -> None:
        if one.reason in UNSENT:
            decided.append(one)
            return
        # If the sender is free nobody waits: whoever could begin by now has begun.
        if self.free_at > one.passage.sent_at and len(self.waiting) >= self.law.depth:
            out = one
            if self.law.drop == "oldest":
                out = self.waiting.popleft()
                self.waiting.append(one)
            waited = one.passage.sent_at - out.passage.sent_at
            decided.append(Carried(out.passage, out.visible_at + waited, out.reason or "queue"))
        else:
            self.waiting.append(one)


@dataclass(frozen=True, slots=True)
class InOrder:
    """No message is visible before one that was sent earlier and is delivered: it waits for it."""

    def stage(self) -> Stage:
        """Begin."""
        return _Order()

    def in_words(self) -> str:
        """Say it."""
        return "in order"


@dataclass(slots=True)
class _Order:
    latest: int = 0

    def carry(self, arrived: Iterable[Carried], until: int) -> list[Carried]:  # noqa: ARG002
        """Hold each back for those before it, which are known."""
        decided = []
        for one in arrived:
            visible_at = max(one.visible_at, self.latest)
            if not one.reason:
                self.latest = visible_at
            decided.append(Carried(one.passage, visible_at, one.reason))
        return decided
