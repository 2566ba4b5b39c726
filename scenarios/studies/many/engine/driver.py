"""Hands out jobs in batches of a second or more, gathers what comes of them, survives the workers.

A batch whose worker died is tried again, each of its jobs alone from then on, so that a job that
kills its worker is found and the others of its batch are done.
"""

from collections import Counter, deque
from collections.abc import Hashable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass
from math import ceil
from typing import Any, Generic, TypeVar

from scenarios.studies.many.engine.batch import (
    EngineError,
    JobAnswer,
    Work,
    carry_out_batch,
    in_one_line,
)
from scenarios.studies.many.engine.fleet import LOOK_EVERY_S, Fleet
from scenarios.studies.many.engine.stamp import stamp_of_this_process

JobKey = TypeVar("JobKey", bound=Hashable)

BATCH_S = 1.5
"""What a batch should take, so that handing it out costs little beside."""
MOST_DEATHS = 3
"""A job under which so many workers died is given up."""
DEADLY = "its worker died, each time that it was tried"


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome(Generic[JobKey]):
    """What came of the job `key`; one with `is_given_up` killed its workers, and said nothing."""

    key: JobKey
    result: Any = None
    error: str = ""
    is_given_up: bool = False


class Pace:
    """How many jobs make a batch, learned from what they took."""

    def __init__(self) -> None:
        self._jobs = 0
        self._took_s = 0.0

    def learn(self, answers: list[JobAnswer]) -> None:
        """Take what the jobs of a batch took."""
        self._jobs += len(answers)
        self._took_s += sum(one.took_s for one in answers)

    def size(self, waiting: int, slots: int) -> int:
        """Jobs for the next batch, while so many wait; the last ones are shared out evenly."""
        if not self._jobs:
            return 1
        mean_s = max(self._took_s / self._jobs, BATCH_S / 1000)
        return max(1, min(ceil(BATCH_S / mean_s), ceil(waiting / slots)))


class JobDriver(Generic[JobKey]):
    """Does `jobs` on a fleet; neither batches nor workers change what comes of them."""

    def __init__(self, jobs: Mapping[JobKey, Work], fleet: Fleet) -> None:
        self._jobs = jobs
        self._fleet = fleet
        self._waiting = deque(jobs)
        self._alone: deque[JobKey] = deque()
        self._deaths: Counter[JobKey] = Counter()
        self._under_way: dict[Future[list[JobAnswer]], list[JobKey]] = {}
        self._pace = Pace()

    def outcomes(self) -> Iterator[Outcome[JobKey]]:
        """Give what came of each job, as it comes.

        Raises EngineError if the workers cannot do the work at all.
        """
        while self._waiting or self._alone or self._under_way:
            self._hand_out()
            done, _ = wait(self._under_way, timeout=LOOK_EVERY_S, return_when=FIRST_COMPLETED)
            for future in done:
                yield from self._taken(self._under_way.pop(future), future)

    def _hand_out(self) -> None:
        slots, stamp = self._fleet.slots(), stamp_of_this_process()
        while len(self._under_way) < slots and (self._alone or self._waiting):
            keys = self._next(slots)
            jobs = [self._jobs[key] for key in keys]
            try:
                future = self._fleet.executor.submit(carry_out_batch, stamp, jobs)
            except self._fleet.died as error:
                why = f"the workers are gone, and no others take their place: {in_one_line(error)}"
                raise EngineError([why]) from error
            self._under_way[future] = keys

    def _next(self, slots: int) -> list[JobKey]:
        if self._alone:
            return [self._alone.popleft()]
        count = self._pace.size(len(self._waiting), slots)
        return [self._waiting.popleft() for _ in range(min(count, len(self._waiting)))]

    def _taken(
        self, keys: list[JobKey], future: Future[list[JobAnswer]]
    ) -> Iterator[Outcome[JobKey]]:
        try:
            answers = future.result()
        except self._fleet.died as error:
            yield from self._tried_again(keys, isinstance(error, self._fleet.gave_up))
            return
        except EngineError:
            raise
        except CancelledError as error:
            raise EngineError(["the scheduler is gone"]) from error
        except Exception as error:
            raise EngineError([f"a worker cannot do the work: {in_one_line(error)}"]) from error
        self._pace.learn(answers)
        for key, answer in zip(keys, answers, strict=True):
            yield Outcome(key=key, result=answer.result, error=answer.error)

    def _tried_again(self, keys: list[JobKey], gave_up: bool) -> Iterator[Outcome[JobKey]]:
        """Let each job of a batch whose worker died be done alone, but not for ever."""
        for key in keys:
            self._deaths[key] += 1
            if self._deaths[key] >= MOST_DEATHS or (gave_up and len(keys) == 1):
                yield Outcome(key=key, error=DEADLY, is_given_up=True)
            else:
                self._alone.append(key)


def run_all(jobs: Mapping[JobKey, Work], fleet: Fleet) -> Iterator[tuple[JobKey, Any]]:
    """Do all jobs on a fleet, in the shape of `scenarios.runs.pool.run_jobs`.

    Raises EngineError when one fails; what has not begun by then is left undone.
    """
    for outcome in JobDriver(jobs, fleet).outcomes():
        if outcome.error:
            raise EngineError([f"{outcome.key}: {outcome.error}"])
        yield outcome.key, outcome.result
