"""Runs that share their beginnings, with runs made up: a number that grows by what a way says."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import BinaryIO

import pytest

from scenarios.runs.forked import ForkedRunError, ForkedRuns, Journey, can_fork

pytestmark = [
    pytest.mark.skipif(not can_fork(), reason="only where runs are forked"),
    pytest.mark.forks,
]
LENGTH = 20
EVERY = 5


@dataclass(frozen=True)
class Digits:
    """A way: at each instant a digit is appended; "x" raises, "d" dies, "." ends the run."""

    text: str

    def same_until(self, other: "Digits") -> int:
        pairs = zip(self.text, other.text, strict=True)
        return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))


@dataclass(frozen=True)
class Drive:
    """Appends digits, and notes in a file, open in all its processes, each instant driven."""

    steps: BinaryIO

    def __call__(self, way: Digits, journey: Journey[Digits]) -> str:
        done = ""
        for at in range(LENGTH):
            journey.look()
            if at and at % EVERY == 0:
                way = journey.stay(at)
            os.write(self.steps.fileno(), b".")
            digit = way.text[at]
            if digit == "x":
                raise ValueError(f"{done} failed")
            if digit == "d":
                os.kill(os.getpid(), signal.SIGKILL)
            if digit == ".":
                break
            done += digit
        return done

    @property
    def driven(self) -> int:
        """How many instants were driven so far."""
        return Path(self.steps.name).stat().st_size

    @property
    def processes(self) -> set[int]:
        """Other processes that have the file open."""
        holders = set()
        for fd in Path("/proc").glob("[0-9]*/fd/*"):
            with suppress(OSError):  # it has ended, or is not ours
                if str(fd.readlink()) == self.steps.name:
                    holders.add(int(fd.parts[2]))
        return holders - {os.getpid()}


@contextmanager
def runs_of(drive: Drive, abreast: int = 2, most: int = 24) -> Iterator[ForkedRuns[Digits]]:
    runs = ForkedRuns[Digits](drive, abreast, most)
    try:
        yield runs
    finally:
        runs.close()


@pytest.fixture
def drive(tmp_path: Path) -> Iterator[Drive]:
    with (tmp_path / "steps").open("ab") as file:
        yield Drive(file)


def way(*turns: int) -> Digits:
    """Zeros, with a one at each of the instants."""
    return Digits("".join("1" if at in turns else "0" for at in range(LENGTH)))


WAYS = [
    way(),
    way(),
    way(16),
    way(16),
    way(0),
    way(15),
    way(19),
    way(16, 18),
    way(4),
    way(5),
    way(0),
]


@pytest.mark.parametrize("abreast", [1, 2, 5])
@pytest.mark.parametrize("most", [0, 1, 3, 24])
def test_each_run_comes_to_what_it_would_from_the_start(
    drive: Drive, abreast: int, most: int
) -> None:
    """Ways that part at the same instant, at the first, never, and again after parting."""
    with runs_of(drive, abreast, most) as runs:
        for _ in range(2):
            assert runs.results(WAYS) == [one.text for one in WAYS]
        assert runs.results([]) == []


def test_the_same_beginning_is_driven_once(drive: Drive) -> None:
    with runs_of(drive, 1) as runs:
        runs.results([way()])
        assert drive.driven == LENGTH
        runs.results([way(16), way(18), way(15)])
        assert drive.driven == LENGTH + 3 * 5
        runs.results([way(16, 19)])
        assert drive.driven == LENGTH + 4 * 5


def test_a_run_that_ends_early_is_not_gone_on_from_where_it_never_came(drive: Drive) -> None:
    short = Digits(way().text[:17] + "." + way().text[18:])
    with runs_of(drive) as runs:
        assert runs.results([short, way(), short]) == ["0" * 17, way().text, "0" * 17]


@pytest.mark.parametrize("at", [0, 18])
def test_what_a_run_raises_is_raised_and_no_process_stays(drive: Drive, at: int) -> None:
    wrong = Digits(way().text[:at] + "x" + way().text[at + 1 :])
    with runs_of(drive) as runs:
        runs.results([way()])
        with pytest.raises(ValueError, match=f"^{'0' * at} failed$"):
            runs.results([way(3), wrong, way(7)])
        assert not drive.processes


@pytest.mark.parametrize("at", [0, 18])
def test_a_run_that_dies_is_one_line_and_no_process_stays(drive: Drive, at: int) -> None:
    deadly = Digits(way().text[:at] + "d" + way().text[at + 1 :])
    with runs_of(drive) as runs:
        runs.results([way()])
        with pytest.raises(ForkedRunError) as error:
            runs.results([way(3), deadly, way(7)])
        assert error.value.lines == ("a run died without saying why",)
        assert not drive.processes


def test_when_the_process_that_asks_is_killed_its_runs_end(drive: Drive) -> None:
    script = (
        "import sys, time\n"
        "from tests.scenarios.runs.pool.test_forked import *\n"
        "runs = ForkedRuns(Drive(open(sys.argv[1], 'ab')), 2)\n"
        "runs.results(WAYS)\n"
        "print('driven', flush=True)\n"
        "time.sleep(60)\n"
    )
    command = [sys.executable, "-c", script, drive.steps.name]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"driven\n"
        process.send_signal(signal.SIGSTOP)  # so that nothing is driven any more
        copies = drive.processes - {process.pid}
        process.kill()
    assert len(copies) > len(WAYS)
    until = time.monotonic() + 10.0
    while drive.processes and time.monotonic() < until:
        time.sleep(0.02)
    assert not drive.processes
