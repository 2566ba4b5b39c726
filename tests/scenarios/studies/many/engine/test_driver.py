"""Every job is done or has its error, whatever the executor and however often its workers die."""

import os
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.errors import ScenarioError
from scenarios.studies.many.engine.batch import JobAnswer
from scenarios.studies.many.engine.countdown import Countdown
from scenarios.studies.many.engine.driver import (
    BATCH_S,
    DEADLY,
    MOST_DEATHS,
    JobDriver,
    Pace,
    run_all,
)
from scenarios.studies.many.engine.fleet import Fleet, ThisProcess, fleet_of


def square(number: int) -> int:
    if number < 0:
        raise ValueError("a number\nbelow 0")
    return number * number


def refuse() -> None:
    raise ScenarioError(["gap_m: given 1", "seed: given -1"])


def leave() -> None:
    raise SystemExit(3)


def outcomes(jobs: dict[Any, Callable[[], Any]], fleet: Fleet) -> dict[Any, tuple[Any, str]]:
    found = [(one.key, (one.result, one.error)) for one in JobDriver(jobs, fleet).outcomes()]
    assert len(dict(found)) == len(found)
    return dict(found)


def threads(executor: Executor) -> Fleet:
    return Fleet(executor=executor, slots=lambda: 3)


def test_any_executor_does() -> None:
    jobs: dict[Any, Callable[[], Any]] = {k: partial(square, k) for k in range(40)}
    wanted = {k: (k * k, "") for k in range(40)}
    assert outcomes(jobs, Fleet(executor=ThisProcess(), slots=lambda: 1)) == wanted
    with ThreadPoolExecutor(3) as pool:
        assert outcomes(jobs, threads(pool)) == wanted


def test_a_job_that_raises_is_a_line_and_the_others_are_done() -> None:
    jobs: dict[Any, Callable[[], Any]] = {
        "bad": partial(square, -1),
        "refused": refuse,
        "left": leave,
        "good": partial(square, 3),
    }
    with fleet_of(0) as fleet:
        found = outcomes(jobs, fleet)
    assert found["good"] == (9, "")
    assert found["refused"] == (None, "gap_m: given 1; seed: given -1")
    assert found["left"][1].startswith("SystemExit: 3 (test_driver.py, line ")
    assert found["bad"][1].startswith("ValueError: a number below 0 (test_driver.py, line ")


class Deadly(Executor):
    """Its worker dies under a batch with one of `poison`, and from outside now and then."""

    def __init__(self, poison: set[int], killed_at: set[int]) -> None:
        self.poison = poison
        self.killed_at = killed_at
        self.calls = 0
        self.tried: Counter[int] = Counter()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **_kwargs: Any) -> "Future[Any]":
        jobs: Sequence[partial[int]] = args[1]
        numbers = [job.args[0] for job in jobs]
        self.calls += 1
        future: Future[Any] = Future()
        if self.poison & set(numbers) or self.calls in self.killed_at:
            self.tried.update(numbers)
            future.set_exception(BrokenExecutor("dead"))
        else:
            future.set_result(fn(*args))
        return future


@given(
    poison=st.sets(st.integers(0, 59), max_size=5),
    killed_at=st.sets(st.integers(1, 60), max_size=2),  # fewer than make a job be given up
)
def test_what_kills_its_worker_is_given_up_and_nothing_else(
    poison: set[int], killed_at: set[int]
) -> None:
    executor = Deadly(poison, killed_at)
    jobs: dict[Any, Callable[[], Any]] = {k: partial(square, k) for k in range(60)}
    found = outcomes(jobs, threads(executor))
    innocent = {k for k, count in executor.tried.items() if k not in poison and count >= 3}
    assert not innocent, "killed with poison in a batch once, and from outside twice"
    assert {k for k, (_, error) in found.items() if error} == poison
    assert all(found[k] == (None, DEADLY) for k in poison)
    assert all(found[k] == (k * k, "") for k in jobs.keys() - poison)
    assert all(executor.tried[k] == MOST_DEATHS for k in poison)


def killed_once(mark: Path) -> str:
    if not mark.exists():
        mark.touch()
        os._exit(9)
    return "alive"


def test_a_killed_process_costs_time_only(tmp_path: Path) -> None:
    jobs: dict[Any, Callable[[], Any]] = {"deadly": partial(killed_once, tmp_path / "mark")}
    jobs |= {k: partial(square, k) for k in range(3)}
    with fleet_of(1) as fleet:
        found = outcomes(jobs, fleet)
    assert found == {"deadly": ("alive", ""), 0: (0, ""), 1: (1, ""), 2: (4, "")}


class Gone(Executor):
    """An executor whose workers are gone for good."""

    def submit(self, _fn: Callable[..., Any], /, *_args: Any, **_kwargs: Any) -> "Future[Any]":
        raise BrokenExecutor("none left")


def test_workers_that_are_gone_for_good_are_one_line() -> None:
    with pytest.raises(ScenarioError, match=r"^the workers are gone.*none left"):
        list(JobDriver({1: partial(square, 1)}, threads(Gone())).outcomes())


def test_run_all_has_the_shape_of_run_jobs_and_stops_at_an_error() -> None:
    with fleet_of(0) as fleet:
        assert dict(run_all({k: partial(square, k) for k in range(3)}, fleet)) == {0: 0, 1: 1, 2: 4}
        with pytest.raises(ScenarioError, match=r"^-1: ValueError"):
            list(run_all({-1: partial(square, -1)}, fleet))


@given(took_s=st.floats(0.0, 100.0), waiting=st.integers(1, 5000), slots=st.integers(1, 64))
def test_a_batch_takes_a_second_or_more_or_is_a_fair_share(
    took_s: float, waiting: int, slots: int
) -> None:
    pace = Pace()
    assert pace.size(waiting, slots) == 1
    pace.learn([JobAnswer(took_s=took_s), JobAnswer(took_s=took_s)])
    size = pace.size(waiting, slots)
    assert 1 <= size <= -(-waiting // slots)
    assert size * took_s >= 1.0 or size in {-(-waiting // slots), 1000}
    assert (size - 1) * took_s <= BATCH_S


def test_the_time_left_is_that_of_the_runs_after_the_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    said: list[str] = []
    countdown = Countdown(10, 4, said.append)
    for at in (30.0, 32.0, 33.0, 36.0, 38.0, 40.0):
        now[0] = at
        countdown.one_more()
    assert said == [
        "  30.0 s  5 of 10 runs",
        "  32.0 s  6 of 10 runs, 8 s left",
        "  36.0 s  8 of 10 runs, 4 s left",
        "  38.0 s  9 of 10 runs, 2 s left",
        "  40.0 s  10 of 10 runs",
    ]


def test_a_caller_that_stops_leaves_the_rest_undone(tmp_path: Path) -> None:
    jobs = {k: (tmp_path / str(k)).touch for k in range(100)}
    with fleet_of(0) as fleet, suppress(StopIteration):
        next(JobDriver(jobs, fleet).outcomes())
    assert len(list(tmp_path.iterdir())) < 10
