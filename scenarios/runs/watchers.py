"""Those who watch a run while it is recorded: the picture and the progress table."""

from collections.abc import Callable, Sequence

from scenarios.runs.observer import Observer, kinds_of, listeners_by_kind
from vehicles.messages import Change, LogText, Message, RunEnd, RunStart

ALWAYS = (Change, LogText, RunEnd, RunStart)
"""Messages that are few, and without which the rest is not understood."""


class Watchers:
    """Gives each message to all who watch, but most of them not while the log has to catch up.

    So a picture that takes longer than the convoy drives costs the picture, and never the log.
    """

    def __init__(self, observers: Sequence[Observer], is_behind: Callable[[], bool]) -> None:
        """`is_behind` says whether more waits to be recorded than there should."""
        self._listeners = listeners_by_kind(observers)
        self.kinds = kinds_of(observers)
        """Messages that at least one observer wants."""
        self._is_behind = is_behind
        self.left_out = 0
        """Messages that nobody was shown."""

    def listen(self, at: int, message: Message) -> None:
        """Take one recorded message, and the instant (ns) of its reception."""
        listeners = self._listeners[type(message)]
        if not listeners:
            return
        if self._is_behind() and not isinstance(message, ALWAYS):
            self.left_out += 1
            return
        for listener in listeners:
            listener(at, message)

    def account(self) -> str:
        """Say what was left out; nothing if all was shown."""
        if not self.left_out:
            return ""
        return (
            f"the picture and the progress leave out {self.left_out} messages, which the log has: "
            "there was no time for them"
        )
