"""A job of a study, as a worker runs it, and the files of a study."""

import csv
import io
import json
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from threading import Lock
from typing import Any, NamedTuple

from scenarios.definition.errors import ScenarioError
from scenarios.definition.versions import ProgramStamp, current_stamp, module_digests
from scenarios.results.figure_style import encoded, picture_format_of
from scenarios.results.files import write_whole
from transport.log.errors import LogError
from transport.texts import printable

Work = Callable[[], Any]
"""A picklable call with a picklable result."""
PRINTABLE_ERRORS = (ScenarioError, LogError, OSError)
"""Errors that the command line prints unchanged."""

RUN_LOCK = Lock()
"""Threads of one worker take turns: in parallel, runs would only need more memory."""


class EngineError(ScenarioError):
    """The study cannot continue; the message is one line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A call, its unique `key` in the study, and the `command` that repeats it.

    In a sweep, which keeps a journal, `work` returns only JSON types.
    """

    key: str
    work: Work
    command: str = ""


class JobResult(NamedTuple):
    """The result of a job, or its error in one line.

    `exception` is set if the command line prints the error unchanged.
    """

    result: Any = None
    error: str = ""
    exception: Exception | None = None


def run_job(stamp: ProgramStamp, work: Work, plug_ins: Mapping[str, str]) -> JobResult:
    """Run a job in this process.

    Raises EngineError if `stamp`, or the digests of the modules of user-defined classes,
    `plug_ins`, differ from those of this process.
    """
    differences = stamp.differences(current_stamp()) + [
        f"module {module} is {there} there and {plug_ins[module]} here"
        for module, there in module_digests(plug_ins).items()
        if there != plug_ins[module]
    ]
    if differences:
        why = "; ".join(differences)
        raise EngineError(
            [f"a worker has other versions: {why}; install the same version on all machines"]
        )
    with RUN_LOCK:
        try:
            return JobResult(result=work())
        except (Exception, SystemExit) as error:  # noqa: BLE001 - the other jobs continue
            exception = error if isinstance(error, PRINTABLE_ERRORS) else None
            return JobResult(error=error_line(error), exception=exception)


def error_line(error: BaseException) -> str:
    """Describe an error in one line; unexpected errors with file and line."""
    if isinstance(error, ScenarioError):
        return printable("; ".join(error.lines))
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return printable(" ".join(f"{type(error).__name__}: {error}{where}".split()))


# ---- Files of a study: tables, JSON, plots and texts, each written atomically


Row = dict[str, Any]
"""A row of a table: texts, numbers or None by column."""


def refuse_existing(*files: Path | None, place: str = "place") -> None:
    """Raise ScenarioError if one of the output files exists."""
    for file in files:
        if file is not None and (file.exists() or file.is_symlink()):
            raise ScenarioError([f"{file}: exists; give another {place}"])


def require_place(out: Path, names: Sequence[str]) -> None:
    """Raise ScenarioError or OSError unless these files can be created in the folder `out`."""
    refuse_existing(*(out / name for name in names), place="folder by --out")
    is_new = not out.exists()
    out.mkdir(parents=True, exist_ok=True)
    with TemporaryFile(dir=out):
        pass
    if is_new:
        out.rmdir()


def write_files(out: Path, contents: Mapping[str, Any]) -> list[Path]:
    out.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        write_file(out / name, content)
    return [out / name for name in contents]


def write_file(path: Path, content: Any) -> None:
    """Put one file in its place once it is complete.

    A mapping is written as JSON, a list of rows as CSV, a figure of matplotlib as PNG, SVG or PDF
    by the name, a text as it is.
    """
    if isinstance(content, str):
        data = content.encode()
    elif isinstance(content, Mapping):
        data = json.dumps(content, indent=1).encode() + b"\n"
    elif isinstance(content, list):
        data = _csv(content)
    else:
        data = encoded(content, picture_format_of(path))
    write_whole(path, data)


def _csv(rows: Sequence[Row]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()
