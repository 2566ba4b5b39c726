"""Jobs on worker processes: all results, and no further jobs after a failure."""

import os
from functools import partial
from pathlib import Path

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.studies.job import Job
from tests.made.many.engines import engine_here


def write_pid(path: Path) -> int:
    path.write_text(str(os.getpid()), encoding="utf-8")
    return os.getpid()


def marker_jobs(folder: Path, *names: str) -> list[Job]:
    return [Job(key=name, work=partial(write_pid, folder / name)) for name in names]


def test_jobs_run_in_worker_processes(tmp_path: Path) -> None:
    with engine_here(1) as engine:
        done = engine.results(marker_jobs(tmp_path, "one", "other"))
    assert done == [int((tmp_path / name).read_text()) for name in ("one", "other")]
    assert len(set(done)) == 1
    assert os.getpid() not in done


def test_without_workers_jobs_run_here_in_order(tmp_path: Path) -> None:
    with engine_here() as engine:
        found = [
            (key, done.result) for key, done in engine.outcomes(marker_jobs(tmp_path, "b", "a"))
        ]
    assert found == [("b", os.getpid()), ("a", os.getpid())]


@pytest.mark.parametrize("workers", [0, 1])
def test_no_job_starts_after_a_failure(tmp_path: Path, workers: int) -> None:
    jobs = [Job(key="bad", work=partial(int, "none")), *marker_jobs(tmp_path, *"abcde")]
    with engine_here(workers) as engine, pytest.raises(ScenarioError, match="invalid literal"):
        engine.results(jobs)
    assert len(list(tmp_path.iterdir())) <= workers
