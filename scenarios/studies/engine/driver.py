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

from scenarios.studies.engine.fleet import LOOK_EVERY_S, Fleet
from scenarios.studies.engine.job import EngineError, Job, JobAnswer, carry_out_batch, in_one_line
from scenarios.studies.engine.stamp import stamp_of_this_process

BATCH_S = 1.5
"""Wanted duration of a batch, so that handing it out costs little in comparison."""
MOST_DEATHS = 3
"""A job under which this many workers died is given up."""
DEADLY = "its worker died, each time that it was tried"


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The result of the job `key`, or its error; `is_given_up` if it killed its workers.

    `raised` is the error itself if a command can print it as it is.
    """

    key: str
    result: Any = None
    error: str = ""
    raised: Exception | None = None
    is_given_up: bool = False


class Pace:
    """Number of jobs in a batch, from the mean time that they took."""

    def __init__(self) -> None:
        self._jobs = 0
        self._took_s = 0.0

    def learn(self, answers: list[JobAnswer]) -> None:
        self._jobs += len(answers)
        self._took_s += sum(one.took_s for one in answers)

    def size(self, waiting: int, slots: int) -> int:
        """Jobs for the next batch; the last ones are shared out evenly."""
        if not self._jobs:
            return 1
        mean_s = max(self._took_s / self._jobs, BATCH_S / 1000)
        return max(1, min(ceil(BATCH_S / mean_s), ceil(waiting / slots)))


class JobDriver:
    """Runs `jobs` on a fleet; neither batches nor workers change the outcomes."""

    def __init__(self, jobs: Sequence[Job], fleet: Fleet, pace: Pace | None = None) -> None:
        self._jobs = {job.key: job.work for job in jobs}
        self._fleet = fleet
        self._waiting = deque(self._jobs)
        self._alone: deque[str] = deque()
        self._deaths: Counter[str] = Counter()
        self._under_way: dict[Future[list[JobAnswer]], list[str]] = {}
        self._pace = pace or Pace()

    def outcomes(self) -> Iterator[Outcome]:
        while self._waiting or self._alone or self._under_way:
            self._hand_out()
            done, _ = wait(self._under_way, timeout=LOOK_EVERY_S, return_when=FIRST_COMPLETED)
            for future in done:
                yield from self._taken(self._under_way.pop(future), future)

    def _hand_out(self) -> None:
        slots, stamp = self._fleet.slots(), stamp_of_this_process()
        while len(self._under_way) < slots and (self._alone or self._waiting):
            if self._alone:
                keys = [self._alone.popleft()]
            else:
                size = min(self._pace.size(len(self._waiting), slots), len(self._waiting))
                keys = [self._waiting.popleft() for _ in range(size)]
            jobs = [self._jobs[key] for key in keys]
            try:
                future = self._fleet.executor.submit(carry_out_batch, stamp, jobs)
            except self._fleet.died as error:
                why = f"the workers are gone, and no others take their place: {in_one_line(error)}"
                raise EngineError([why]) from error
            self._under_way[future] = keys

    def _taken(self, keys: list[str], future: Future[list[JobAnswer]]) -> Iterator[Outcome]:
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
        for key, one in zip(keys, answers, strict=True):
            yield Outcome(key=key, result=one.result, error=one.error, raised=one.raised)

    def _tried_again(self, keys: list[str], gave_up: bool) -> Iterator[Outcome]:
        """Retry each job of a batch whose worker died alone, up to `MOST_DEATHS` deaths."""
        for key in keys:
            self._deaths[key] += 1
            if self._deaths[key] >= MOST_DEATHS or (gave_up and len(keys) == 1):
                yield Outcome(key=key, error=DEADLY, is_given_up=True)
            else:
                self._alone.append(key)
