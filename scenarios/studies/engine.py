"""Run each job of a study once on workers; with a journal, an interrupted sweep resumes."""

import fcntl
import json
import os
import re
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import ExitStack, contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any
from zlib import crc32

from scenarios.definition.errors import ScenarioError
from scenarios.definition.versions import current_stamp, plug_in_digests
from scenarios.results.files import named_errors
from scenarios.studies.job import EngineError, Job, JobResult, error_line, run_job
from scenarios.studies.workers import POLL_INTERVAL_S, OpenWorkers, WorkerGroup

# ---- Jobs on workers


MAX_ATTEMPTS = 3
WORKER_DIED = "the worker process died at each attempt"


def outcomes_of(
    jobs: Sequence[Job],
    workers: WorkerGroup,
    plug_ins: Mapping[str, str] | None = None,
    idle: Callable[[], None] = lambda: None,
) -> Iterator[tuple[str, JobResult]]:
    """Run jobs on workers, and yield their keys and results as they finish.

    A job whose worker died is retried. `plug_ins` are digests that workers must have, see
    `run_job`; `idle` is called each second. Raises EngineError if the workers are lost or have
    other versions.
    """
    waiting, attempts, stamp = deque(jobs), Counter[str](), current_stamp()
    running: dict[Future[JobResult], Job] = {}
    while waiting or running:
        while waiting and len(running) < workers.slots():
            job = waiting.popleft()
            try:
                future = workers.executor.submit(run_job, stamp, job.work, dict(plug_ins or {}))
            except workers.worker_lost as error:
                why = f"all workers are lost: {error_line(error)}"
                raise EngineError([why]) from error
            running[future] = job
        done, _ = wait(running, timeout=POLL_INTERVAL_S, return_when=FIRST_COMPLETED)
        idle()
        for future in done:
            job = running.pop(future)
            attempts[job.key] += 1
            try:
                yield job.key, _result(future, workers.worker_lost)
            except workers.worker_lost as error:
                if isinstance(error, workers.no_retry) or attempts[job.key] >= MAX_ATTEMPTS:
                    yield job.key, JobResult(error=WORKER_DIED)
                else:
                    waiting.appendleft(job)


def _result(future: Future[JobResult], worker_lost: tuple[type[BaseException], ...]) -> JobResult:
    """Result of a finished job; raises EngineError, or an error of `worker_lost`."""
    try:
        return future.result()
    except EngineError:
        raise
    except worker_lost:
        raise
    except CancelledError as error:
        raise EngineError(["lost the connection to the scheduler"]) from error
    except Exception as error:
        raise EngineError([f"a worker failed: {error_line(error)}"]) from error


# ---- A file of results, from which an interrupted sweep resumes


JOURNAL = "journal.jsonl"
SCHEMA = "convoy.journal/2"
CHECKSUM, CHECKSUM_BYTES = re.compile(rb',"crc32":"([0-9a-f]{8})"}'), 20
OTHER_FOLDER = "give another folder by --out"
MAX_SHOWN = 60
"""Longest value that a refusal quotes."""

Entry = dict[str, Any]
"""Outcome of a job in JSON types."""


class RunJournal:
    """JSON lines with checksums: the identity of the study, then the entries of its jobs.

    The checksum of an entry covers the identity. Lines that are damaged or of another study are
    left out, and their jobs run again; so is the incomplete last line of a killed study.
    """

    def __init__(self, path: Path, file: FileIO, identity: Mapping[str, Any]) -> None:
        self._path = path
        self._file = file
        self._identity = json.loads(json.dumps(dict(identity)))  # as decoded from the file
        self._identity_crc = crc32(json.dumps(self._identity, sort_keys=True).encode())
        self.entries: dict[str, Entry] = {}

    def add(self, key: str, entry: Entry) -> Entry:
        line = _encoded({"run": key, "entry": entry}, self._identity_crc)
        self._write(line)
        self.entries[key] = json.loads(line)["entry"]
        return self.entries[key]

    def load(self, report: Callable[[str], None]) -> None:
        """Read all lines; raises ScenarioError if they are those of another study."""
        content = self._file.read()
        *lines, incomplete = content.split(b"\n")
        if len(lines) == 1:  # no entries yet: replace the identity
            lines, incomplete = [], content
        damaged = []
        for number, line in enumerate(lines, start=1):
            header = _decoded(line) if number == 1 else None
            entry = _decoded(line, self._identity_crc)
            if header is not None and "identity" in header:
                _refuse_other(self._path, header, self._identity)
            elif entry is not None and "run" in entry:
                self.entries[entry["run"]] = entry["entry"]
            else:
                damaged.append(number)
        if 1 in damaged and not self.entries:
            raise ScenarioError([f"{self._path}, line 1: damaged; {OTHER_FOLDER}"])
        for number in damaged:
            report(f"{self._path}, line {number}: damaged; its run is repeated")
        self._file.truncate(len(content) - len(incomplete))
        self._file.seek(0, os.SEEK_END)
        if not lines:
            self._write(_encoded({"schema": SCHEMA, "identity": self._identity}))

    def _write(self, line: bytes) -> None:
        with named_errors(self._path):
            left = memoryview(line)
            while left:
                left = left[self._file.write(left) :]


@contextmanager
def open_journal(
    folder: Path, identity: Mapping[str, Any], report: Callable[[str], None]
) -> Iterator[RunJournal]:
    """Open the journal of `folder`, or create it; `report` gets a line about each damaged line.

    An empty one is removed at the end. Raises ScenarioError if the journal belongs to another
    study, or if another process has it open.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / JOURNAL
    file = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT, 0o666), "rb+", buffering=0)
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            why = f"in use by another command; {OTHER_FOLDER}"
            raise ScenarioError([f"{folder}: {why}"]) from error
        journal = RunJournal(path, file, identity)
        with named_errors(path):
            journal.load(report)
        try:
            yield journal
        finally:
            if not journal.entries:
                path.unlink(missing_ok=True)
                with suppress(OSError):  # not empty
                    folder.rmdir()
    finally:
        with suppress(OSError):  # the run of a lost line is repeated
            file.close()


def _encoded(content: Mapping[str, Any], identity_crc: int = 0) -> bytes:
    text = json.dumps(content, separators=(",", ":")).encode()[:-1]
    return text + b',"crc32":"%08x"}\n' % crc32(text, identity_crc)


def _decoded(line: bytes, identity_crc: int = 0) -> dict[str, Any] | None:
    """Decode a line; return None if its checksum is wrong."""
    text, checksum = line[:-CHECKSUM_BYTES], CHECKSUM.fullmatch(line[-CHECKSUM_BYTES:])
    if checksum is None or int(checksum[1], 16) != crc32(text, identity_crc):
        return None
    content: dict[str, Any] = json.loads(text + b"}")
    return content


def _refuse_other(path: Path, header: Mapping[str, Any], identity: Mapping[str, Any]) -> None:
    """Raise ScenarioError with the differences if the journal belongs to another study."""
    if header["schema"] != SCHEMA:
        why = f"given {header['schema']}, allowed {SCHEMA}; {OTHER_FOLDER}"
        raise ScenarioError([f"{path}: schema: {why}"])
    before = header["identity"]
    names = [name for name in {**identity, **before} if before.get(name) != identity.get(name)]
    if names:
        differs = "; ".join(
            f"{name}: {_difference(before.get(name), identity.get(name))}" for name in names
        )
        why = f"holds results of another command: {differs}"
        raise ScenarioError([f"{path.parent}: {why}; {OTHER_FOLDER}"])


def _difference(there: Any, here: Any) -> str:
    shown = [text if isinstance(text, str) else json.dumps(text) for text in (there, here)]
    if max(map(len, shown)) > MAX_SHOWN:
        return "different"
    return f"{shown[0]} in the folder, {shown[1]} now"


# ---- Engine


REPORT_EVERY_S = 5.0


class JobProgress:
    """Count the jobs of a study and report progress every few seconds.

    `total` is the number of jobs if known, `expected` an estimate of it; `stage` names the current
    step.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._began = self._reported_at = time.monotonic()
        self._first: tuple[int, float] | None = None
        self.done = 0
        self.total: int | None = None
        self.expected: int | None = None
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
        text = f"{self.done} of {about}{total} runs" if total else f"{self.done} runs"
        if total and first < self.done < total:
            left_s = (now - first_at) / (self.done - first) * (total - self.done)
            text += f", {about}{left_s:.0f} s left"
        stage = f": {self.stage}" if self.stage else ""
        self._report(f"{self.seconds:6.1f} s  {text}{stage}")


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
        self._journal = journal
        self._plug_ins = plug_ins

    def results(self, jobs: Sequence[Job]) -> list[Any]:
        """Run all jobs and return their results in the same order.

        Raises the error of a failed job if the command line prints it unchanged, else an
        EngineError with the command that repeats the job.
        """
        commands = {job.key: job.command or job.key for job in jobs}
        results: dict[str, Any] = {}
        for key, (result, error, exception) in self.outcomes(jobs):
            if error:
                raise exception or EngineError([f"{commands[key]}: {error}"])
            results[key] = result
        return [results[job.key] for job in jobs]

    def count_done(self, jobs: Sequence[Job]) -> int:
        return sum(self._recorded(job) is not None for job in jobs)

    def _recorded(self, job: Job) -> JobResult | None:
        entry = None if self._journal is None else self._journal.entries.get(job.key)
        return None if entry is None else JobResult(entry.get("result"), entry.get("error", ""))

    def outcomes(self, jobs: Sequence[Job]) -> Iterator[tuple[str, JobResult]]:
        """Yield keys and results as jobs finish, first those in the journal.

        A job that killed its workers is not in the journal, and retried when the sweep resumes.
        """
        left = []
        for job in jobs:
            recorded = self._recorded(job)
            if recorded is None:
                left.append(job)
            else:
                self.progress.done += 1
                yield job.key, recorded
        if left and self._workers is None:
            self._workers = self._exit_stack.enter_context(self._open_workers())
        if self._workers is None:
            return
        idle = self.progress.report_if_due
        for key, found in outcomes_of(left, self._workers, self._plug_ins, idle):
            if self._journal is not None and found.error != WORKER_DIED:
                entry = {"error": found.error} if found.error else {"result": found.result}
                self._journal.add(key, entry)
            self.progress.count_job()
            yield key, found


@contextmanager
def study_engine(
    open_workers: OpenWorkers,
    report: Callable[[str], None],
    *,
    plug_ins: Iterable[str] = (),
    journal: RunJournal | None = None,
) -> Iterator[Engine]:
    """Open the engine of a study; workers must have the same user-defined classes `plug_ins`."""
    with ExitStack() as exit_stack:
        digests = dict(plug_in_digests(plug_ins))
        yield Engine(open_workers, exit_stack, report, journal, digests)
