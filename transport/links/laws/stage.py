"""Stages: effects of the messages of a link on each other (queue, arrival in order).

The verdict depends on the surrounding messages, by their instants of sending and sizes, but not on
when bytes arrive from the bus. A stage takes messages in the order of their numbers and returns
each one as soon as its verdict is final.

Given all messages sent until an instant t, a stage decides about messages that begin to be sent, or
are removed from the queue, until t. None of them is visible before t + floor, where the floor is
the minimum latency of the link. At the tick at `now` the receiver therefore lets the stages decide
until now − floor. If the bus is faster than the floor, all messages sent until then have arrived,
and all that are visible by `now` are decided, on the wall clock as in virtual time. Slower messages
count as late.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol

from transport.links.laws.effect import TransmissionContext
from transport.reasons import DropReason

UNSENT: frozenset[str] = frozenset({"rate", "transmitter_off"})  # Do not enter a queue


@dataclass(frozen=True, slots=True)
class StagedMessage:
    """A message between stages: when it is visible (ns), and the reason if it is dropped.

    A dropped message has the instant at which it would have been visible.
    """

    context: TransmissionContext
    visible_at: int
    reason: DropReason | Literal[""] = ""


class Stage(Protocol):
    """State of a stage of one link."""

    def carry(self, arrived: Iterable[StagedMessage], until: int) -> list[StagedMessage]:
        """Add the messages sent until instant `until` (ns); returns those now decided."""


class StageLaw(Protocol):
    """Law of a stage; `key` is the key of a link that requests it."""

    key: ClassVar[str]

    def stage(self) -> Stage:
        """New, empty state."""

    def describe(self) -> str:
        """One line with units, without a full stop."""


@dataclass(frozen=True, slots=True)
class InOrder:
    """Messages wait until all earlier delivered messages are visible."""

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
        for message in arrived:
            visible_at = max(message.visible_at, self.latest)
            if not message.reason:
                self.latest = visible_at
            decided.append(StagedMessage(message.context, visible_at, message.reason))
        return decided
