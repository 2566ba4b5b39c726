"""Each job has a result or an error with any executor, even if workers die."""

import os
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.errors import ScenarioError
from scenarios.definition.versions import current_stamp, module_digests
from scenarios.studies.engine import (
    MAX_ATTEMPTS,
    WORKER_DIED,
    open_journal,
    outcomes_of,
    study_engine,
)
from scenarios.studies.job import Job, Work, run_job
from scenarios.studies.workers import InlineExecutor, WorkerGroup, open_workers
from tests.made.many.engines import engine_here


def square(number: int) -> int:
    if number < 0:
        raise ValueError("a number\nbelow 0")
    return number * number


def refuse() -> None:
    raise ScenarioError(["gap_m: given 1", "seed: given -1"])


def leave() -> None:
    raise SystemExit(3)


def jobs_of(works: Mapping[Any, Work]) -> list[Job]:
    return [Job(key=str(key), work=work) for key, work in works.items()]


def outcomes(works: Mapping[Any, Work], workers: WorkerGroup) -> dict[str, tuple[Any, str]]:
    found = [(key, done[:2]) for key, done in outcomes_of(jobs_of(works), workers)]
    assert len(dict(found)) == len(found)
    return dict(found)


def threads(executor: Executor) -> WorkerGroup:
    return WorkerGroup(executor=executor, slots=lambda: 3)


def test_executors_give_the_same_outcomes() -> None:
    jobs = {k: partial(square, k) for k in range(40)}
    wanted = {str(k): (k * k, "") for k in range(40)}
    assert outcomes(jobs, WorkerGroup(executor=InlineExecutor(), slots=lambda: 1)) == wanted
    with ThreadPoolExecutor(3) as pool:
        assert outcomes(jobs, threads(pool)) == wanted


def test_an_error_is_one_line_and_the_other_jobs_run() -> None:
    jobs: dict[str, Work] = {
        "bad": partial(square, -1),
        "refused": refuse,
        "left": leave,
        "good": partial(square, 3),
    }
    with open_workers(0) as workers:
        found = outcomes(jobs, workers)
    assert found["good"] == (9, "")
    assert found["refused"] == (None, "gap_m: given 1; seed: given -1")
    assert found["left"][1].startswith("SystemExit: 3 (test_engine.py, line ")
    assert found["bad"][1].startswith("ValueError: a number below 0 (test_engine.py, line ")


class Deadly(Executor):
    def __init__(self, poison: set[int], killed_at: set[int]) -> None:
        self.poison = poison
        self.killed_at = killed_at
        self.calls = 0
        self.tried: Counter[int] = Counter()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **_kwargs: Any) -> "Future[Any]":
        number = args[1].args[0]
        self.calls += 1
        future: Future[Any] = Future()
        if number in self.poison or self.calls in self.killed_at:
            self.tried[number] += 1
            future.set_exception(BrokenExecutor("dead"))
        else:
            future.set_result(fn(*args))
        return future


@given(
    poison=st.sets(st.integers(0, 59), max_size=5),
    killed_at=st.sets(st.integers(1, 60), max_size=1),
)
def test_only_jobs_that_kill_workers_are_abandoned(poison: set[int], killed_at: set[int]) -> None:
    executor = Deadly(poison, killed_at)
    jobs = {k: partial(square, k) for k in range(60)}
    found = outcomes(jobs, threads(executor))
    assert {int(k) for k, (_, error) in found.items() if error} == poison
    assert all(found[str(k)] == (None, WORKER_DIED) for k in poison)
    assert all(found[str(k)] == (k * k, "") for k in jobs.keys() - poison)
    assert all(executor.tried[k] == MAX_ATTEMPTS for k in poison)


def killed_once(mark: Path) -> str:
    if not mark.exists():
        mark.touch()
        os._exit(9)
    return "alive"


def test_a_killed_process_is_replaced(tmp_path: Path) -> None:
    jobs: dict[Any, Work] = {"deadly": partial(killed_once, tmp_path / "mark")}
    jobs |= {k: partial(square, k) for k in range(3)}
    with open_workers(1) as workers:
        found = outcomes(jobs, workers)
    assert found == {"deadly": ("alive", ""), "0": (0, ""), "1": (1, ""), "2": (4, "")}


class Gone(Executor):
    def submit(self, _fn: Callable[..., Any], /, *_args: Any, **_kwargs: Any) -> "Future[Any]":
        raise BrokenExecutor("none left")


def test_lost_workers_are_one_error_line() -> None:
    with pytest.raises(ScenarioError, match=r"workers are lost.*none left"):
        list(outcomes_of(jobs_of({1: partial(square, 1)}), threads(Gone())))


def test_a_job_that_kills_its_workers_is_one_line_with_its_command() -> None:
    job = Job(key="deadly", work=partial(os._exit, 9), command="convoy run lane_change --seed 7")
    with engine_here(1) as engine, pytest.raises(ScenarioError) as error:
        engine.results([job])
    assert error.value.lines == (f"convoy run lane_change --seed 7: {WORKER_DIED}",)


def test_a_job_that_kills_its_workers_is_not_kept(tmp_path: Path) -> None:
    deadly = Job(key="deadly", work=partial(os._exit, 9))
    with (
        open_journal(tmp_path, {}, print) as journal,
        study_engine(partial(open_workers, 1), print, journal=journal) as engine,
    ):
        ((_, found),) = engine.outcomes([deadly])
        assert found.error == WORKER_DIED
        assert not journal.entries


def test_no_more_jobs_run_after_the_caller_stops(tmp_path: Path) -> None:
    jobs = jobs_of({k: (tmp_path / str(k)).touch for k in range(100)})
    with open_workers(0) as workers, suppress(StopIteration):
        next(outcomes_of(jobs, workers))
    assert len(list(tmp_path.iterdir())) < 10


def test_a_worker_with_another_controller_runs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "law_of_worker.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    done: list[int] = []
    (digest,) = module_digests(["law_of_worker"]).values()
    run_job(current_stamp(), lambda: done.append(1), {"law_of_worker": digest})
    with pytest.raises(ScenarioError, match=f"law_of_worker is {digest} there and 0000"):
        run_job(current_stamp(), lambda: done.append(2), {"law_of_worker": "0" * 12})
    assert done == [1]


def test_a_worker_with_other_versions_runs_nothing_and_names_the_differences() -> None:
    done: list[int] = []
    here = current_stamp()
    driver = replace(here, numpy="1.0", sources="0" * 12)
    with pytest.raises(ScenarioError) as refused:
        run_job(driver, lambda: done.append(1), {})
    (line,) = refused.value.lines
    for fact in (f"numpy is {here.numpy}", "1.0", f"sources is {here.sources}"):
        assert fact in line
    assert not done


def test_results_keep_the_order_and_errors_name_the_command() -> None:
    with engine_here() as engine:
        assert engine.results(jobs_of({k: partial(square, k) for k in (2, 0, 1)})) == [4, 0, 1]
        bad = Job(key="bad", work=partial(square, -1), command="convoy run lane_change --seed 1")
        with pytest.raises(ScenarioError, match=r"^convoy run lane_change --seed 1: ValueError"):
            engine.results([bad])
        with pytest.raises(ScenarioError, match=r"^gap_m: given 1\nseed"):
            engine.results(jobs_of({"refused": refuse}))
