"""Runs the jobs of a study, each once, however often workers and driver are killed.

Jobs are handed out in batches of a second or more. A batch whose worker died is tried again, each
of its jobs alone from then on, so that a job that kills its worker is found and the others of its
batch are done. With a journal, a driver that was killed goes on where it was.
"""

import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.studies.engine.fleet import LOOK_EVERY_S, Fleet, OpenFleet
from scenarios.studies.engine.job import EngineError, Job, JobAnswer, carry_out_batch, in_one_line
from scenarios.studies.engine.journal import JOURNAL, Entry, RunJournal, open_journal
from scenarios.studies.engine.results import refuse_existing
from scenarios.studies.engine.stamp import stamp_of_this_process
from transport.log.records import LogError

BATCH_S = 1.5
"""What a batch should take, so that handing it out costs little in comparison."""
MOST_DEATHS = 3
"""A job under which this many workers died is given up."""
DEADLY = "its worker died, each time that it was tried"
GIVEN_UP = "given_up"
"""Of an entry whose worker died: the fault may be the machine's, so the job is tried again."""
SAY_EVERY_S = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The result of the job `key`, or its error; one that `is_given_up` killed its workers.

    `raised` is the error itself where it has words of its own.
    """

    key: str
    result: Any = None
    error: str = ""
    raised: Exception | None = None
    is_given_up: bool = False


class Pace:
    """How many jobs make a batch, learned from the time that they took."""

    def __init__(self) -> None:
        self._jobs = 0
        self._took_s = 0.0

    def learn(self, answers: list[JobAnswer]) -> None:
        """Take the times of the jobs of a batch."""
        self._jobs += len(answers)
        self._took_s += sum(one.took_s for one in answers)

    def size(self, waiting: int, slots: int) -> int:
        """Jobs for the next batch of those that wait; the last ones are shared out evenly."""
        if not self._jobs:
            return 1
        mean_s = max(self._took_s / self._jobs, BATCH_S / 1000)
        return max(1, min(ceil(BATCH_S / mean_s), ceil(waiting / slots)))


class JobDriver:
    """Does `jobs` on a fleet; neither batches nor workers change their outcomes."""

    def __init__(self, jobs: Sequence[Job], fleet: Fleet, pace: Pace | None = None) -> None:
        self._jobs = {job.key: job.work for job in jobs}
        self._fleet = fleet
        self._waiting = deque(self._jobs)
        self._alone: deque[str] = deque()
        self._deaths: Counter[str] = Counter()
        self._under_way: dict[Future[list[JobAnswer]], list[str]] = {}
        self._pace = pace or Pace()

    def outcomes(self) -> Iterator[Outcome]:
        """Give the outcome of each job, as it comes.

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

    def _next(self, slots: int) -> list[str]:
        if self._alone:
            return [self._alone.popleft()]
        count = self._pace.size(len(self._waiting), slots)
        return [self._waiting.popleft() for _ in range(min(count, len(self._waiting)))]

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
        """Let each job of a batch whose worker died be done alone, but not for ever."""
        for key in keys:
            self._deaths[key] += 1
            if self._deaths[key] >= MOST_DEATHS or (gave_up and len(keys) == 1):
                yield Outcome(key=key, error=DEADLY, is_given_up=True)
            else:
                self._alone.append(key)


class Progress:
    """Counts the jobs of a study, and reports them every few seconds.

    `total` is their number where it is known beforehand; `doing` is what they are for.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._began = self._said = time.monotonic()
        self._first: tuple[int, float] | None = None
        self.done = 0
        self.total: int | None = None
        self.doing = ""

    @property
    def seconds(self) -> float:
        """How long the study has taken so far."""
        return time.monotonic() - self._began

    def one_more(self) -> None:
        """Count a job that is done; report it if some seconds have passed, or if it is the last.

        The time left follows from the jobs after the first, before which the workers had to start.
        """
        self.done += 1
        now = time.monotonic()
        first, first_at = self._first = self._first or (self.done, now)
        if now - self._said < SAY_EVERY_S and self.done != self.total:
            return
        self._said = now
        text = f"{self.done} runs" if self.total is None else f"{self.done} of {self.total} runs"
        if self.total is not None and first < self.done < self.total:
            left_s = (now - first_at) / (self.done - first) * (self.total - self.done)
            text += f", {left_s:.0f} s left"
        self.note(text + (f": {self.doing}" if self.doing else ""))

    def note(self, line: str) -> None:
        """Report a line with the time."""
        self._say(f"{self.seconds:6.1f} s  {line}")


class Engine:
    """Does the jobs of one study on a fleet, which starts when there is something to do.

    A job whose result is in the `journal` is not done again.
    """

    def __init__(
        self,
        open_fleet: OpenFleet,
        ends: ExitStack,
        say: Callable[[str], None],
        journal: RunJournal | None = None,
    ) -> None:
        """`ends` is what the fleet ends with."""
        self.progress = Progress(say)
        self.say = say
        self._open_fleet, self._ends = open_fleet, ends
        self._fleet: Fleet | None = None
        self._pace = Pace()
        self._journal = journal

    def results(self, jobs: Sequence[Job]) -> list[Any]:
        """Do all jobs; their results, in the order of the jobs.

        Raises the error of a job: as it is where it has words of its own, else as an EngineError
        with the command that repeats the job.
        """
        commands = {job.key: job.command or job.key for job in jobs}
        found: dict[str, Any] = {}
        for outcome in self._outcomes(jobs, keeps_errors=False):
            if outcome.error:
                why = f"{commands[outcome.key]}: {outcome.error}"
                raise outcome.raised or EngineError([why])
            found[outcome.key] = outcome.result
        return [found[job.key] for job in jobs]

    def known(self, jobs: Sequence[Job]) -> int:
        """How many of the jobs are in the journal."""
        return sum(self._entry(job) is not None for job in jobs)

    def _entry(self, job: Job) -> Entry | None:
        entry = None if self._journal is None else self._journal.entries.get(job.key)
        return None if entry is None or entry.get(GIVEN_UP) else entry

    def outcomes(self, jobs: Sequence[Job]) -> Iterator[Outcome]:
        """Give the outcome of each job as it comes, errors among them; first those known before."""
        return self._outcomes(jobs, keeps_errors=True)

    def _outcomes(self, jobs: Sequence[Job], *, keeps_errors: bool) -> Iterator[Outcome]:
        left = []
        for job in jobs:
            entry = self._entry(job)
            if entry is None:
                left.append(job)
            else:
                self.progress.done += 1
                yield _outcome(job.key, entry)
        if not left:
            return
        if self._fleet is None:
            self._fleet = self._ends.enter_context(self._open_fleet())
        for outcome in JobDriver(left, self._fleet, self._pace).outcomes():
            kept = outcome
            if self._journal is not None and (keeps_errors or not outcome.error):
                kept = _outcome(outcome.key, self._journal.add(outcome.key, _kept(outcome)))
            self.progress.one_more()
            yield kept


def _kept(outcome: Outcome) -> Entry:
    if not outcome.error:
        return {"result": outcome.result}
    return {"error": outcome.error} | ({GIVEN_UP: True} if outcome.is_given_up else {})


def _outcome(key: str, entry: Mapping[str, Any]) -> Outcome:
    return Outcome(
        key=key,
        result=entry.get("result"),
        error=entry.get("error", ""),
        is_given_up=entry.get(GIVEN_UP, False),
    )


@contextmanager
def study_engine(
    open_fleet: OpenFleet,
    say: Callable[[str], None],
    *,
    out: Path | None = None,
    files: Sequence[str] = (),
    asked: Mapping[str, Any] | None = None,
    keep_journal: bool = False,
) -> Iterator[Engine]:
    """Give the engine of a study that writes `files` into the folder `out`, with a journal there.

    Killed at any instant and called again with the same question `asked`, a study goes on where it
    was. When it is through the journal is removed, unless it is to be kept. Without a folder
    everything stays in memory. Raises ScenarioError if the folder holds something else.
    """
    with ExitStack() as ends:
        if out is None or asked is None:
            yield Engine(open_fleet, ends, say)
            return
        if not (out / JOURNAL).exists():
            refuse_existing(*(out / name for name in files), place="folder by --out")
        is_new = not out.exists()
        try:
            journal = ends.enter_context(open_journal(out, asked, say))
            with _over(journal, keep=keep_journal):
                yield Engine(open_fleet, ends, say, journal)
        except BaseException:
            if is_new:
                with suppress(OSError):  # it holds something
                    out.rmdir()
            raise


@contextmanager
def _over(journal: RunJournal, *, keep: bool) -> Iterator[None]:
    """Remove a journal that nobody goes on with: after the answer, or a refusal, or empty."""
    try:
        yield
    except EngineError:
        if not journal.entries:
            journal.remove()
        raise
    except (ScenarioError, LogError):
        if not keep:
            journal.remove()
        raise
    except BaseException:
        if not journal.entries:
            journal.remove()
        raise
    if not keep:
        journal.remove()
