"""Jobs on worker processes: all results, and no more work once one has failed."""

import os
import time
from functools import partial
from pathlib import Path

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.studies.engine.job import Job
from tests.made.many.engines import engine_here


def leave_a_mark(path: Path) -> int:
    path.write_text(str(os.getpid()), encoding="utf-8")
    return os.getpid()


def marks(folder: Path, *names: str) -> list[Job]:
    return [Job(key=name, work=partial(leave_a_mark, folder / name)) for name in names]


def test_jobs_are_done_by_worker_processes(tmp_path: Path) -> None:
    with engine_here(1) as engine:
        done = engine.results(marks(tmp_path, "one", "other"))
    assert done == [int((tmp_path / name).read_text()) for name in ("one", "other")]
    assert len(set(done)) == 1
    assert os.getpid() not in done


def test_without_workers_they_are_done_here_in_order(tmp_path: Path) -> None:
    with engine_here() as engine:
        found = [(one.key, one.result) for one in engine.outcomes(marks(tmp_path, "b", "a"))]
    assert found == [("b", os.getpid()), ("a", os.getpid())]


@pytest.mark.parametrize("workers", [0, 1])
def test_after_one_that_fails_no_more_are_begun(tmp_path: Path, workers: int) -> None:
    jobs = [Job(key="bad", work=partial(int, "none")), *marks(tmp_path, *"abcde")]
    with engine_here(workers) as engine, pytest.raises(ScenarioError, match="invalid literal"):
        engine.results(jobs)
    assert len(list(tmp_path.iterdir())) <= workers


def test_a_caller_that_stops_iterating_stops_the_work(tmp_path: Path) -> None:
    jobs = [Job(key=str(k), work=partial(_marks_and_waits, tmp_path / str(k))) for k in range(50)]
    with engine_here(1) as engine:
        next(engine.outcomes(jobs))
    assert len(list(tmp_path.iterdir())) < 40


def _marks_and_waits(path: Path) -> None:
    leave_a_mark(path)
    time.sleep(0.05)
