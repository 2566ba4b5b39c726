"""Children forked from this process, which has imported all they need: ready in milliseconds.

A forked child shares with its parent the memory that neither writes to, and is a process of its
own in everything else: its own session, signals, standard input, name and death. What it does is a
command, as if it had been started by its command line.
"""

import atexit
import gc
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, NoReturn

from scenarios.runs.stop import ASKING, EXIT_FAILED, end_on_signals, without_watch

Deed = Callable[[], None]
"""What a child does; it may end by SystemExit."""
Become = Callable[[Sequence[str]], Deed]
"""Prepares, before the fork, what a child does that is to do what `convoy ARGUMENTS` does."""
EVERY_FILE = 1 << 20
"""Above the numbers of all files that a process has open."""
LONGEST_NAME = 15
"""Letters that the system keeps of the name of a process."""


def can_fork() -> bool:
    """Whether children can be forked: on Linux, with no thread here besides that of the signals.

    Elsewhere a child that is not a new program as well may not use the system's libraries.
    """
    with without_watch():
        return sys.platform == "linux" and threading.active_count() == 1


def name_process(name: str) -> None:
    """Show this process as `convoy-NAME` in `top`, `ps -o comm` and to `pgrep`, where that goes."""
    with suppress(OSError):
        Path("/proc/self/comm").write_text(f"convoy-{name}"[:LONGEST_NAME], encoding="utf-8")


class ForkedProcess:
    """A forked child, as far as a supervisor needs it: what `subprocess.Popen` has by these names.

    `stdin` is the writing end of its standard input; `stdout` the reading end of its output, if
    that was asked for.
    """

    def __init__(self, pid: int, stdin: BinaryIO, stdout: BinaryIO | None) -> None:
        self.pid = pid
        self.stdin = stdin
        self.stdout = stdout
        self._exit_code: int | None = None

    def poll(self) -> int | None:
        """Exit code, None while it runs; the negative number of the signal that killed it."""
        return self._look(os.WNOHANG)

    def wait(self) -> int:
        """Wait for its end; returns the exit code."""
        return self._look(0) or 0

    def terminate(self) -> None:
        """Ask it to end, by SIGTERM."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it, by SIGKILL."""
        self.send_signal(signal.SIGKILL)

    def send_signal(self, number: int) -> None:
        """Send it a signal; nothing happens if it has ended."""
        if self.poll() is None:  # its number is not another's before this process has looked
            os.kill(self.pid, number)

    def _look(self, options: int) -> int | None:
        if self._exit_code is None:
            pid, status = os.waitpid(self.pid, options)
            if pid:
                self._exit_code = os.waitstatus_to_exitcode(status)
        return self._exit_code


def fork(name: str, arguments: Sequence[str], deed: Deed, *, piped: bool) -> ForkedProcess:
    """Fork a child called `name` that does a deed, which is that of `convoy ARGUMENTS`.

    Its standard input is a pipe from here, and with `piped` its standard output one to here.
    """
    leash, stdin = os.pipe()
    stdout, output = os.pipe() if piped else (-1, 1)
    sys.stdout.flush()
    sys.stderr.flush()
    gc.freeze()  # the collector would write to every object, and so make the memory the child's own
    with without_watch(), _signals_held():
        pid = os.fork()
        if pid == 0:
            _live(name, arguments, deed, leash, output)
    os.close(leash)
    if piped:
        os.close(output)
    return ForkedProcess(pid, os.fdopen(stdin, "wb"), os.fdopen(stdout, "rb") if piped else None)


@contextmanager
def _signals_held() -> Iterator[None]:
    """Let a signal wait: one that reached the child before it can tell would be lost."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ASKING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _live(name: str, arguments: Sequence[str], deed: Deed, leash: int, output: int) -> NoReturn:
    """Be the child, from its first instant to its end."""
    code = EXIT_FAILED
    try:
        _come_of_age(name, arguments, leash, output)
        deed()
        code = 0
    except SystemExit as end:
        code = _exit_code_of(end)
    except BaseException:  # noqa: BLE001 - as the interpreter does with what nobody has caught
        traceback.print_exc()
    finally:
        # What the parent was about to do is not for the child, so it never returns from here.
        with suppress(BaseException):
            atexit._run_exitfuncs()
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _exit_code_of(end: SystemExit) -> int:
    """Exit code as the interpreter takes it; a text is said."""
    if isinstance(end.code, str):
        print(end.code, file=sys.stderr)  # noqa: T201
        return EXIT_FAILED
    return end.code or 0


def _come_of_age(name: str, arguments: Sequence[str], leash: int, output: int) -> None:
    """Leave behind what is the parent's: session, files, signals, command line, its last deeds."""
    os.setsid()
    name_process(name)
    os.dup2(leash, 0)
    os.dup2(output, 1)
    os.closerange(3, EVERY_FILE)  # a sibling's leash held here would keep it alive
    atexit._clear()
    sys.argv = ["convoy", *arguments]
    # By this a vehicle that crashes starts anew: a program of its own from then on.
    sys.orig_argv = [sys.executable, "-m", "scenarios.cli", *arguments]
    end_on_signals(say=False)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ASKING)
