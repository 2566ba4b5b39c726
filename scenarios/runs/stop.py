"""Requests to stop a process: by a signal, or because the process that started it has ended."""

import os
import signal
from threading import Event, Thread
from types import FrameType

EXIT_FAILED = 1
"""The run did not end as planned."""
EXIT_BAD_INPUT = 2
"""What was given cannot be used."""


class Stop:
    """Whether the process was asked to stop, why, and with which exit code it has to end.

    Loops poll it and none waits on the event, so a signal handler may set it. `begun` says that
    the process has something to complete before it ends; `orphaned` that its launcher has ended.
    """

    def __init__(self) -> None:
        self.event = Event()
        self.begun = False
        self.orphaned = False
        self.reason = ""
        self.exit_code = 0

    @property
    def asked(self) -> bool:
        """Whether the process was asked to stop."""
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


def ignore_signals() -> None:
    """Ignore SIGINT and SIGTERM from now on, for the moment between the last deed and the end.

    A handler of ours would be taken away when the interpreter begins to end, and a signal then
    kill a process whose work is done.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


def stop_with_launcher(stop: Stop) -> None:
    """Ask to stop when standard input, a pipe from the launcher, gives a reason or closes.

    A launcher killed by SIGKILL cannot inform its children, but its pipes close. A child that has
    not begun by then ends at once: its imports alone may take seconds on a busy machine.
    """

    def wait() -> None:
        # Not through sys.stdin: its lock, held by this thread, would abort the interpreter's exit.
        reason = os.read(0, 1024)
        if not reason and not stop.begun:
            os._exit(EXIT_FAILED)
        stop.orphaned = not reason
        stop.ask(reason.decode() if reason else "the launcher is gone", EXIT_FAILED)

    Thread(target=wait, name="launcher", daemon=True).start()


def stop_on_request(*, with_launcher: bool) -> Stop:
    """Stop on signals and, if asked, with the launcher; call it before a command's slow imports."""
    stop = stop_on_signals()
    if with_launcher:
        stop_with_launcher(stop)
    return stop
