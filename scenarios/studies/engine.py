"""Run each job of a study once; with a journal, an interrupted study resumes."""

import fcntl
import json
import os
import re
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from io import FileIO
from math import ceil
from pathlib import Path
from typing import Any
from zlib import crc32

from scenarios.definition.errors import ScenarioError
from scenarios.results.files import named_errors
from scenarios.results.versions import current_stamp
from scenarios.studies.job import (
    EngineError,
    Job,
    JobResult,
    error_line,
    refuse_existing,
    run_batch,
)
from scenarios.studies.workers import POLL_INTERVAL_S, OpenWorkers, WorkerGroup
from transport.log.errors import LogError

# ---- Send jobs to workers in batches and collect their outcomes
#
# If a worker dies, the jobs of its batch are retried one by one, to isolate a job that kills
# workers.


TARGET_BATCH_S = 1.5
"""Target duration of a batch; submitting it takes milliseconds."""
MAX_ATTEMPTS = 3
WORKER_DIED = "the worker process died at each attempt"


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The result of the job `key`, or its error.

    `exception` is set if the command line prints it unchanged. `abandoned` jobs killed their
    workers.
    """

    key: str
    result: Any = None
    error: str = ""
    exception: Exception | None = None
    abandoned: bool = False


class BatchSizer:
    """Number of jobs per batch, from their mean duration."""

    def __init__(self) -> None:
        self._jobs = 0
        self._total_s = 0.0

    def add(self, results: list[JobResult]) -> None:
        self._jobs += len(results)
        self._total_s += sum(result.duration_s for result in results)

    def size(self, waiting: int, slots: int) -> int:
        """Jobs for the next batch; the last jobs are spread over all slots."""
        if not self._jobs:
            return 1
        mean_s = max(self._total_s / self._jobs, TARGET_BATCH_S / 1000)
        return max(1, min(ceil(TARGET_BATCH_S / mean_s), ceil(waiting / slots)))


class JobDispatcher:
    """Run `jobs` on workers. Outcomes depend neither on the batches nor on the workers."""

    def __init__(
        self,
        jobs: Sequence[Job],
        workers: WorkerGroup,
        sizer: BatchSizer | None = None,
        plug_ins: Mapping[str, str] | None = None,
        idle: Callable[[], None] = lambda: None,
    ) -> None:
        """`plug_ins` are digests that workers must have, see `run_batch`.

        `idle` is called each second while jobs run.
        """
        self._idle = idle
        self._plug_ins = dict(plug_ins or {})
        self._jobs = {job.key: job.work for job in jobs}
        self._workers = workers
        self._waiting = deque(self._jobs)
        self._retries: deque[str] = deque()
        self._attempts: Counter[str] = Counter()
        self._running: dict[Future[list[JobResult]], list[str]] = {}
        self._sizer = sizer or BatchSizer()

    def outcomes(self) -> Iterator[Outcome]:
        while self._waiting or self._retries or self._running:
            self._submit_batches()
            done, _ = wait(self._running, timeout=POLL_INTERVAL_S, return_when=FIRST_COMPLETED)
            self._idle()
            for future in done:
                yield from self._collect(self._running.pop(future), future)

    def _submit_batches(self) -> None:
        slots, stamp = self._workers.slots(), current_stamp()
        while len(self._running) < slots and (self._retries or self._waiting):
            if self._retries:
                keys = [self._retries.popleft()]
            else:
                size = min(self._sizer.size(len(self._waiting), slots), len(self._waiting))
                keys = [self._waiting.popleft() for _ in range(size)]
            jobs = [self._jobs[key] for key in keys]
            try:
                future = self._workers.executor.submit(run_batch, stamp, jobs, self._plug_ins)
            except self._workers.worker_lost as error:
                why = f"all workers are lost: {error_line(error)}"
                raise EngineError([why]) from error
            self._running[future] = keys

    def _collect(self, keys: list[str], future: Future[list[JobResult]]) -> Iterator[Outcome]:
        try:
            results = future.result()
        except self._workers.worker_lost as error:
            yield from self._retry(keys, isinstance(error, self._workers.no_retry))
            return
        except EngineError:
            raise
        except CancelledError as error:
            raise EngineError(["lost the connection to the scheduler"]) from error
        except Exception as error:
            raise EngineError([f"a worker failed: {error_line(error)}"]) from error
        self._sizer.add(results)
        for key, done in zip(keys, results, strict=True):
            yield Outcome(key=key, result=done.result, error=done.error, exception=done.exception)

    def _retry(self, keys: list[str], no_retry: bool) -> Iterator[Outcome]:
        for key in keys:
            self._attempts[key] += 1
            if self._attempts[key] >= MAX_ATTEMPTS or (no_retry and len(keys) == 1):
                yield Outcome(key=key, error=WORKER_DIED, abandoned=True)
            else:
                self._retries.append(key)


# ---- A file of results, from which an interrupted study resumes
#
# JSON lines: the first holds the identity of the study, each further line the outcome of one job.
# Each line ends with a checksum, which for outcomes covers the identity too. A damaged line, or a
# line of another study, is ignored and its job runs again. So does the last line of a killed study
# if it is incomplete.


JOURNAL = "journal.jsonl"
SCHEMA = "convoy.journal/2"
CHECKSUM, CHECKSUM_BYTES = re.compile(rb',"crc32":"([0-9a-f]{8})"}'), 20
OTHER_FOLDER = "give another folder by --out"

Entry = dict[str, Any]
"""Outcome of a job in JSON types."""


class RunJournal:
    def __init__(self, path: Path, file: FileIO, identity: Mapping[str, Any]) -> None:
        self._path = path
        self._file = file
        self._identity_crc = crc32(json.dumps(identity, sort_keys=True).encode())
        self.entries: dict[str, Entry] = {}

    def add(self, key: str, entry: Entry) -> Entry:
        line = _encoded({"run": key, "entry": entry}, self._identity_crc)
        self._write(line)
        self.entries[key] = json.loads(line)["entry"]
        return self.entries[key]

    def load(self, line: bytes) -> bool:
        """Read a line; return False if it is damaged or belongs to another study."""
        content = _decoded(line, self._identity_crc)
        if content is None or "run" not in content:
            return False
        self.entries[content["run"]] = content["entry"]
        return True

    def write_header(self, identity: Mapping[str, Any]) -> None:
        self._write(_encoded({"schema": SCHEMA, "identity": identity}))

    def _write(self, line: bytes) -> None:
        with named_errors(self._path):
            _write_all(self._file, line)

    def remove(self) -> None:
        self._path.unlink(missing_ok=True)


@contextmanager
def open_journal(
    folder: Path, identity: Mapping[str, Any], report: Callable[[str], None]
) -> Iterator[RunJournal]:
    """Open the journal of `folder`, or create it.

    Damaged lines are passed to `report`, and their jobs run again. Raises ScenarioError if the
    journal belongs to another study, or if another process has it open.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / JOURNAL
    identity = json.loads(json.dumps(dict(identity)))  # as decoded from the file
    file = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT, 0o666), "rb+", buffering=0)
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            why = f"in use by another command; {OTHER_FOLDER}"
            raise ScenarioError([f"{folder}: {why}"]) from error
        journal = RunJournal(path, file, identity)
        with named_errors(path):
            _read(journal, file, path, identity, report)
        yield journal
    finally:
        with suppress(OSError):  # the run of a lost line is repeated
            file.close()


def _read(
    journal: RunJournal,
    file: FileIO,
    path: Path,
    identity: Mapping[str, Any],
    report: Callable[[str], None],
) -> None:
    """Read all lines, overwrite damaged lines with blanks, and seek to the end."""
    content = file.read()
    *lines, incomplete = content.split(b"\n")
    if len(lines) == 1:  # no outcomes yet: replace the identity
        lines, incomplete = [], content
    file.truncate(len(content) - len(incomplete))
    damaged, start, has_identity = [], 0, False
    for number, line in enumerate(lines, start=1):
        header = _decoded(line)
        if header is not None and "identity" in header:
            _refuse_other(path, header, identity)
            has_identity = True
        elif line.strip() and not journal.load(line):
            _refuse_other_version(path, line)
            damaged.append((number, start, len(line)))
        start += len(line) + 1
    if damaged and not has_identity and not journal.entries:
        raise ScenarioError([f"{path}, line 1: damaged; {OTHER_FOLDER}"])
    for number, at, length in damaged:
        report(f"{path}, line {number}: damaged; its run is repeated")
        file.seek(at)
        _write_all(file, b" " * length)
    file.seek(0, os.SEEK_END)
    if not has_identity:
        journal.write_header(identity)


def _write_all(file: FileIO, data: bytes) -> None:
    left = memoryview(data)
    while left:
        left = left[file.write(left) :]


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


def _refuse_other_version(path: Path, line: bytes) -> None:
    """Raise ScenarioError if the line is the header of a journal of another schema."""
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        return
    if not isinstance(content, dict) or "crc32" in content:
        return
    if content.get("schema", SCHEMA) != SCHEMA:
        why = f"given {content['schema']}, allowed {SCHEMA}; {OTHER_FOLDER}"
        raise ScenarioError([f"{path}: schema: {why}"])


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


MAX_SHOWN = 60
"""Longest value that a refusal quotes."""


def _difference(there: Any, here: Any) -> str:
    shown = [text if isinstance(text, str) else json.dumps(text) for text in (there, here)]
    if max(map(len, shown)) > MAX_SHOWN:
        return "different"
    return f"{shown[0]} in the folder, {shown[1]} now"


# ---- Engine


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
