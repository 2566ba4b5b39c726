"""How a process learns that it should stop: a signal, or the end of the one that started it."""

import os
import signal
from threading import Event, Thread
from types import FrameType

EXIT_FAILED = 1
"""The run did not end as planned."""
EXIT_BAD_INPUT = 2
"""What was given cannot be used."""


class Stop:
    """Whether the process was asked to stop, why, and with which exit code it shall end.

    Loops look at it; nobody waits on the event, so a signal handler may set it. Until `begun` is
    set there is nothing that the process would have to wind up.
    """

    def __init__(self) -> None:
        self.event = Event()
        self.begun = False
        self.orphaned = False
        self.reason = ""
        self.exit_code = 0

    @property
    def asked(self) -> bool:
        """Whether anyone asked."""
        return self.event.is_set()

    def ask(self, reason: str, exit_code: int) -> None:
        """Ask to stop; the first reason stays."""
        if not self.asked:
            self.reason = reason
            self.exit_code = exit_code
            self.event.set()


def stop_on_signals() -> Stop:
    """SIGINT and SIGTERM ask to stop, with the shell's exit codes 130 and 143."""
    stop = Stop()

    def ask(number: int, _frame: FrameType | None) -> None:
        stop.ask(f"stopped by {signal.Signals(number).name}", 128 + number)

    signal.signal(signal.SIGINT, ask)
    signal.signal(signal.SIGTERM, ask)
    return stop


def hold_leash(stop: Stop) -> None:
    """Stop when the launcher, at the other end of standard input, says why or is gone.

    A launcher that is killed with SIGKILL cannot tell its children, but its pipes close. A child
    that has not begun by then ends at once: its imports alone may take seconds on a busy machine.
    """

    def wait() -> None:
        # Not through sys.stdin: its lock, held by this thread, would abort the interpreter's exit.
        reason = os.read(0, 1024)
        if not reason and not stop.begun:
            os._exit(EXIT_FAILED)
        stop.orphaned = not reason
        stop.ask(reason.decode() if reason else "the launcher is gone", EXIT_FAILED)

    Thread(target=wait, name="leash", daemon=True).start()


def first_of_all(*, leash: bool) -> Stop:
    """Heed signals, and the launcher where there is one, before the slow imports of a command."""
    stop = stop_on_signals()
    if leash:
        hold_leash(stop)
    return stop
