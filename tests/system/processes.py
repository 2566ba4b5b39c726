"""Convoys as a user starts them, with every process that comes of it."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

import psutil

PART = "convoy-"
"""Begins the system's names of a run's parts."""
MARK = "CONVOY_TEST_MARK"
"""Every process inherits this variable, so none of a test's processes can hide."""
PATIENCE_S = 60.0
"""Longest wait for what must happen, on a machine that has other things to do."""
SETTLE_S = 10.0
"""After whatever happened, no process is left behind after this time.

A run itself takes at most five seconds for it; the rest is for a machine with other things to do.
"""
PROGRESS = re.compile(r" of [0-9.]+ s.* · true error now |^run [A-Za-z0-9_-]+: writes ")
"""Lines of progress, and the first line of a run."""
DRIVING = "vehicles are present"
"""The recorder says so half a second before the start."""


@dataclass(frozen=True)
class Process:
    """One `convoy …` command that runs, what it has said, and all that it started."""

    popen: "subprocess.Popen[bytes]"
    mark: str
    printed: Path
    complained: Path

    @property
    def out(self) -> str:
        """What it printed so far."""
        return self.printed.read_text()

    @property
    def err(self) -> str:
        """What it and those it started wrote to standard error so far."""
        return self.complained.read_text()

    def lines(self) -> list[str]:
        """Return the lines on standard error without `error: `, progress and the start."""
        lines = (line.removeprefix("error: ") for line in self.err.splitlines())
        return [line for line in lines if not PROGRESS.search(line)]

    def everyone(self) -> list[psutil.Process]:
        """Return the processes that are left of it, itself among them."""
        return [process for process in psutil.process_iter() if _mark_of(process) == self.mark]

    def parts(self) -> dict[str, psutil.Process]:
        """Return the processes of a run by name: launcher, router, recorder, v1, v2, …"""
        return {self._name(process): process for process in self.everyone()}

    def _name(self, process: psutil.Process) -> str:
        """Name of a part of a run; that of none while it is being made, or has just ended."""
        with suppress(psutil.Error):
            name = process.name()
            if name.startswith(PART):
                return name.removeprefix(PART)
        return "launcher" if process.pid == self.popen.pid else ""

    def part(self, name: str) -> psutil.Process:
        """Return one process of a run, as soon as it is there."""
        assert until(lambda: name in self.parts() or self.exit_code is not None)
        assert name in self.parts(), self.err
        return self.parts()[name]

    def await_start(self) -> None:
        """Wait until all vehicles are there, half a second before they start."""
        assert until(lambda: DRIVING in self.err or self.exit_code is not None), self.err
        assert self.exit_code is None, self.err

    def drive(self, seconds: float) -> None:
        """Wait until the convoy has driven for so long."""
        self.await_start()
        time.sleep(0.5 + seconds)
        assert self.exit_code is None, self.err

    @property
    def exit_code(self) -> int | None:
        """Its exit code; None while it runs."""
        return self.popen.poll()

    def wait(self, seconds: float = PATIENCE_S) -> int:
        """Wait for its end; returns the exit code."""
        return self.popen.wait(seconds)

    def is_gone_in_time(self) -> bool:
        """Say whether nothing is left of it within the time that it may take."""
        return until(lambda: not self.everyone(), SETTLE_S)


@contextmanager
def start(*arguments: object, folder: Path) -> Iterator[Process]:
    """Start `convoy ARGUMENTS` in `folder`; in the end nothing is left of it."""
    mark = uuid4().hex
    printed, complained = folder / f"{mark}.out", folder / f"{mark}.err"
    environment = {**os.environ, MARK: mark, "COLUMNS": "200"}
    with printed.open("wb") as out, complained.open("wb") as err:
        popen = subprocess.Popen(
            [sys.executable, "-m", "scenarios.cli", *map(str, arguments)],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,
        )
    process = Process(popen, mark, printed, complained)
    try:
        yield process
    finally:
        for one in process.everyone():
            with suppress(psutil.NoSuchProcess):
                one.send_signal(signal.SIGKILL)
        popen.wait()


def run_to_the_end(*arguments: object, folder: Path) -> Process:
    """Run `convoy ARGUMENTS` in `folder` and wait for its end; nothing is left of it."""
    with start(*arguments, folder=folder) as process:
        process.wait()
        assert not process.everyone()
    return process


def until(holds: Callable[[], bool], seconds: float = PATIENCE_S) -> bool:
    """Wait until `holds()`, at most `seconds`; say whether it does."""
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.02)
    return holds()


def _mark_of(process: psutil.Process) -> str | None:
    try:
        if process.status() == psutil.STATUS_ZOMBIE:  # has ended; only its parent has not looked
            return None
        return process.environ().get(MARK)
    except psutil.Error:
        return None
