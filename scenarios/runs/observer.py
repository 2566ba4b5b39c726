"""Observers of a run: each receives the messages of the kinds that it wants, with their instants.

The log, the figures, the picture, the progress table and the limits of a run are observers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from transport.topics import TOPIC_OF
from vehicles.messages import Change, LogText, Message, RunEnd, RunStart

Kinds = frozenset[type[Message]]
Listen = Callable[[int, Message], None]
"""Takes the instant (ns) at which a message was sent or recorded, and the message."""
ALL_KINDS: Kinds = frozenset(TOPIC_OF)
ALWAYS = (Change, LogText, RunEnd, RunStart)
"""Few messages, needed to understand the others."""


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


class ThrottledObservers:
    """Observer that passes messages to others, but only a few while the log is behind.

    So a slow picture loses messages; the log never does.
    """

    def __init__(self, observers: Sequence[Observer], is_behind: Callable[[], bool]) -> None:
        """`is_behind` returns whether too many messages wait to be recorded."""
        self._listeners = listeners_by_kind(observers)
        self.kinds = kinds_of(observers)
        """Messages that at least one observer wants."""
        self._is_behind = is_behind
        self.skipped = 0
        """Number of messages not passed on."""

    def listen(self, at: int, message: Message) -> None:
        listeners = self._listeners[type(message)]
        if not listeners:
            return
        if self._is_behind() and not isinstance(message, ALWAYS):
            self.skipped += 1
            return
        for listener in listeners:
            listener(at, message)

    def skipped_line(self) -> str:
        """Report the number of skipped messages; empty without any."""
        if not self.skipped:
            return ""
        return (
            f"the picture and the progress leave out {self.skipped} messages, which the log has: "
            "there was no time for them"
        )
