"""What messages of one link do to one another: a queue of bounded rate, and arrival in order.

These are no effects: the verdict on a message depends on the messages around it, so it is a
function of the link and of the stream that was sent, by instants of sending and sizes, and not of
when bytes came. A stage is given the messages in the order of their numbers, and gives each of them
back as soon as its fate is known.

That the wall clock and virtual time agree follows from the floor, the least latency of the link.
A stage that has received all that was sent until an instant t decides what no later message can
change: a message that begins to be sent until t, or is thrown out by one sent until t. Neither can
be visible before t + floor. So a receiver lets the stages decide, at its tick at `now`, until now −
floor. All that was sent until then has come if the wire keeps below the floor, and all that becomes
visible until `now` is decided. What the wire brings later than that counts as late.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol

from transport.links.laws.effect import TransmissionContext
from transport.reasons import DropReason

UNSENT: frozenset[str] = frozenset({"rate", "transmitter_off"})
"""Reasons of effects that keep a message from being sent at all: it takes no turn in a queue."""


@dataclass(frozen=True, slots=True)
class StagedMessage:
    """A message between the stages: when it will be visible (ns), and why it is dropped if it is.

    One that is dropped has the instant at which the receiver would have had it.
    """

    context: TransmissionContext
    visible_at: int
    reason: DropReason | Literal[""] = ""


class Stage(Protocol):
    """The state of one link behind its effects; for one run."""

    def carry(self, arrived: Iterable[StagedMessage], until: int) -> list[StagedMessage]:
        """Take in the messages sent until instant `until` (ns); give those now decided."""


class StageLaw(Protocol):
    """What a stage does; `key` is the key of the link that requests it."""

    key: ClassVar[str]

    def stage(self) -> Stage:
        """Begin it, empty."""

    def describe(self) -> str:
        """Describe it in one line without a full stop, with units."""


@dataclass(frozen=True, slots=True)
class InOrder:
    """No message is visible before one that was sent earlier and is delivered: it waits for it."""

    key: ClassVar[str] = "delay"

    def stage(self) -> Stage:
        return _Order()

    def describe(self) -> str:
        return "in order"


@dataclass(slots=True)
class _Order:
    latest: int = 0

    def carry(self, arrived: Iterable[StagedMessage], until: int) -> list[StagedMessage]:
        decided = []
        for one in arrived:
            visible_at = max(one.visible_at, self.latest)
            if not one.reason:
                self.latest = visible_at
            decided.append(StagedMessage(one.context, visible_at, one.reason))
        return decided
