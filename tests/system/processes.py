"""`convoy` commands as a user starts them, with all their descendant processes."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import chdir, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

import psutil
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from tests.made.warm_interpreter import MARK, ForkedCommand, warm_interpreter

PREFIX = "convoy-"
"""Prefix of the process names of a run."""
TIMEOUT_S = 60.0
"""Longest wait for an expected event, on a busy machine."""
SETTLE_S = 10.0
"""All processes of a failed run end within this time.

A run needs at most 5 s; the rest is for a busy machine.
"""
PROGRESS = re.compile(r" of [0-9.]+ s.* · largest true error now |^run [A-Za-z0-9_-]+: writes ")
"""Progress lines, and the first line of a run."""
DRIVING = "vehicles are present"
"""The recorder prints this half a second before the start."""


@dataclass(frozen=True)
class Process:
    """A running `convoy …` command with its output and its descendants."""

    popen: "subprocess.Popen[bytes] | ForkedCommand"
    mark: str
    stdout_file: Path
    stderr_file: Path

    @property
    def out(self) -> str:
        """Standard output so far."""
        return self.stdout_file.read_text()

    @property
    def err(self) -> str:
        """Standard error so far, including that of descendants."""
        return self.stderr_file.read_text()

    def lines(self) -> list[str]:
        """Lines of standard error without `error: `, progress and the start line."""
        lines = (line.removeprefix("error: ") for line in self.err.splitlines())
        return [line for line in lines if not PROGRESS.search(line)]

    def remaining(self) -> list[psutil.Process]:
        """Processes still alive, including the command itself."""
        return [process for process in psutil.process_iter() if _mark_of(process) == self.mark]

    def parts(self) -> dict[str, psutil.Process]:
        """Processes of a run by name: launcher, router, recorder, v1, v2, …"""
        return {self._name(process): process for process in self.remaining()}

    def _name(self, process: psutil.Process) -> str:
        """Name of a process of a run; empty while it is being created, or after its end."""
        with suppress(psutil.Error):
            name = process.name()
            if name.startswith(PREFIX):
                return name.removeprefix(PREFIX)
        return "launcher" if process.pid == self.popen.pid else ""

    def part(self, name: str) -> psutil.Process:
        """Wait for a process of a run, and return it."""
        assert until(lambda: name in self.parts() or self.exit_code is not None)
        assert name in self.parts(), self.err
        return self.parts()[name]

    def await_start(self) -> None:
        """Wait until all vehicles are present, half a second before they start."""
        assert until(lambda: DRIVING in self.err or self.exit_code is not None), self.err
        assert self.exit_code is None, self.err

    def drive(self, seconds: float) -> None:
        """Wait until the convoy has driven for `seconds`."""
        self.await_start()
        time.sleep(0.5 + seconds)
        assert self.exit_code is None, self.err

    @property
    def exit_code(self) -> int | None:
        return self.popen.poll()

    def wait(self, seconds: float = TIMEOUT_S) -> int:
        """Wait for the end; return the exit code."""
        return self.popen.wait(seconds)

    def ends_in_time(self) -> bool:
        """Whether all processes end within `SETTLE_S`."""
        return until(lambda: not self.remaining(), SETTLE_S)


@contextmanager
def start(
    *arguments: object, folder: Path, inside: Sequence[str] = (), fresh: bool = False
) -> Iterator[Process]:
    """Start `convoy ARGUMENTS` in `folder`; kill all its processes on exit.

    `inside` is the beginning of a command that runs it on another host. In tests a process that has
    imported the project forks the command, unless `fresh`; benches start a new interpreter.
    """
    mark = uuid4().hex
    stdout_file, stderr_file = folder / f"{mark}.out", folder / f"{mark}.err"
    environment = {**os.environ, MARK: mark, "COLUMNS": "200"}
    command = [str(argument) for argument in arguments]
    popen: subprocess.Popen[bytes] | ForkedCommand
    if inside or fresh or "PYTEST_CURRENT_TEST" not in os.environ:
        with stdout_file.open("wb") as out, stderr_file.open("wb") as err:
            popen = subprocess.Popen(
                [*inside, sys.executable, "-m", "scenarios.cli", *command],
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                start_new_session=True,
            )
    else:
        popen = warm_interpreter().start(command, folder, stdout_file, stderr_file, environment)
    process = Process(popen, mark, stdout_file, stderr_file)
    try:
        yield process
    finally:
        for part in process.remaining():
            with suppress(psutil.NoSuchProcess):
                part.send_signal(signal.SIGKILL)
        popen.wait()


def run_to_the_end(*arguments: object, folder: Path) -> Process:
    """Run `convoy ARGUMENTS` in `folder` to its end; no process remains."""
    with start(*arguments, folder=folder) as process:
        process.wait()
        assert not process.remaining()
    return process


def invoke(*arguments: object, folder: Path) -> Result:
    """Run `convoy ARGUMENTS` in `folder` in this process, which saves a second of imports.

    For commands whose processes are not what the test is about, such as runs in virtual time.
    """
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    handlers = {number: signal.getsignal(number) for number in numbers}
    try:
        with chdir(folder):
            return CliRunner().invoke(cli, [str(argument) for argument in arguments])
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def until(holds: Callable[[], bool], seconds: float = TIMEOUT_S) -> bool:
    """Wait up to `seconds` until `holds()`; return whether it does."""
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.02)
    return holds()


def _mark_of(process: psutil.Process) -> str | None:
    try:
        if process.status() == psutil.STATUS_ZOMBIE:  # ended, not yet reaped
            return None
        return process.environ().get(MARK)
    except psutil.Error:
        return None
