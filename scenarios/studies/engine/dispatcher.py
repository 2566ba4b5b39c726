"""Send jobs to workers in batches and collect their outcomes.

If a worker dies, the jobs of its batch are retried one by one, to isolate a job that kills workers.
"""

from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass
from math import ceil
from typing import Any

from scenarios.results.versions import current_stamp
from scenarios.studies.engine.job import EngineError, Job, JobResult, error_line, run_batch
from scenarios.studies.engine.workers import POLL_INTERVAL_S, WorkerGroup

TARGET_BATCH_S = 1.5
"""Target duration of a batch; submitting it takes milliseconds."""
MAX_ATTEMPTS = 3
WORKER_DIED = "the worker process died at each attempt"


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The result of the job `key`, or its error.

    `exception` is set if the command line prints it unchanged. `abandoned` jobs killed their
    workers.
    """

    key: str
    result: Any = None
    error: str = ""
    exception: Exception | None = None
    abandoned: bool = False


class BatchSizer:
    """Number of jobs per batch, from their mean duration."""

    def __init__(self) -> None:
        self._jobs = 0
        self._total_s = 0.0

    def add(self, results: list[JobResult]) -> None:
        self._jobs += len(results)
        self._total_s += sum(result.duration_s for result in results)

    def size(self, waiting: int, slots: int) -> int:
        """Jobs for the next batch; the last jobs are spread over all slots."""
        if not self._jobs:
            return 1
        mean_s = max(self._total_s / self._jobs, TARGET_BATCH_S / 1000)
        return max(1, min(ceil(TARGET_BATCH_S / mean_s), ceil(waiting / slots)))


class JobDispatcher:
    """Run `jobs` on workers. Outcomes depend neither on the batches nor on the workers."""

    def __init__(
        self,
        jobs: Sequence[Job],
        workers: WorkerGroup,
        sizer: BatchSizer | None = None,
        plug_ins: Mapping[str, str] | None = None,
        idle: Callable[[], None] = lambda: None,
    ) -> None:
        """`plug_ins` are digests that workers must have, see `run_batch`.

        `idle` is called each second while jobs run.
        """
        self._idle = idle
        self._plug_ins = dict(plug_ins or {})
        self._jobs = {job.key: job.work for job in jobs}
        self._workers = workers
        self._waiting = deque(self._jobs)
        self._retries: deque[str] = deque()
        self._attempts: Counter[str] = Counter()
        self._running: dict[Future[list[JobResult]], list[str]] = {}
        self._sizer = sizer or BatchSizer()

    def outcomes(self) -> Iterator[Outcome]:
        while self._waiting or self._retries or self._running:
            self._submit_batches()
            done, _ = wait(self._running, timeout=POLL_INTERVAL_S, return_when=FIRST_COMPLETED)
            self._idle()
            for future in done:
                yield from self._collect(self._running.pop(future), future)

    def _submit_batches(self) -> None:
        slots, stamp = self._workers.slots(), current_stamp()
        while len(self._running) < slots and (self._retries or self._waiting):
            if self._retries:
                keys = [self._retries.popleft()]
            else:
                size = min(self._sizer.size(len(self._waiting), slots), len(self._waiting))
                keys = [self._waiting.popleft() for _ in range(size)]
            jobs = [self._jobs[key] for key in keys]
            try:
                future = self._workers.executor.submit(run_batch, stamp, jobs, self._plug_ins)
            except self._workers.worker_lost as error:
                why = f"all workers are lost: {error_line(error)}"
                raise EngineError([why]) from error
            self._running[future] = keys

    def _collect(self, keys: list[str], future: Future[list[JobResult]]) -> Iterator[Outcome]:
        try:
            results = future.result()
        except self._workers.worker_lost as error:
            yield from self._retry(keys, isinstance(error, self._workers.no_retry))
            return
        except EngineError:
            raise
        except CancelledError as error:
            raise EngineError(["lost the connection to the scheduler"]) from error
        except Exception as error:
            raise EngineError([f"a worker failed: {error_line(error)}"]) from error
        self._sizer.add(results)
        for key, done in zip(keys, results, strict=True):
            yield Outcome(key=key, result=done.result, error=done.error, exception=done.exception)

    def _retry(self, keys: list[str], no_retry: bool) -> Iterator[Outcome]:
        for key in keys:
            self._attempts[key] += 1
            if self._attempts[key] >= MAX_ATTEMPTS or (no_retry and len(keys) == 1):
                yield Outcome(key=key, error=WORKER_DIED, abandoned=True)
            else:
                self._retries.append(key)
