"""Starts, watches and stops the processes of a run."""

import atexit
import errno
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from typing import BinaryIO

from scenarios.runs.processes.fork_server import fork_server, starting_processes
from scenarios.runs.processes.router import LISTENING
from scenarios.runs.stop import write_error
from transport.bus.bus import BusError
from transport.clock import SYSTEM_TIME, SystemTime, poll

POLL_S = 0.01
GRACE_S = 3.0
"""Time between SIGTERM and SIGKILL; every run ends within five seconds."""


RunPart = Callable[[Sequence[str]], None]
"""Runs `convoy ARGUMENTS` in a new process; a function of a module."""
PRELOADED = ("scenarios.runs.processes.router", "scenarios.runs.processes.vehicle_process")
"""Modules of the processes of a run other than the recorder."""


@dataclass(slots=True)
class Child:
    """A process; `stdin` is the writing end of its standard input, `stdout` of a piped output."""

    name: str
    process: BaseProcess
    stdin: Connection | None = None
    stdout: BinaryIO | None = None

    @property
    def exit_code(self) -> int | None:
        return self.process.exitcode


def describe(child: Child) -> str:
    code = child.exit_code
    if code is None:
        return f"{child.name} still runs"
    if code < 0:
        return f"{child.name} was killed by signal {-code}"
    return f"{child.name} ended with exit code {code}"


def _run_child(
    run_part: RunPart, arguments: Sequence[str], stdin: Connection, stdout: Connection | None
) -> None:
    """Run a part in the child: with its own session, standard files and command line."""
    os.setsid()
    os.dup2(stdin.fileno(), 0)
    stdin.close()
    if stdout is not None:
        os.dup2(stdout.fileno(), 1)
        stdout.close()
    sys.argv = ["convoy", *arguments]
    try:
        run_part(arguments)
    finally:
        atexit._run_exitfuncs()


class Supervisor:
    """Starts and stops the child processes of a run.

    Each has its own session, so that Ctrl-C in the terminal reaches only the launcher. Its standard
    input is a pipe from the launcher: when that closes, the child stops by itself.
    """

    def __init__(
        self,
        run_part: RunPart,
        preload: Sequence[str] = (),
        system: SystemTime = SYSTEM_TIME,
    ) -> None:
        """The fork server imports the module of `run_part`, and those named in `preload`."""
        self.children: list[Child] = []
        self._router_output: BinaryIO | None = None
        self._system = system
        self._run_part = run_part
        self._context: BaseContext = fork_server((run_part.__module__, *preload, *PRELOADED))

    def start(self, name: str, arguments: Sequence[str], *, piped: bool = False) -> Child:
        """Start `convoy ARGUMENTS` as a child; `piped` sends its output here. Raises OSError."""
        child_stdin, stdin = self._context.Pipe(duplex=False)
        stdout, child_stdout = self._context.Pipe(duplex=False) if piped else (None, None)
        process = self._context.Process(  # type: ignore[attr-defined]
            target=_run_child,
            args=(self._run_part, arguments, child_stdin, child_stdout),
            name=name,
        )
        sys.stdout.flush()
        sys.stderr.flush()
        try:
            with starting_processes():
                process.start()
        except EOFError as error:  # the fork server could not fork
            raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN)) from error
        finally:
            child_stdin.close()
            if child_stdout is not None:
                child_stdout.close()
        output = None if stdout is None else os.fdopen(os.dup(stdout.fileno()), "rb")
        child = Child(name, process, stdin, output)
        self.children.append(child)
        return child

    def start_router(self) -> str:
        """Start a router on a free port of the loopback interface; returns its endpoint.

        Other output of the router goes to the standard error.
        """
        arguments = ["router", "--parent-watch", "-l", "tcp/127.0.0.1:0"]
        child = self.start("router", arguments, piped=True)
        output = child.stdout
        while output is not None and (line := output.readline()):
            if line.startswith(LISTENING.encode()):
                os.set_blocking(output.fileno(), False)
                self._router_output = output
                return line.decode().removeprefix(LISTENING).strip()
            write_error(line)
        raise BusError("the router did not start")

    def _pass_on_output(self) -> None:
        """Drain the router's output: a full pipe would block it."""
        if self._router_output is not None and (logged := self._router_output.read()):
            write_error(logged)

    def send_reason(self, name: str, reason: str) -> None:
        """Send a child the reason to stop; an ended child is skipped."""
        for child in self.children:
            if child.name == name and child.stdin is not None:
                with suppress(OSError):
                    os.write(child.stdin.fileno(), reason.encode())

    def ended(self) -> list[Child]:
        """Remove the ended children from `children` and return them."""
        self._pass_on_output()
        ended = [child for child in self.children if child.exit_code is not None]
        self.children = [child for child in self.children if child not in ended]
        return ended

    def stop(self, names: Sequence[str] | None = None, grace_s: float = GRACE_S) -> list[Child]:
        """Terminate the named children (by default all), and kill them after `grace_s`.

        Returns the killed ones.
        """
        chosen = [c for c in self.children if names is None or c.name in names]
        for child in chosen:
            child.process.terminate()

        def have_ended() -> bool:
            self._pass_on_output()
            return all(child.exit_code is not None for child in chosen)

        poll(have_ended, every_s=POLL_S, at_most_s=grace_s, system=self._system)
        remaining = [child for child in chosen if child.exit_code is None]
        for child in remaining:
            child.process.kill()
            child.process.join()
        self.children = [child for child in self.children if child not in chosen]
        return remaining
