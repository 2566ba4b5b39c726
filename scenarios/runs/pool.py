"""Many jobs on several processes, each result as soon as it is there."""

import os
import signal
from collections.abc import Callable, Hashable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import contextmanager
from itertools import islice
from multiprocessing import get_context, parent_process
from threading import Thread
from typing import Any, TypeVar

Key = TypeVar("Key", bound=Hashable)
Job = Callable[[], Any]


RunAll = Callable[[Mapping[Any, Job]], Iterator[tuple[Any, Any]]]
"""Does all jobs; gives the key and the result of each as it is done."""


def run_jobs(jobs: Mapping[Key, Job], workers: int) -> Iterator[tuple[Key, Any]]:
    """Do all jobs on so many processes (0: in this one); gives each result when it is done.

    When one fails, or the caller stops iterating, those that have begun are waited for and no more
    are begun.
    """
    with warm_workers(workers) as run_all:
        yield from run_all(jobs)


@contextmanager
def warm_workers(workers: int) -> Iterator[RunAll]:
    """Give what does jobs like `run_jobs`, on the same processes each time: they start once."""
    if not workers:
        yield lambda jobs: ((key, job()) for key, job in jobs.items())
        return
    # Inherited by the workers; see the same line of the command line.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    spawn = get_context("spawn")
    with ProcessPoolExecutor(workers, spawn, initializer=_end_with_parent) as pool:
        yield lambda jobs: _done_on(pool, workers, jobs)


def _done_on(
    pool: ProcessPoolExecutor, workers: int, jobs: Mapping[Key, Job]
) -> Iterator[tuple[Key, Any]]:
    waiting = iter(jobs.items())
    with _deaf_to_ctrl_c():  # which workers inherit that start now: they end with their parent
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
