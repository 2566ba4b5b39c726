"""Observers that give way to the log: the picture and the progress table."""

from collections.abc import Callable, Sequence

from scenarios.runs.observer import Observer, kinds_of, listeners_by_kind
from vehicles.messages import Change, LogText, Message, RunEnd, RunStart

ALWAYS = (Change, LogText, RunEnd, RunStart)
"""Few messages, needed to understand the others."""


class Watchers:
    """Observer that passes messages to others, but only a few while the log is behind.

    So a slow picture loses messages; the log never does.
    """

    def __init__(self, observers: Sequence[Observer], is_behind: Callable[[], bool]) -> None:
        """`is_behind` returns whether too many messages wait to be recorded."""
        self._listeners = listeners_by_kind(observers)
        self.kinds = kinds_of(observers)
        """Messages that at least one observer wants."""
        self._is_behind = is_behind
        self.left_out = 0
        """Number of messages not passed on."""

    def listen(self, at: int, message: Message) -> None:
        listeners = self._listeners[type(message)]
        if not listeners:
            return
        if self._is_behind() and not isinstance(message, ALWAYS):
            self.left_out += 1
            return
        for listener in listeners:
            listener(at, message)

    def account(self) -> str:
        """Report the number of skipped messages; empty without any."""
        if not self.left_out:
            return ""
        return (
            f"the picture and the progress leave out {self.left_out} messages, which the log has: "
            "there was no time for them"
        )
