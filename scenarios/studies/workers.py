"""Workers: this process, a pool of processes, or the workers of a dask scheduler.

All are executors of `concurrent.futures`.
"""

import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import parent_process
from threading import Thread
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from scenarios.runs.processes.fork_server import fork_server, starting_processes
from scenarios.studies.job import EngineError

if TYPE_CHECKING:
    from distributed import Client


Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

JOBS_PER_THREAD = 2
"""Queue depth of a remote worker, so that it does not wait for the next job."""
POLL_INTERVAL_S = 1.0
"""Interval at which the workers of a scheduler are counted; they may join and leave."""
CONNECT_TIMEOUT_S = 10.0
RETRY_DELAYS_S = (0.0, 0.05, 0.5)
"""Delay before each attempt to start a worker: the fork server may not be ready."""
PRELOADED = ("scenarios.runs.virtual",)
"""Modules that the fork server imports once for all workers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerGroup:
    """An executor, and how many jobs to submit at a time.

    `worker_lost` are the exceptions of a job whose worker died, `no_retry` those of a job that
    the executor has already retried.
    """

    executor: Executor
    slots: Callable[[], int]
    worker_lost: tuple[type[BaseException], ...] = (BrokenExecutor,)
    no_retry: tuple[type[BaseException], ...] = ()


OpenWorkers = Callable[[], AbstractContextManager[WorkerGroup]]


class InlineExecutor(Executor):
    def submit(
        self, fn: Callable[Arguments, Result], /, *args: Arguments.args, **kwargs: Arguments.kwargs
    ) -> Future[Result]:
        future: Future[Result] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - raised by Future.result
            future.set_exception(error)
        return future


class WorkerPool(Executor):
    """Worker processes, each of which imports the project once.

    If a worker dies, its jobs raise `BrokenProcessPool`, and the next `submit` replaces it.
    Workers are forked from a single-threaded fork server, or spawned where there is no fork. They
    exit with this process, even if it is killed.
    """

    def __init__(self, workers: int) -> None:
        # The workers inherit both variables; see scenarios.cli.main.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # Python would warn of the cleanup after Ctrl-C.
        os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker:UserWarning")
        self._processes = [_new_process() for _ in range(workers)]
        self._futures: list[list[Future[Any]]] = [[] for _ in range(workers)]

    def submit(
        self, fn: Callable[Arguments, Result], /, *args: Arguments.args, **kwargs: Arguments.kwargs
    ) -> Future[Result]:
        self._futures = [
            [future for future in futures if not future.done()] for futures in self._futures
        ]
        place = min(range(len(self._futures)), key=lambda number: len(self._futures[number]))
        future = self._submit_to(place, partial(fn, *args, **kwargs))
        self._futures[place].append(future)
        return future

    def _submit_to(self, place: int, work: Callable[[], Result]) -> Future[Result]:
        """Submit to one worker; replace it if it died."""
        with starting_processes():
            for pause_s in RETRY_DELAYS_S:
                try:
                    return self._processes[place].submit(work)
                except (BrokenProcessPool, OSError, EOFError):  # the last two: the fork server died
                    self._processes[place] = _new_process()
                    time.sleep(pause_s)
            return self._processes[place].submit(work)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        for process in self._processes:
            process.shutdown(wait=False, cancel_futures=cancel_futures)
        for process in self._processes if wait else ():
            process.shutdown()


def _new_process() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, fork_server(PRELOADED), initializer=_start_worker)


def _start_worker() -> None:
    """Exit this worker when its parent is gone, even if it was killed; Ctrl-C is the parent's."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    parent = parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=watch, daemon=True).start()


def cores() -> int:
    return len(os.sched_getaffinity(0))


@contextmanager
def open_workers(workers: int | None = None, scheduler: str = "") -> Iterator[WorkerGroup]:
    """Start worker processes (None: one per core, 0: run in this process).

    With `scheduler`, an address such as tcp://127.0.0.1:8786, use the workers of that dask
    scheduler; needs the package distributed. Raises EngineError if no scheduler responds. At the
    end, pending jobs are cancelled.
    """
    if scheduler:
        with _dask_workers(scheduler) as group:
            yield group
    elif workers == 0:
        yield WorkerGroup(executor=InlineExecutor(), slots=lambda: 1)
    else:
        count = workers or cores()
        pool = WorkerPool(count)
        try:
            yield WorkerGroup(executor=pool, slots=lambda: count)
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _dask_workers(address: str) -> Iterator[WorkerGroup]:
    from distributed import Client, KilledWorker  # noqa: PLC0415 - optional and slow to import

    try:
        client = Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:  # includes TimeoutError
        why = f"no dask scheduler responds ({' '.join(str(error).split())})"
        raise EngineError([f"--scheduler: {address}: {why}"]) from error
    try:
        # A retried job must not get the cached result of an equal one.
        executor = client.get_executor(pure=False)
        worker_lost = (BrokenExecutor, KilledWorker)
        yield WorkerGroup(
            executor=executor,
            slots=_slots_of(client),
            worker_lost=worker_lost,
            no_retry=(KilledWorker,),
        )
        executor.shutdown(wait=False)
    finally:
        client.close()


def _slots_of(client: "Client") -> Callable[[], int]:
    """Return a function that counts the jobs to submit, from the number of worker threads."""
    counted_at, slots = -POLL_INTERVAL_S, 1

    def count() -> int:
        nonlocal counted_at, slots
        now = time.monotonic()
        if now - counted_at >= POLL_INTERVAL_S:
            threads: dict[str, Any] = client.nthreads()
            # Without workers, one job waits for the first to join.
            slots = max(JOBS_PER_THREAD * sum(threads.values()), 1)
            counted_at = now
        return slots

    return count
