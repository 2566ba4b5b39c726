"""Children forked from this process, which has imported all they need: ready in milliseconds.

A forked child shares unmodified memory with its parent. It has its own session, signals, standard
input and name, and runs a command as if started by its command line.
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
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NoReturn, Self

from scenarios.runs.stop import EXIT_FAILED, STOP_SIGNALS, end_on_signals, without_watch

Task = Callable[[], None]
"""Work of a child; it may end by SystemExit."""
PrepareTask = Callable[[Sequence[str]], Task]
"""Prepares, before the fork, the task of a child that runs `convoy ARGUMENTS`."""
EVERY_FILE = 1 << 20
"""Above the descriptors of all open files."""
LONGEST_NAME = 15
"""Longest process name that the system keeps."""


def can_fork() -> bool:
    """Whether children can be forked: on Linux, without threads other than that of the signals.

    Elsewhere system libraries may not be used in a forked child.
    """
    with without_watch():
        return sys.platform == "linux" and threading.active_count() == 1


def name_process(name: str) -> None:
    """Show this process as `convoy-NAME` in `top`, `ps -o comm` and `pgrep`, where supported."""
    with suppress(OSError):
        Path("/proc/self/comm").write_text(f"convoy-{name}"[:LONGEST_NAME], encoding="utf-8")


class ForkedProcess:
    """A forked child with the methods of `subprocess.Popen` that a supervisor uses.

    `stdin` is the writing end of its standard input; `stdout` the reading end of a piped output.
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
        return self._look(0) or 0

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:  # an ended child keeps its number until then
            os.kill(self.pid, number)

    def _look(self, options: int) -> int | None:
        if self._exit_code is None:
            pid, status = os.waitpid(self.pid, options)
            if pid:
                self._exit_code = os.waitstatus_to_exitcode(status)
        return self._exit_code


@dataclass(frozen=True, slots=True)
class ChildSpec:
    """A child to fork: its name, and the task that does what `convoy ARGUMENTS` does.

    Its standard input is a pipe from here; if `piped`, its standard output is one to here.
    """

    name: str
    arguments: Sequence[str]
    task: Task
    piped: bool = False


def fork_all(specs: Sequence[ChildSpec]) -> list[ForkedProcess]:
    """Fork children one right after the other; raises OSError, and then there are none.

    Memory that this process writes to between two forks is not shared between children.
    """
    pipes = [_Pipes.of(spec) for spec in specs]
    pids: list[int] = []
    sys.stdout.flush()
    sys.stderr.flush()
    gc.freeze()  # a collection would write to every object and unshare the memory
    try:
        with without_watch(), _signals_held():
            for spec, ends in zip(specs, pipes, strict=True):
                pid = os.fork()
                if pid == 0:
                    _run_child(spec, ends)
                pids.append(pid)
    except OSError:
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
        raise
    finally:
        for ends in pipes:
            ends.close_child_ends(forked=len(pids) == len(specs))
    return [ends.process(pid) for pid, ends in zip(pids, pipes, strict=True)]


@dataclass(frozen=True, slots=True)
class _Pipes:
    """Ends of a child's pipes: two of the child, two of its parent; -1 for none."""

    parent_watch: int
    output: int
    stdin: int
    stdout: int

    @classmethod
    def of(cls, spec: ChildSpec) -> Self:
        parent_watch, stdin = os.pipe()
        stdout, output = os.pipe() if spec.piped else (-1, -1)
        return cls(parent_watch, output, stdin, stdout)

    def close_child_ends(self, *, forked: bool) -> None:
        """Close the child's ends here, and all ends if the fork failed."""
        for end in (self.parent_watch, self.output, *(() if forked else (self.stdin, self.stdout))):
            if end >= 0:
                os.close(end)

    def process(self, pid: int) -> ForkedProcess:
        stdout = None if self.stdout < 0 else os.fdopen(self.stdout, "rb")
        return ForkedProcess(pid, os.fdopen(self.stdin, "wb"), stdout)


@contextmanager
def _signals_held() -> Iterator[None]:
    """Block signals: one that reached the child before its handlers would be lost."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _run_child(spec: ChildSpec, ends: _Pipes) -> NoReturn:
    """Run in the child, from the fork to its exit."""
    code = EXIT_FAILED
    try:
        _detach_from_parent(spec, ends)
        spec.task()
        code = 0
    except SystemExit as end:
        code = _exit_code_of(end)
    except BaseException:  # noqa: BLE001 - as the interpreter does
        traceback.print_exc()
    finally:
        # Never return into the parent's code.
        with suppress(BaseException):
            atexit._run_exitfuncs()
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _exit_code_of(end: SystemExit) -> int:
    """Exit code as the interpreter derives it; a text is printed."""
    if isinstance(end.code, str):
        print(end.code, file=sys.stderr)  # noqa: T201
        return EXIT_FAILED
    return end.code or 0


def _detach_from_parent(spec: ChildSpec, ends: _Pipes) -> None:
    """Drop what belongs to the parent: session, files, signals, command line, exit functions."""
    os.setsid()
    name_process(spec.name)
    os.dup2(ends.parent_watch, 0)
    if ends.output >= 0:
        os.dup2(ends.output, 1)
    os.closerange(3, EVERY_FILE)  # a sibling's pipe held here would keep it alive
    atexit._clear()
    sys.argv = ["convoy", *spec.arguments]
    # A vehicle that crashes restarts by these arguments, as a new program.
    sys.orig_argv = [sys.executable, "-m", "scenarios.cli", *spec.arguments]
    end_on_signals(report=False)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)
