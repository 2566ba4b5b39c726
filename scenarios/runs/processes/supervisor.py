"""Starts, watches and stops the processes of a run."""

import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import IO

from scenarios.runs.processes.forking import (
    ChildSpec,
    ForkedProcess,
    PrepareTask,
    can_fork,
    fork_all,
)
from scenarios.runs.processes.router import LISTENING
from scenarios.runs.stop import write_error
from transport.bus.bus import BusError
from transport.clock import SYSTEM_TIME, SystemTime, poll

POLL_S = 0.01
GRACE_S = 3.0
"""Time between SIGTERM and SIGKILL; every run ends within five seconds."""


@dataclass(slots=True)
class Child:
    name: str
    process: "subprocess.Popen[bytes] | ForkedProcess"

    @property
    def exit_code(self) -> int | None:
        return self.process.poll()


def describe(child: Child) -> str:
    code = child.exit_code
    if code is None:
        return f"{child.name} still runs"
    if code < 0:
        return f"{child.name} was killed by signal {-code}"
    return f"{child.name} ended with exit code {code}"


def spawn(arguments: Sequence[str], *, piped: bool) -> "subprocess.Popen[bytes]":
    """Start `convoy ARGUMENTS` as a new program."""
    return subprocess.Popen(  # noqa: S603 - our own command line, no shell
        [sys.executable, "-m", "scenarios.cli", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE if piped else None,
        start_new_session=True,
    )


class Supervisor:
    """Starts and stops the child processes of a run.

    Each has its own session, so that Ctrl-C in the terminal reaches only the launcher. Its standard
    input is a pipe from the launcher: when that closes, the child stops by itself.
    """

    def __init__(
        self, prepare_task: PrepareTask | None = None, system: SystemTime = SYSTEM_TIME
    ) -> None:
        """Fork children with the tasks of `prepare_task` where possible; else start programs."""
        self.children: list[Child] = []
        self._router_output: IO[bytes] | None = None
        self._system = system
        self._prepare_task = prepare_task if prepare_task is not None and can_fork() else None

    def start(self, name: str, arguments: Sequence[str], *, piped: bool = False) -> Child:
        """Start `convoy ARGUMENTS` as a child; `piped` sends its output here."""
        return self._start([(name, arguments)], piped=piped)[0]

    def start_all(self, commands: Sequence[tuple[str, Sequence[str]]]) -> None:
        self._start(commands, piped=False)

    def _start(self, commands: Sequence[tuple[str, Sequence[str]]], *, piped: bool) -> list[Child]:
        before = len(self.children)
        if (prepare_task := self._prepare_task) is not None:
            specs = [
                ChildSpec(name, arguments, prepare_task(arguments), piped)
                for name, arguments in commands
            ]
            for spec, process in zip(specs, fork_all(specs), strict=True):
                self.children.append(Child(spec.name, process))
        else:
            for name, arguments in commands:  # appended one by one: a later one may fail
                self.children.append(Child(name, spawn(arguments, piped=piped)))
        return self.children[before:]

    def start_router(self) -> str:
        """Start a router on a free port of the loopback interface; returns its endpoint.

        Other output of the router goes to the standard error.
        """
        arguments = ["router", "--parent-watch", "-l", "tcp/127.0.0.1:0"]
        output = self.start("router", arguments, piped=True).process.stdout
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
            if child.name == name and child.process.stdin:
                with suppress(OSError):
                    child.process.stdin.write(reason.encode())
                    child.process.stdin.flush()

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
            child.process.wait()
        self.children = [child for child in self.children if child not in chosen]
        return remaining
