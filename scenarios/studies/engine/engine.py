"""Run each job of a study once; with a journal, an interrupted study resumes."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.studies.engine.dispatcher import BatchSizer, JobDispatcher, Outcome
from scenarios.studies.engine.job import EngineError, Job
from scenarios.studies.engine.journal import JOURNAL, Entry, RunJournal, open_journal
from scenarios.studies.engine.results import refuse_existing
from scenarios.studies.engine.workers import OpenWorkers, WorkerGroup
from transport.log.errors import LogError

ABANDONED = "given_up"
"""Journal key of a job that killed its workers. It is retried when the study resumes."""
REPORT_EVERY_S = 5.0


class JobProgress:
    """Count the jobs of a study and report progress every few seconds.

    `total` is the number of jobs if known; `stage` names the current step.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._began = self._reported_at = time.monotonic()
        self._first: tuple[int, float] | None = None
        self.done = 0
        self.total: int | None = None
        self.expected: int | None = None  # where the total depends on the results
        self.stage = ""

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._began

    def count_job(self) -> None:
        """Count a finished job.

        The estimate of the time left excludes the first job, which includes starting the workers.
        """
        self.done += 1
        self._first = self._first or (self.done, time.monotonic())
        self.report_if_due()

    def report_if_due(self) -> None:
        now = time.monotonic()
        if now - self._reported_at < REPORT_EVERY_S and self.done != self.total:
            return
        self._reported_at = now
        first, first_at = self._first or (self.done, now)
        total, about = (self.expected, "about ") if self.total is None else (self.total, "")
        text = (
            f"{self.done} run{'s' * (self.done != 1)}"
            if total is None
            else f"{self.done} of {about}{total} runs"
        )
        if total is not None and first < self.done < total:
            left_s = (now - first_at) / (self.done - first) * (total - self.done)
            text += f", {about}{left_s:.0f} s left"
        self.note(text + (f": {self.stage}" if self.stage else ""))

    def note(self, line: str) -> None:
        self._report(f"{self.seconds:6.1f} s  {line}")


class Engine:
    """Run the jobs of one study on workers.

    Workers start with the first job and stop when `exit_stack` closes. Jobs whose result is in
    the `journal` are skipped.
    """

    def __init__(
        self,
        open_workers: OpenWorkers,
        exit_stack: ExitStack,
        report: Callable[[str], None],
        journal: RunJournal | None = None,
        plug_ins: Mapping[str, str] | None = None,
    ) -> None:
        self.progress = JobProgress(report)
        self.report = report
        self._open_workers, self._exit_stack = open_workers, exit_stack
        self._workers: WorkerGroup | None = None
        self._sizer = BatchSizer()
        self._journal = journal
        self._plug_ins = plug_ins

    def results(self, jobs: Sequence[Job]) -> list[Any]:
        """Run all jobs and return their results in the same order.

        Raises the error of a failed job if the command line prints it unchanged, else an
        EngineError with the command that repeats the job.
        """
        commands = {job.key: job.command or job.key for job in jobs}
        results: dict[str, Any] = {}
        for outcome in self.outcomes(jobs, record_errors=False):
            if outcome.error:
                why = f"{commands[outcome.key]}: {outcome.error}"
                raise outcome.exception or EngineError([why])
            results[outcome.key] = outcome.result
        return [results[job.key] for job in jobs]

    def count_done(self, jobs: Sequence[Job]) -> int:
        return sum(self._entry(job) is not None for job in jobs)

    def _entry(self, job: Job) -> Entry | None:
        entry = None if self._journal is None else self._journal.entries.get(job.key)
        return None if entry is None or entry.get(ABANDONED) else entry

    def outcomes(self, jobs: Sequence[Job], *, record_errors: bool = True) -> Iterator[Outcome]:
        """Yield outcomes as jobs finish, first those in the journal.

        Without `record_errors`, failed jobs are not written to the journal.
        """
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
        if self._workers is None:
            self._workers = self._exit_stack.enter_context(self._open_workers())
        dispatcher = JobDispatcher(
            left, self._workers, self._sizer, self._plug_ins, self.progress.report_if_due
        )
        for outcome in dispatcher.outcomes():
            if self._journal is not None and (record_errors or not outcome.error):
                entry = self._journal.add(outcome.key, _entry_of(outcome))
                outcome = _outcome(outcome.key, entry)  # noqa: PLW2901
            self.progress.count_job()
            yield outcome


def _entry_of(outcome: Outcome) -> Entry:
    if not outcome.error:
        return {"result": outcome.result}
    return {"error": outcome.error} | ({ABANDONED: True} if outcome.abandoned else {})


def _outcome(key: str, entry: Mapping[str, Any]) -> Outcome:
    return Outcome(
        key=key,
        result=entry.get("result"),
        error=entry.get("error", ""),
        abandoned=entry.get(ABANDONED, False),
    )


@contextmanager
def study_engine(
    open_workers: OpenWorkers,
    report: Callable[[str], None],
    *,
    out: Path | None = None,
    files: Sequence[str] = (),
    identity: Mapping[str, Any] | None = None,
    keep_journal: bool = False,
) -> Iterator[Engine]:
    """Open the engine of a study that writes `files` and a journal into the folder `out`.

    An interrupted study resumes when it is restarted with the same `identity`, which holds
    everything that the results depend on, also the digests of user-defined classes, which the
    workers must have. The journal is removed at the end, unless
    `keep_journal`. Without a folder there is no journal. Raises ScenarioError if the folder
    already holds other files.
    """
    with ExitStack() as exit_stack:
        plug_ins = (identity or {}).get("plug_ins")
        if out is None or identity is None:
            yield Engine(open_workers, exit_stack, report, plug_ins=plug_ins)
            return
        if not (out / JOURNAL).exists():
            refuse_existing(*(out / name for name in files), place="folder by --out")
        is_new = not out.exists()
        try:
            journal = exit_stack.enter_context(open_journal(out, identity, report))
            if journal.entries and not keep_journal:
                report(f"{len(journal.entries)} runs are in the journal")
            with _remove_when_done(journal, keep=keep_journal):
                yield Engine(open_workers, exit_stack, report, journal, plug_ins)
        except BaseException:
            if is_new:
                with suppress(OSError):  # not empty
                    out.rmdir()
            raise


@contextmanager
def _remove_when_done(journal: RunJournal, *, keep: bool) -> Iterator[None]:
    """Remove the journal when the study ends, after an invalid input, or if empty."""
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
