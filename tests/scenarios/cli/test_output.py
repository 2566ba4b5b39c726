"""Commands with a standard output that is closed, full or not UTF-8."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.runs.stop import EXIT_BAD_INPUT, EXIT_FAILED
from transport.log.reader import LogReader

CONVOY = f"{sys.executable} -m scenarios.cli"
SHORT = "run --set duration_s=0.5"
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
def expected(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Log of a run with normal output."""
    folder = tmp_path_factory.mktemp("expected")
    assert shell(f"{CONVOY} {SHORT} --clock virtual --out {folder}/run").returncode == 0
    return (folder / "run" / LOG_NAME).read_bytes()


@pytest.mark.spread(2)
@pytest.mark.parametrize(
    ("redirection", "code"),
    [(">&-", 0), ("2>&-", 0), ("<&- >&- 2>&-", 0), (">/dev/full", EXIT_FAILED)],
)
def test_the_log_of_a_virtual_run_does_not_depend_on_its_output(
    tmp_path: Path, redirection: str, code: int, expected: bytes
) -> None:
    done = shell(f"{CONVOY} {SHORT} --clock virtual --out {tmp_path}/run {redirection}")
    assert done.returncode == code
    assert (tmp_path / "run" / LOG_NAME).read_bytes() == expected
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


def test_missing_characters_of_an_encoding_are_replaced(tmp_path: Path) -> None:
    done = shell(
        f"{CONVOY} {SHORT} --clock virtual --out {tmp_path}/run", PYTHONIOENCODING="latin-1"
    )
    assert done.returncode == 0
    assert b"seed 1, ? 0.5" in done.stdout


PRINTING = ("list", "check --explain", "reference links", "new", "channel show bursty --json")


@pytest.mark.parametrize("command", PRINTING)
@pytest.mark.parametrize(
    ("redirection", "code"), [("| head -1", 0), ("2>/dev/full", 0), (">/dev/full", EXIT_FAILED)]
)
def test_a_printing_command_fails_only_if_its_output_is_lost(
    command: str, redirection: str, code: int
) -> None:
    assert shell(f"{CONVOY} {command} {redirection}").returncode == code


@pytest.mark.parametrize("redirection", [">&-", "2>&-", "<&- >&- 2>&-", ">/dev/full 2>/dev/full"])
def test_a_refusal_keeps_its_exit_code_with_any_output(redirection: str) -> None:
    assert shell(f"{CONVOY} report nowhere {redirection}").returncode == EXIT_BAD_INPUT
    assert shell(f"{CONVOY} run --loss 3 {redirection}").returncode == EXIT_BAD_INPUT


@pytest.mark.parametrize("command", PRINTING)
def test_no_command_needs_utf_8(command: str) -> None:
    assert shell(f"{CONVOY} {command}", PYTHONIOENCODING="ascii").returncode == 0
