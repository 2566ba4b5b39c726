"""Observers of a run: each receives the messages of the kinds that it wants, with their instants.

The log, the figures, the picture, the progress table and the limits of a run are observers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

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
    return {
        kind: [observer.listen for observer in observers if kind in observer.kinds]
        for kind in TOPIC_OF
    }


def kinds_of(observers: Sequence[Observer]) -> Kinds:
    return frozenset[type[Message]]().union(*(observer.kinds for observer in observers))


@runtime_checkable
class ShowsBacklog(Protocol):
    """Observer that shows how far the log is behind, instead of the messages that it misses."""

    def show_backlog(self, at: int, waiting: int, /) -> None:
        """Take the instant (ns) of the latest recorded message and the number of waiting ones."""
        ...


class ThrottledObservers:
    """Observer that passes messages to others, but only a few while the log is behind.

    So a slow picture loses messages; the log never does.
    """

    def __init__(
        self, observers: Sequence[Observer], waiting: Callable[[], int], most_waiting: int
    ) -> None:
        """`waiting` counts messages to be recorded; beyond `most_waiting` the log is behind."""
        self._listeners = listeners_by_kind(observers)
        self.kinds = kinds_of(observers)
        """Messages that at least one observer wants."""
        self._waiting, self._most_waiting = waiting, most_waiting
        self._shows_backlog = [
            observer for observer in observers if isinstance(observer, ShowsBacklog)
        ]
        self.skipped = 0
        """Number of messages not passed on."""

    def listen(self, at: int, message: Message) -> None:
        listeners = self._listeners[type(message)]
        if not listeners:
            return
        waiting = self._waiting()
        if waiting > self._most_waiting and not isinstance(message, ALWAYS):
            self.skipped += 1
            for observer in self._shows_backlog:
                observer.show_backlog(at, waiting)
            return
        for listener in listeners:
            listener(at, message)

    def skipped_line(self) -> str:
        """Report the number of skipped messages; empty without any."""
        if not self.skipped:
            return ""
        return (
            f"picture and progress skipped {self.skipped} messages while the log was behind; "
            "the log holds them"
        )
