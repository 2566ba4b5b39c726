"""Hands out jobs in batches of a second or more and gathers their outcomes.

A batch whose worker died is tried again, each of its jobs alone from then on, so that a job that
kills its worker is found and the others of its batch are done.
"""

from collections import Counter, deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass
from math import ceil
from typing import Any

from scenarios.studies.engine.job import EngineError, Job, JobResult, error_line, run_batch
from scenarios.studies.engine.stamp import current_stamp
from scenarios.studies.engine.workers import POLL_INTERVAL_S, WorkerGroup

TARGET_BATCH_S = 1.5
"""Wanted duration of a batch, so that handing it out costs little in comparison."""
MAX_ATTEMPTS = 3
"""A job under which this many workers died is given up."""
WORKER_DIED = "its worker died, each time that it was tried"


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The result of the job `key`, or its error; `is_given_up` if it killed its workers.

    `raised` is the error itself if a command can print it as it is.
    """

    key: str
    result: Any = None
    error: str = ""
    exception: Exception | None = None
    abandoned: bool = False


class BatchSizer:
    """Number of jobs in a batch, from the mean time that they took."""

    def __init__(self) -> None:
        self._jobs = 0
        self._total_s = 0.0

    def add(self, answers: list[JobResult]) -> None:
        self._jobs += len(answers)
        self._total_s += sum(one.duration_s for one in answers)

    def size(self, waiting: int, slots: int) -> int:
        """Jobs for the next batch; the last ones are shared out evenly."""
        if not self._jobs:
            return 1
        mean_s = max(self._total_s / self._jobs, TARGET_BATCH_S / 1000)
        return max(1, min(ceil(TARGET_BATCH_S / mean_s), ceil(waiting / slots)))


class JobDispatcher:
    """Runs `jobs` on a fleet; neither batches nor workers change the outcomes."""

    def __init__(
        self, jobs: Sequence[Job], fleet: WorkerGroup, pace: BatchSizer | None = None
    ) -> None:
        self._jobs = {job.key: job.work for job in jobs}
        self._fleet = fleet
        self._waiting = deque(self._jobs)
        self._retries: deque[str] = deque()
        self._attempts: Counter[str] = Counter()
        self._running: dict[Future[list[JobResult]], list[str]] = {}
        self._pace = pace or BatchSizer()

    def outcomes(self) -> Iterator[Outcome]:
        while self._waiting or self._retries or self._running:
            self._submit_batches()
            done, _ = wait(self._running, timeout=POLL_INTERVAL_S, return_when=FIRST_COMPLETED)
            for future in done:
                yield from self._collect(self._running.pop(future), future)

    def _submit_batches(self) -> None:
        slots, stamp = self._fleet.slots(), current_stamp()
        while len(self._running) < slots and (self._retries or self._waiting):
            if self._retries:
                keys = [self._retries.popleft()]
            else:
                size = min(self._pace.size(len(self._waiting), slots), len(self._waiting))
                keys = [self._waiting.popleft() for _ in range(size)]
            jobs = [self._jobs[key] for key in keys]
            try:
                future = self._fleet.executor.submit(run_batch, stamp, jobs)
            except self._fleet.worker_lost as error:
                why = f"the workers are gone, and no others take their place: {error_line(error)}"
                raise EngineError([why]) from error
            self._running[future] = keys

    def _collect(self, keys: list[str], future: Future[list[JobResult]]) -> Iterator[Outcome]:
        try:
            answers = future.result()
        except self._fleet.worker_lost as error:
            yield from self._retry(keys, isinstance(error, self._fleet.no_retry))
            return
        except EngineError:
            raise
        except CancelledError as error:
            raise EngineError(["the scheduler is gone"]) from error
        except Exception as error:
            raise EngineError([f"a worker cannot do the work: {error_line(error)}"]) from error
        self._pace.add(answers)
        for key, one in zip(keys, answers, strict=True):
            yield Outcome(key=key, result=one.result, error=one.error, exception=one.exception)

    def _retry(self, keys: list[str], no_retry: bool) -> Iterator[Outcome]:
        """Retry each job of a batch whose worker died alone, up to `MOST_DEATHS` deaths."""
        for key in keys:
            self._attempts[key] += 1
            if self._attempts[key] >= MAX_ATTEMPTS or (no_retry and len(keys) == 1):
                yield Outcome(key=key, error=WORKER_DIED, abandoned=True)
            else:
                self._retries.append(key)
