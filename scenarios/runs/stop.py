"""Requests to stop a process: by a signal, or because the process that started it has ended.

A command has two phases. Until it has begun (`Stop.begun`), nothing is lost by its end, and a
request ends the process at once, even while the main thread imports or waits for a router.
Afterwards `Stop.requested` is set, and the command completes what it writes.
"""

import os
import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from select import select
from threading import Lock, Thread
from types import FrameType

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
EXIT_DONE, EXIT_FAILED, EXIT_BAD_INPUT = 0, 1, 2


def exit_code_of_signal(number: int) -> int:
    """Exit code of a command stopped by a signal, as shells have it."""
    return 128 + number


EXIT_CODES: Mapping[int, str] = {
    EXIT_DONE: "done as planned",
    EXIT_FAILED: "failed: a limit was broken, a process failed, output could not be written; or,"
    " of compare, the runs differ, of bisect, the range holds no boundary",
    EXIT_BAD_INPUT: "the input cannot be used: an option, a scenario, a log or a router",
    exit_code_of_signal(signal.SIGINT): "stopped by Ctrl-C (SIGINT); files are complete",
    exit_code_of_signal(signal.SIGTERM): "stopped by SIGTERM; files are complete",
}
"""Meaning of each exit code; `convoy reference exit-codes` prints it."""


def write_error(text: bytes) -> None:
    """Write a few bytes to the standard error, if that is open and its reader reads."""
    with suppress(OSError):
        if select([], [2], [], 0.0)[1]:
            os.write(2, text)


class Stop:
    """Request to stop this process: reason and exit code.

    No lock is taken, because signal handlers interrupt each other: loops poll `requested`. `begun`:
    there is something to complete before the end. `launched`: another process started this one and
    reports for it. `orphaned`: that launcher has ended. An empty `folder` is removed on an
    immediate end.
    """

    def __init__(self) -> None:
        self._requests: list[tuple[str, int]] = []
        self.signals: list[int] = []
        """Numbers of received signals; handlers append to it and do nothing else."""
        self.begun = False
        self.handles_signals = False
        self.ignores_signals = False
        self.launched = False
        self.orphaned = False
        self.folder: Path | None = None

    @property
    def requested(self) -> bool:
        return bool(self._requests or self.signals)

    @property
    def reason(self) -> str:
        return self._first[0]

    @property
    def exit_code(self) -> int:
        return self._first[1]

    @property
    def _first(self) -> tuple[str, int]:
        """The request that decides: the first signal, unless there was a request before."""
        if self._requests:
            return self._requests[0]
        if self.signals:
            return _reason(self.signals[0]), exit_code_of_signal(self.signals[0])
        return "", 0

    def request(self, reason: str, exit_code: int) -> None:
        """Request a stop; the first request decides."""
        if self.signals and not self._requests:
            self._requests.append(self._first)
        self._requests.append((reason, exit_code))


class _Watch:
    """Thread that receives signals over the interpreter's wakeup pipe.

    Unlike a Python handler it does not wait for a library call of the main thread to return, if
    that call releases the interpreter's lock.
    """

    def __init__(self, *, report: bool) -> None:
        self.stop = Stop()
        self._say = report
        self._reading, self._writing = os.pipe()
        os.set_blocking(self._writing, False)
        signal.set_wakeup_fd(self._writing, warn_on_full_buffer=False)
        Thread(target=self._wait, name="signals", daemon=True).start()

    def _wait(self) -> None:
        while True:
            number = os.read(self._reading, 1)[0]
            if number not in STOP_SIGNALS:
                continue
            if self._say and not self.stop.launched:
                self._say = False
                write_error(f"{_reason(number)}\n".encode())
            if not self.stop.begun:
                if self.stop.folder is not None:
                    with suppress(OSError):  # not empty
                        self.stop.folder.rmdir()
                with _EXIT_LOCK:
                    os._exit(exit_code_of_signal(number))


_EXIT_LOCK = Lock()
_watch: _Watch | None = None
"""Set if this process is a command."""


def _reason(number: int) -> str:
    return f"stopped by {signal.Signals(number).name}"


def end_on_signals(*, report: bool) -> None:
    """Let SIGINT and SIGTERM end this process until the command has begun.

    The exit codes are the shell's, 130 and 143; with `report` a line is printed. Call it once, in
    the main thread, before the command's imports.
    """
    global _watch  # noqa: PLW0603 - signals are the process's, not an object's
    _watch = _Watch(report=report)
    _handle_signals(_watch.stop)


def remove_if_empty(folder: Path) -> None:
    """Remove an empty `folder` if a signal ends this process at once."""
    if _watch is not None:
        _watch.stop.folder = folder


@contextmanager
def delayed_exit() -> Iterator[None]:
    """Delay the immediate end by a signal, as while a child process receives its first data.

    A child whose parent ends in the middle of that would print a traceback.
    """
    with _EXIT_LOCK:
        yield


def stop_on_signals() -> Stop:
    """Request a stop on SIGINT and SIGTERM, with the shell's exit codes 130 and 143."""
    stop = Stop() if _watch is None else _watch.stop
    _handle_signals(stop)
    return stop


def ignore_hangup() -> None:
    """Let the run go on when its terminal goes away; what cannot be printed fails the command."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)


def ignore_signals(stop: Stop) -> None:
    """Ignore the signals that `stop` handles, between the end of the work and the exit.

    The interpreter removes handlers as it exits; a signal would then kill a finished process.
    """
    stop.ignores_signals = True
    if stop.handles_signals:
        for number in STOP_SIGNALS:
            signal.signal(number, signal.SIG_IGN)


def _handle_signals(stop: Stop) -> None:
    signals, stop.handles_signals = stop.signals, True

    def note(number: int, _frame: FrameType | None) -> None:
        # Nothing that takes a lock: the interrupted code may hold it.
        signals.append(number)

    for number in STOP_SIGNALS:
        signal.signal(number, note)


def stop_with_launcher(stop: Stop) -> None:
    """Request a stop when standard input, a pipe from the launcher, gives a reason or closes.

    The pipe also closes if the launcher is killed. A process that has not begun by then ends at
    once: imports may take seconds on a busy machine.
    """

    def wait() -> None:
        # Not through sys.stdin: its lock, held by this thread, would abort the interpreter's exit.
        reason = os.read(0, 1024)
        if not reason and not stop.begun:
            os._exit(EXIT_FAILED)
        stop.orphaned = not reason
        stop.request(reason.decode() if reason else "the launcher has ended", EXIT_FAILED)

    Thread(target=wait, name="launcher", daemon=True).start()


def stop_on_request(*, with_launcher: bool) -> Stop:
    """Stop on signals and, on request, with the launcher; call it before slow imports."""
    stop = stop_on_signals()
    stop.launched = with_launcher
    if with_launcher:
        stop_with_launcher(stop)
    return stop
