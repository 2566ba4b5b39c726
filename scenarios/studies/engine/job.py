"""A job of a study, and a batch of jobs on a worker: one after the other."""

import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.studies.engine.stamp import ProgramStamp, current_stamp
from transport.log.records import LogError
from transport.texts import printable

Work = Callable[[], Any]
"""A picklable call with a picklable result."""
PRINTABLE_ERRORS = (ScenarioError, LogError, OSError)
"""Errors that a command prints as they are."""

RUN_LOCK = Lock()
"""Runs are Python: threads of one worker would not make them faster, but take their memory."""


class EngineError(ScenarioError):
    """The work cannot go on, for a reason in one line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A piece of work, its unique `key` in the study, and the `command` that repeats it.

    If the study keeps a journal, `work` returns only JSON types.
    """

    key: str
    work: Work
    command: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobResult:
    """The result of a job, or the error that it raised in one line; and its duration.

    `raised` is the error itself if a command can print it as it is.
    """

    result: Any = None
    error: str = ""
    exception: Exception | None = None
    duration_s: float = 0.0


def run_batch(stamp: ProgramStamp, jobs: Sequence[Work]) -> list[JobResult]:
    """Do the jobs in this process, whose programs must match `stamp`.

    The answer of a job that raises holds the error. Raises EngineError if the programs differ.
    """
    here = current_stamp()
    if here != stamp:
        why = "; ".join(stamp.differences(here))
        raise EngineError([f"a worker has other programs: {why}; install the same on all"])
    with RUN_LOCK:
        return [_answer(job) for job in jobs]


def _answer(job: Work) -> JobResult:
    began = time.perf_counter()
    try:
        return JobResult(result=job(), duration_s=time.perf_counter() - began)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - the other jobs go on
        return JobResult(
            error=error_line(error),
            exception=error if isinstance(error, PRINTABLE_ERRORS) else None,
            duration_s=time.perf_counter() - began,
        )


def error_line(error: BaseException) -> str:
    """Describe an error; with its place if the wording is Python's and not the project's."""
    if isinstance(error, ScenarioError):
        return printable("; ".join(error.lines))
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return printable(" ".join(f"{type(error).__name__}: {error}{where}".split()))
