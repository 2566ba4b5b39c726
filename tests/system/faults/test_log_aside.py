"""A run in virtual time whose log another process writes: whichever of both is killed."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from scenarios.studies.engine.fleet import cores
from tests.system.logs import Run, assert_sound
from tests.system.processes import until

pytestmark = pytest.mark.skipif(
    cores() < 2 or sys.platform != "linux", reason="here a run writes its log itself"
)
ENOUGH_BYTES = 1_000_000


@contextmanager
def run_under_way(folder: Path) -> Iterator[tuple["subprocess.Popen[str]", psutil.Process]]:
    """A run and the process that writes its log, some of which is in the file already."""
    command = [sys.executable, "-m", "scenarios.cli", "run", "highway", "--clock=virtual"]
    with subprocess.Popen(
        [*command, "--quiet", "--out=run"], cwd=folder, stderr=subprocess.PIPE, text=True
    ) as process:
        log = folder / "run" / "run.mcap"
        try:
            until(lambda: log.exists() and log.stat().st_size > ENOUGH_BYTES)
            [writer] = [
                one for one in psutil.Process(process.pid).children() if one.name() == "convoy-log"
            ]
            yield process, writer
        finally:
            process.kill()


def test_if_the_run_is_killed_its_log_is_completed_and_nothing_is_left(tmp_path: Path) -> None:
    with run_under_way(tmp_path) as (process, writer):
        process.kill()
        process.wait()
        until(lambda: not writer.is_running())
    assert_sound(tmp_path / "run" / "run.mcap")
    assert len(Run(tmp_path / "run").messages) > 1000


def test_if_the_writer_is_killed_the_run_fails_with_one_line_and_a_sound_log(
    tmp_path: Path,
) -> None:
    with run_under_way(tmp_path) as (process, writer):
        writer.send_signal(signal.SIGTERM)  # it is deaf to that
        writer.kill()
        _, complaint = process.communicate(timeout=60.0)
    assert process.returncode == 1
    said = complaint.splitlines()[-1]
    assert said.endswith("run.mcap: cannot write the log: the process that writes it has ended")
    assert "Traceback" not in complaint
    run = Run(tmp_path / "run")
    assert run.summary["reason"] == said
    assert_sound(run.log)
    assert len(run.messages) > 1000
