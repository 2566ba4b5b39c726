"""Who does the work: this process, a pool of processes, or the workers of a dask scheduler.

All are executors of `concurrent.futures`; a fleet adds how much to hand out at once, and by which
exceptions a batch says that its worker died.
"""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from scenarios.runs.cores import cores
from scenarios.runs.pool import WorkerPool
from scenarios.studies.many.engine.batch import EngineError

if TYPE_CHECKING:
    from distributed import Client

Given = ParamSpec("Given")
Result = TypeVar("Result")

QUEUED = 2
"""Batches for each thread of a remote worker: while one comes back, the next is there already."""
LOOK_EVERY_S = 1.0
"""How often a scheduler is asked for its workers, who come and go."""
CONNECT_S = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """An executor, and how many batches it should have at a time.

    `died` are exceptions of a batch under which its worker died; after `gave_up` it has been tried
    on other workers as well, who died too.
    """

    executor: Executor
    slots: Callable[[], int]
    died: tuple[type[BaseException], ...] = (BrokenExecutor,)
    gave_up: tuple[type[BaseException], ...] = ()


class ThisProcess(Executor):
    """Does everything at once, in `submit`."""

    def submit(
        self, fn: Callable[Given, Result], /, *args: Given.args, **kwargs: Given.kwargs
    ) -> Future[Result]:
        """Call it; the future is done."""
        future: Future[Result] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - it is the caller's, as with any executor
            future.set_exception(error)
        return future


@contextmanager
def fleet_of(workers: int | None = None, scheduler: str = "") -> Iterator[Fleet]:
    """Give a fleet of so many processes (None: one for each core, 0: this process alone).

    With `scheduler`, an address such as tcp://127.0.0.1:8786, it is that of an existing dask
    scheduler, which needs the package distributed. Raises EngineError if none answers there. In the
    end what has not begun is cancelled.
    """
    if scheduler:
        with _dask_fleet(scheduler) as fleet:
            yield fleet
    elif workers == 0:
        yield Fleet(executor=ThisProcess(), slots=lambda: 1)
    else:
        count = workers or cores()
        pool = WorkerPool(count)
        try:
            yield Fleet(executor=pool, slots=lambda: count)
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _dask_fleet(address: str) -> Iterator[Fleet]:
    from distributed import Client, KilledWorker  # noqa: PLC0415 - an extra, and slow

    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:  # also that it takes too long
        why = f"no dask scheduler answers there ({' '.join(str(error).split())})"
        raise EngineError([f"--scheduler: {address}: {why}"]) from error
    try:
        # Equal batches may be sent twice, when a worker died, so none stands for another.
        executor = client.get_executor(pure=False)
        died = (BrokenExecutor, KilledWorker)
        yield Fleet(executor=executor, slots=_Slots(client), died=died, gave_up=(KilledWorker,))
        executor.shutdown(wait=False)
    finally:
        client.close()


class _Slots:
    """How many batches the workers of a scheduler can use, asked for now and then."""

    def __init__(self, client: "Client") -> None:
        self._client = client
        self._asked_at = -LOOK_EVERY_S
        self._slots = 1

    def __call__(self) -> int:
        now = time.monotonic()
        if now - self._asked_at >= LOOK_EVERY_S:
            threads: dict[str, Any] = self._client.nthreads()
            # With no worker there one batch waits for the first to come.
            self._slots = max(QUEUED * sum(threads.values()), 1)
            self._asked_at = now
        return self._slots
