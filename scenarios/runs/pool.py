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


def run_jobs(jobs: Mapping[Key, Job], workers: int) -> Iterator[tuple[Key, Any]]:
    """Do all jobs on so many processes (0: in this one); gives each result when it is done.

    When one fails, or the caller stops iterating, those that have begun are waited for and no more
    are begun.
    """
    if not workers:
        yield from ((key, job()) for key, job in jobs.items())
        return
    # Inherited by the workers; see the same line of the command line.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    waiting = iter(jobs.items())
    spawn = get_context("spawn")
    with ProcessPoolExecutor(workers, spawn, initializer=_end_with_parent) as pool:
        with _deaf_to_ctrl_c():  # which the workers inherit: they end with their parent
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
