"""Jobs on worker processes: all results, and no more work once one has failed."""

import os
import time
from functools import partial
from pathlib import Path

import pytest

from scenarios.runs.pool import run_jobs


def leave_a_mark(path: Path) -> int:
    path.write_text(str(os.getpid()), encoding="utf-8")
    return os.getpid()


def test_jobs_are_done_by_worker_processes(tmp_path: Path) -> None:
    jobs = {name: partial(leave_a_mark, tmp_path / name) for name in ("one", "other")}
    done = dict(run_jobs(jobs, 1))
    assert done == {name: int((tmp_path / name).read_text()) for name in jobs}
    assert len(set(done.values())) == 1
    assert os.getpid() not in done.values()


def test_without_workers_they_are_done_here_in_order(tmp_path: Path) -> None:
    jobs = {name: partial(leave_a_mark, tmp_path / name) for name in ("b", "a")}
    assert list(run_jobs(jobs, 0)) == [("b", os.getpid()), ("a", os.getpid())]


@pytest.mark.parametrize("workers", [0, 1])
def test_after_one_that_fails_no_more_are_begun(tmp_path: Path, workers: int) -> None:
    jobs = {
        "bad": partial(int, "none"),
        **{str(k): partial(leave_a_mark, tmp_path / str(k)) for k in range(5)},
    }
    with pytest.raises(ValueError, match="invalid literal"):
        list(run_jobs(jobs, workers))
    assert len(list(tmp_path.iterdir())) <= workers


def test_who_stops_listening_stops_the_work(tmp_path: Path) -> None:
    jobs = {str(k): partial(leave_a_mark, tmp_path / str(k)) for k in range(50)}
    for _ in run_jobs(jobs, 1):
        break
    time.sleep(0.1)
    assert len(list(tmp_path.iterdir())) < 10
