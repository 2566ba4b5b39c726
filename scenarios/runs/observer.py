"""Observers of a run: each receives the messages of the kinds that it wants, with their instants.

The log, the figures, the picture, the progress table and the limits of a run are observers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from transport.topics import TOPIC_OF
from vehicles.messages import Message

Kinds = frozenset[type[Message]]
Listen = Callable[[int, Message], None]
"""Takes the instant (ns) at which a message was sent or recorded, and the message."""
ALL_KINDS: Kinds = frozenset(TOPIC_OF)


class Observer(Protocol):
    """Receives the messages of a run in the order in which they are sent or recorded."""

    @property
    def kinds(self) -> Kinds:
        """Kinds of message to pass to `listen`; a virtual run builds no others."""
        ...

    def listen(self, at: int, message: Message, /) -> None:
        """Take a message and its instant (ns)."""
        ...


@dataclass(frozen=True, slots=True)
class OnMessage:
    """A function as an observer."""

    listen: Listen
    kinds: Kinds = ALL_KINDS


def listeners_by_kind(observers: Sequence[Observer]) -> dict[type[Message], list[Listen]]:
    return {kind: [one.listen for one in observers if kind in one.kinds] for kind in TOPIC_OF}


def kinds_of(observers: Sequence[Observer]) -> Kinds:
    return frozenset[type[Message]]().union(*(one.kinds for one in observers))
