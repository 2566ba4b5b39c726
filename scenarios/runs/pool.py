"""Many jobs on several processes, each result as soon as it is there."""

import os
import signal
import time
from collections.abc import Callable, Hashable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from itertools import islice
from multiprocessing import get_all_start_methods, get_context, parent_process
from threading import Thread
from typing import Any, ParamSpec, TypeVar

from scenarios.runs.cores import cores

Key = TypeVar("Key", bound=Hashable)
Job = Callable[[], Any]
Given = ParamSpec("Given")
Result = TypeVar("Result")

PAUSES_S = (0.0, 0.05, 0.5)
"""Before each further attempt to start a worker: what it is forked from may not be up yet."""
IMPORTED = tuple(
    f"scenarios.runs.{name}" for name in ("log_file", "virtual.logged", "virtual.unlogged")
)
"""What workers run is imported once for all of them."""


class WorkerPool(Executor):
    """So many worker processes, each of which imports the project once.

    What a worker does that dies ends with `BrokenProcessPool`; the others do not notice, and the
    next call of `submit` puts a new one in its place. They are forked from a process that has
    imported everything and has no threads, as this one has; where there is no fork they are
    spawned. They end with this process, even if it is killed outright.
    """

    def __init__(self, workers: int) -> None:
        """Start nothing yet: each worker comes with the first thing that it is to do."""
        # Inherited by the workers; see the same line of the command line.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # After a Ctrl-C Python itself tidies up, and would complain that it had to.
        os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker:UserWarning")
        self._processes = [_one_process() for _ in range(workers)]
        self._futures: list[list[Future[Any]]] = [[] for _ in range(workers)]

    def submit(
        self, fn: Callable[Given, Result], /, *args: Given.args, **kwargs: Given.kwargs
    ) -> Future[Result]:
        """Give it to the worker that has least to do."""
        self._futures = [[one for one in of if not one.done()] for of in self._futures]
        place = min(range(len(self._futures)), key=lambda number: len(self._futures[number]))
        future = self._submit_to(place, partial(fn, *args, **kwargs))
        self._futures[place].append(future)
        return future

    def _submit_to(self, place: int, work: Callable[[], Result]) -> Future[Result]:
        """Give work to a worker, or to a new one in its place if it has died."""
        with _deaf_to_ctrl_c():  # which the workers inherit: they end with their parent
            for pause_s in PAUSES_S:
                try:
                    return self._processes[place].submit(work)
                except (BrokenProcessPool, OSError, EOFError):  # or what it is forked from died
                    self._processes[place] = _one_process()
                    time.sleep(pause_s)
            return self._processes[place].submit(work)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let the workers end, once they have done what is not cancelled."""
        for process in self._processes:
            process.shutdown(wait=False, cancel_futures=cancel_futures)
        for process in self._processes if wait else ():
            process.shutdown()


def _one_process() -> ProcessPoolExecutor:
    if "forkserver" not in get_all_start_methods():
        return ProcessPoolExecutor(1, get_context("spawn"), initializer=_end_with_parent)
    context = get_context("forkserver")
    context.set_forkserver_preload(list(IMPORTED))
    return ProcessPoolExecutor(1, context, initializer=_end_with_parent)


RunAll = Callable[[Mapping[Any, Job]], Iterator[tuple[Any, Any]]]
"""Does all jobs; gives the key and the result of each as it is done."""


def in_this_process(jobs: Mapping[Key, Job]) -> Iterator[tuple[Key, Any]]:
    """Do all jobs here, in their order."""
    return ((key, job()) for key, job in jobs.items())


def run_jobs(jobs: Mapping[Key, Job], workers: int) -> Iterator[tuple[Key, Any]]:
    """Do all jobs on so many processes (0: in this one); gives each result when it is done.

    When one fails, or the caller stops iterating, those that have begun are waited for and no more
    are begun.
    """
    with warm_workers(workers) as run_all:
        yield from run_all(jobs)


@contextmanager
def warm_workers(workers: int | None = None) -> Iterator[RunAll]:
    """Give what does jobs like `run_jobs`, on the same processes each time: they start once.

    By default one for each core.
    """
    workers = cores() if workers is None else workers
    if not workers:
        yield in_this_process
        return
    with WorkerPool(workers) as pool:
        yield lambda jobs: _done_on(pool, workers, jobs)


def _done_on(pool: WorkerPool, workers: int, jobs: Mapping[Key, Job]) -> Iterator[tuple[Key, Any]]:
    waiting = iter(jobs.items())
    under_way = {pool.submit(job): key for key, job in islice(waiting, workers)}
    while under_way:
        done, _ = wait(under_way, return_when=FIRST_COMPLETED)
        for future in done:
            key, result = under_way.pop(future), future.result()
            for next_key, job in islice(waiting, 1):
                under_way[pool.submit(job)] = next_key
            yield key, result


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Block SIGINT in this thread; another one still receives it for the process."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent() -> None:
    """Let a worker end when its parent is gone, even if that was killed outright."""
    parent = parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=watch, daemon=True).start()
