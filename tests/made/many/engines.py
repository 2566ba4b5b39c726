"""Engines for tests: one in this process, one with synthetic results."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any

from scenarios.studies.engine import Engine, study_engine
from scenarios.studies.job import Job
from scenarios.studies.workers import open_workers


@contextmanager
def engine_here(workers: int | None = 0) -> Iterator[Engine]:
    """Start an engine without a journal, by default in this process."""
    with study_engine(partial(open_workers, workers), lambda _: None) as engine:
        yield engine


class SyntheticEngine(Engine):
    def __init__(self, result: Callable[[Job], Any]) -> None:
        super().__init__(partial(open_workers, 0), ExitStack(), lambda _: None)
        self._result = result

    def results(self, jobs: Sequence[Job]) -> list[Any]:
        return [self._result(job) for job in jobs]
