"""Commands with a standard output that is closed, full or not UTF-8."""

import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from scenarios.cli.output import Output
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.runs.stop import EXIT_BAD_INPUT, EXIT_FAILED
from transport.log.reader import LogReader

CONVOY = f"{sys.executable} -m scenarios.cli"
SHORT = "run --set duration_s=0.5 --set convoy.vehicles=2"
SOON_S = 120.0


def shell(line: str, **environment: str) -> "subprocess.CompletedProcess[bytes]":
    """Run a shell command; its output must hold no traceback."""
    done = subprocess.run(
        ["/bin/bash", "-c", f"set -o pipefail; {line}"],
        env={**os.environ, **environment},
        capture_output=True,
        check=False,
        timeout=SOON_S,
    )
    assert b"Traceback" not in done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, bytes]:
    folder = tmp_path_factory.mktemp("expected")
    run = f"{CONVOY} {SHORT} --clock virtual --out {folder}/run"
    done = shell(run, PYTHONIOENCODING="latin-1")
    assert done.returncode == 0
    return (folder / "run" / LOG_NAME).read_bytes(), done.stdout


@pytest.mark.spread(2)
@pytest.mark.parametrize(
    ("redirection", "code"),
    [(">&-", 0), ("2>&-", 0), ("<&- >&- 2>&-", 0), (">/dev/full", EXIT_FAILED)],
)
def test_the_log_of_a_virtual_run_does_not_depend_on_its_output(
    tmp_path: Path, redirection: str, code: int, expected: tuple[bytes, bytes]
) -> None:
    done = shell(f"{CONVOY} {SHORT} --clock virtual --out {tmp_path}/run {redirection}")
    assert done.returncode == code
    assert (tmp_path / "run" / LOG_NAME).read_bytes() == expected[0]
    assert (tmp_path / "run" / SUMMARY_NAME).exists()


@pytest.mark.parametrize(
    ("redirection", "code"), [("<&- >&- 2>&-", 0), (">/dev/full 2>/dev/full", EXIT_FAILED)]
)
def test_a_real_time_run_is_complete_with_any_output(
    tmp_path: Path, redirection: str, code: int
) -> None:
    done = shell(f"{CONVOY} {SHORT} --out {tmp_path}/run {redirection}")
    assert done.returncode == code
    assert not LogReader(tmp_path / "run" / LOG_NAME).damage
    assert (tmp_path / "run" / SUMMARY_NAME).exists()


def test_missing_characters_of_an_encoding_are_replaced(expected: tuple[bytes, bytes]) -> None:
    assert b"seed 1, ? 0.5" in expected[1]


PRINTING = ("check", "list", "reference links", "new", "channel show bursty --json")


@pytest.mark.spread(3)
@pytest.mark.parametrize("command", PRINTING)
@pytest.mark.parametrize(
    ("redirection", "code"), [("| head -1", 0), ("2>/dev/full", 0), (">/dev/full", EXIT_FAILED)]
)
def test_a_printing_command_fails_only_if_its_output_is_lost(
    command: str, redirection: str, code: int
) -> None:
    assert shell(f"{CONVOY} {command} {redirection}").returncode == code


@pytest.mark.spread(2)
@pytest.mark.parametrize("redirection", [">&-", "2>&-", "<&- >&- 2>&-", ">/dev/full 2>/dev/full"])
def test_a_refusal_keeps_its_exit_code_with_any_output(redirection: str) -> None:
    assert shell(f"{CONVOY} run --loss 3 {redirection}").returncode == EXIT_BAD_INPUT


@contextmanager
def stuck_pipe(*, blocking: bool) -> Iterator[tuple[int, int]]:
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writing, bytes(4096))
    os.set_blocking(writing, blocking)
    try:
        yield reading, writing
    finally:
        os.close(reading)
        os.close(writing)


@pytest.mark.parametrize("blocking", [False, True], ids=["non-blocking", "blocking"])
def test_progress_that_nobody_reads_is_dropped(*, blocking: bool) -> None:
    with stuck_pipe(blocking=blocking) as (reading, writing):
        output = Output(writing, "wb", closefd=False)
        output.patience_s = 0.2
        began = time.monotonic()
        for _ in range(100):
            assert output.write(b"x" * 100_000) == 100_000
        assert 0.1 < time.monotonic() - began < 5.0
        assert output.failure is None
        while select.select([reading], [], [], 0.0)[0]:
            os.read(reading, 65536)
        assert output.write(b"back") == 4
        assert os.read(reading, 10) == b"back"


@pytest.mark.spread(1)
@pytest.mark.parametrize("blocking", [True, False], ids=["blocking", "non-blocking"])
def test_a_run_ends_whose_errors_nobody_reads(tmp_path: Path, *, blocking: bool) -> None:
    arguments = ("--set=duration_s=1", "--set=convoy.vehicles=2", "--out=run")
    with stuck_pipe(blocking=blocking) as (_, writing):
        done = subprocess.run(
            [sys.executable, "-m", "scenarios.cli", "run", "lane_change", *arguments],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            stdout=subprocess.PIPE,
            stderr=writing,
            timeout=60.0,
            check=False,
        )
    assert done.returncode == 0
    assert b"OK" in done.stdout


@pytest.mark.spread(1)
@pytest.mark.parametrize("command", PRINTING)
def test_no_command_needs_utf_8(command: str) -> None:
    assert shell(f"{CONVOY} {command}", PYTHONIOENCODING="ascii").returncode == 0
