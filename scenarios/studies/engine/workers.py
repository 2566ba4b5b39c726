"""The workers: this process, a pool of processes, or those of a dask scheduler.

All are executors of `concurrent.futures`; a fleet adds how much to hand out at once, and which
exceptions of a batch mean that its worker died.
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
from multiprocessing import get_all_start_methods, get_context, parent_process
from threading import Thread
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from scenarios.studies.engine.job import EngineError

if TYPE_CHECKING:
    from distributed import Client

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

BATCHES_PER_THREAD = 2
"""Batches for each thread of a remote worker, so that the next is ready at once."""
POLL_INTERVAL_S = 1.0
"""Interval between two looks at a scheduler's workers, which come and go."""
CONNECT_TIMEOUT_S = 10.0
RETRY_DELAYS_S = (0.0, 0.05, 0.5)
"""Before each further attempt to start a worker: the process it is forked from may not be up."""
PRELOADED = tuple(f"scenarios.runs.virtual.{name}" for name in ("logged", "unlogged"))
"""What workers run is imported once for all of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerGroup:
    """An executor, and how many batches it should have at a time.

    `died` are exceptions of a batch whose worker died; `gave_up` those of a batch that other
    workers have tried as well.
    """

    executor: Executor
    slots: Callable[[], int]
    worker_lost: tuple[type[BaseException], ...] = (BrokenExecutor,)
    no_retry: tuple[type[BaseException], ...] = ()


OpenWorkers = Callable[[], AbstractContextManager[WorkerGroup]]
"""Starts a fleet where there is something to do, and ends it."""


class InlineExecutor(Executor):
    """Runs each call at once, in `submit`."""

    def submit(
        self, fn: Callable[Arguments, Result], /, *args: Arguments.args, **kwargs: Arguments.kwargs
    ) -> Future[Result]:
        future: Future[Result] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - it is the caller's, as with any executor
            future.set_exception(error)
        return future


class WorkerPool(Executor):
    """Worker processes, each of which imports the project once.

    The batch of a worker that dies ends with `BrokenProcessPool`; the others go on, and the next
    call of `submit` replaces the worker. Workers are forked from a process that has imported
    everything and has no threads; without fork they are spawned. They end with this process, even
    if it is killed.
    """

    def __init__(self, workers: int) -> None:
        # Inherited by the workers; see scenarios.cli.main.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # After a Ctrl-C Python cleans up by itself, and would warn of it.
        os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker:UserWarning")
        self._processes = [_new_process() for _ in range(workers)]
        self._futures: list[list[Future[Any]]] = [[] for _ in range(workers)]

    def submit(
        self, fn: Callable[Arguments, Result], /, *args: Arguments.args, **kwargs: Arguments.kwargs
    ) -> Future[Result]:
        """Hand the call to the worker with the fewest open calls."""
        self._futures = [[one for one in of if not one.done()] for of in self._futures]
        place = min(range(len(self._futures)), key=lambda number: len(self._futures[number]))
        future = self._submit_to(place, partial(fn, *args, **kwargs))
        self._futures[place].append(future)
        return future

    def _submit_to(self, place: int, work: Callable[[], Result]) -> Future[Result]:
        """Hand work to a worker, which is replaced if it has died."""
        with _block_ctrl_c():  # inherited by the workers, which end with their parent
            for pause_s in RETRY_DELAYS_S:
                try:
                    return self._processes[place].submit(work)
                except (BrokenProcessPool, OSError, EOFError):  # or the process it is forked from
                    self._processes[place] = _new_process()
                    time.sleep(pause_s)
            return self._processes[place].submit(work)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        for process in self._processes:
            process.shutdown(wait=False, cancel_futures=cancel_futures)
        for process in self._processes if wait else ():
            process.shutdown()


def _new_process() -> ProcessPoolExecutor:
    if "forkserver" not in get_all_start_methods():
        return ProcessPoolExecutor(1, get_context("spawn"), initializer=_end_with_parent)
    context = get_context("forkserver")
    context.set_forkserver_preload(list(PRELOADED))
    return ProcessPoolExecutor(1, context, initializer=_end_with_parent)


@contextmanager
def _block_ctrl_c() -> Iterator[None]:
    """Block SIGINT in this thread; another one still receives it for the process."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent() -> None:
    """End this worker when its parent is gone, even if that was killed."""
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
    """Start a fleet of worker processes (None: one for each core, 0: this process alone).

    With `scheduler`, an address such as tcp://127.0.0.1:8786, use the workers of that dask
    scheduler, which needs the package distributed. Raises EngineError if none answers there. At the
    end, batches that have not begun are cancelled.
    """
    if scheduler:
        with _dask_fleet(scheduler) as fleet:
            yield fleet
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
def _dask_fleet(address: str) -> Iterator[WorkerGroup]:
    from distributed import Client, KilledWorker  # noqa: PLC0415 - an extra, and slow

    try:
        client = Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:  # TimeoutError among them
        why = f"no dask scheduler answers there ({' '.join(str(error).split())})"
        raise EngineError([f"--scheduler: {address}: {why}"]) from error
    try:
        # After the death of a worker equal batches are sent again and must not share a result.
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
    """Count the batches that the workers of a scheduler can use, looked up now and then."""
    looked_at, slots = -POLL_INTERVAL_S, 1

    def count() -> int:
        nonlocal looked_at, slots
        now = time.monotonic()
        if now - looked_at >= POLL_INTERVAL_S:
            threads: dict[str, Any] = client.nthreads()
            # With no worker there one batch waits for the first to come.
            slots = max(BATCHES_PER_THREAD * sum(threads.values()), 1)
            looked_at = now
        return slots

    return count
