"""Dask workers produce the same tables as this process, even if a worker is killed.

For containers see tests/system/containers.
"""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.versions import current_stamp
from scenarios.studies import engine
from scenarios.studies.engine import JOURNAL
from scenarios.studies.job import Job
from scenarios.studies.many.files import run_sweep
from scenarios.studies.workers import open_workers
from tests.made.many.small_sweeps import run_sweep_here, small_plan, tables

distributed = pytest.importorskip("distributed")


@contextmanager
def local_cluster(*, processes: bool) -> Iterator[Any]:
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=processes,
        protocol="tcp",
        host="127.0.0.1",
        dashboard_address=None,
        worker_dashboard_address=None,
    ) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with local_cluster(processes=False) as cluster:
        yield cluster


def test_tables_equal_those_of_this_process(cluster: Any, tmp_path: Path) -> None:
    plan = small_plan(seeds=1)
    run_sweep_here(plan, tmp_path / "here")
    workers = partial(open_workers, None, cluster.scheduler_address)
    run_sweep(plan, tmp_path / "dask", workers, lambda _: None)
    assert tables(tmp_path / "dask") == tables(tmp_path / "here")


@pytest.mark.long
@pytest.mark.campaign(0, 3)
def test_a_killed_worker_process_does_not_change_the_tables(
    case: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenarios.studies.engine.REPORT_EVERY_S", 0.0)
    plan = small_plan(seeds=8)
    run_sweep_here(plan, tmp_path / "here")
    kill_after = 1 + 5 * case
    with local_cluster(processes=True) as cluster:
        victims = [worker.pid for worker in cluster.workers.values()][:1]

        def kill_one(_line: str) -> None:
            if victims and (tmp_path / "dask" / JOURNAL).read_bytes().count(b"\n") > kill_after:
                os.kill(victims.pop(), signal.SIGKILL)

        workers = partial(open_workers, None, cluster.scheduler_address)
        run_sweep(plan, tmp_path / "dask", workers, kill_one)
    assert not victims
    assert tables(tmp_path / "dask") == tables(tmp_path / "here")


def test_a_worker_with_other_versions_is_refused(
    cluster: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = replace(current_stamp(), numpy="0.1")
    monkeypatch.setattr(engine, "current_stamp", lambda: other)
    with (
        open_workers(scheduler=cluster.scheduler_address) as workers,
        pytest.raises(
            ScenarioError,
            match=r"^a worker has other versions: numpy .* 0\.1 ",
        ) as error,
    ):
        list(engine.outcomes_of([Job(key="1", work=os.getpid)], workers))
    assert len(error.value.lines) == 1


def test_a_missing_scheduler_is_one_error_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenarios.studies.workers.CONNECT_TIMEOUT_S", 0.5)
    with (
        pytest.raises(ScenarioError, match=r"^--scheduler: tcp://127.0.0.1:9: ") as error,
        open_workers(scheduler="tcp://127.0.0.1:9"),
    ):
        pass
    assert len(error.value.lines) == 1
