"""Studies with killed workers, and killed sweeps, write the files of an undisturbed study."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest
from click.testing import CliRunner

from scenarios.cli.main import cli
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from scenarios.studies import workers as pool
from scenarios.studies.engine import JOURNAL, Entry, RunJournal
from scenarios.studies.workers import WorkerPool
from tests.made.ended import has_ended
from tests.made.many.planted_losses import TINY, planted
from tests.made.many.small_convoy import SETTINGS

SMALL = [f"--set={one}" for one in SETTINGS]
SHORT = ["--set=duration_s=2.5", "--set=convoy.vehicles=2"]
BISECT = ["bisect", "lossy_lane_change", "links.loss_ratio", "--limit=error_m=1", *SMALL]
STUDIES = {
    "sweep": ["sweep", "lane_change", *SHORT, "--vary=links.loss_ratio=0,0.8", "--seeds=3",
              "--out=out"],
    "bisect": [*BISECT, "--precision=0.1", "--runs=40", "--out=out"],
    "drill": ["drill", "drill.toml", "--seeds=4", "--out=out"],
    "blame": ["blame", "log", "--runs=30", "--out=out"],
}  # fmt: skip
DRILL = """
extends = "lane_change"
name = "drill"
description = "two seconds"
duration_s = 2.0
convoy.vehicles = 2
limits.cross_track_error_m_max = 0.5
"""
FILES = {"*.json", "*.csv", "*.png", "*.toml"}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    (folder / "drill.toml").write_text(DRILL)
    run_virtual(planted(TINY, 3).scenario, folder / "log", Stop())
    return folder


@pytest.fixture
def places(inputs: Path, tmp_path: Path) -> Path:
    for name in ("undisturbed", "disturbed"):
        (tmp_path / name / "out").mkdir(parents=True)
        for one in inputs.iterdir():
            (tmp_path / name / one.name).symlink_to(one)
    return tmp_path


def carried_out(folder: Path, study: str, *more: str) -> dict[str, bytes]:
    os.chdir(folder)
    done = CliRunner().invoke(cli, [*STUDIES[study], *more])
    assert done.exit_code == 0, done.output
    files = [file for pattern in FILES for file in Path("out").glob(pattern)]
    assert files
    return {file.name: file.read_bytes() for file in files}


@pytest.fixture(autouse=True)
def own_folder() -> Iterator[None]:
    before = Path.cwd()
    yield
    os.chdir(before)


class DeadlyPool(WorkerPool):
    def __init__(self, workers: int) -> None:
        super().__init__(workers)
        self._jobs = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:  # noqa: ARG002 - none are given
        self._jobs += 1
        return super().submit(partial(_killed, fn) if self._jobs in {2, 3} else fn, *args)


def _killed(fn: Callable[..., Any], *arguments: Any) -> Any:
    fn(*arguments)
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.spread(2)
@pytest.mark.parametrize("study", STUDIES)
def test_killed_workers_change_no_file(
    study: str, places: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = carried_out(places / "undisturbed", study, "--workers=0")
    monkeypatch.setattr(pool, "WorkerPool", DeadlyPool)
    assert carried_out(places / "disturbed", study, "--workers=2") == wanted


class Killed(BaseException):
    """Stands for SIGKILL."""


def test_a_killed_sweep_resumes(places: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept, add = list[str](), RunJournal.add

    def add_or_fail(journal: RunJournal, key: str, entry: Entry) -> Entry:
        kept.append(key)
        found = add(journal, key, entry)
        if len(kept) == killed_after:
            raise Killed
        return found

    monkeypatch.setattr(RunJournal, "add", add_or_fail)
    killed_after = 0
    wanted = carried_out(places / "undisturbed", "sweep", "--workers=0")
    jobs = kept.copy()
    kept.clear()
    assert len(jobs) > 3
    for killed_after in (1, len(jobs) // 2):
        with pytest.raises(Killed):
            carried_out(places / "disturbed", "sweep", "--workers=0")
        assert Path("out", JOURNAL).read_bytes().count(b"\n") == killed_after + 1
    assert carried_out(places / "disturbed", "sweep", "--workers=0") == wanted
    assert sorted(kept) == sorted(jobs), "each job was done once"
    assert Path("out", JOURNAL).exists()


def workers_of(driver: "subprocess.Popen[str]") -> list[psutil.Process]:
    end = time.monotonic() + 120.0
    while time.monotonic() < end:
        workers = psutil.Process(driver.pid).children(recursive=True)
        if len(workers) > 2:
            return workers
        time.sleep(0.005)
    pytest.fail("no work was begun")


def wait_until_ended(processes: list[psutil.Process]) -> None:
    end = time.monotonic() + 60.0
    while not all(map(has_ended, processes)):
        assert time.monotonic() < end
        time.sleep(0.01)


def test_sigterm_ends_a_study_with_one_line_and_leaves_no_process(places: Path) -> None:
    command = [sys.executable, "-m", "scenarios.cli", *STUDIES["sweep"], "--workers=2"]
    with subprocess.Popen(
        command, cwd=places / "disturbed", stderr=subprocess.PIPE, text=True
    ) as driver:
        assert driver.stderr is not None
        workers = workers_of(driver)
        driver.terminate()
        lines = driver.stderr.read().splitlines()
    assert driver.returncode == 128 + signal.SIGTERM
    wait_until_ended(workers)
    assert [line for line in lines if " runs" not in line] == ["stopped by SIGTERM"]
