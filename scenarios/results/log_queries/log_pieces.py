"""Parts of logs as logs of their own, and logs put together again."""

import shutil
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from scenarios.definition.library import ATTACHED_AS
from scenarios.results.files import SUMMARY_NAME
from scenarios.results.log_summary import summary_of_piece
from scenarios.results.summarise import METADATA_NAME
from scenarios.results.summary import to_json
from transport.columns import DEVIATION
from transport.log.mcap_file import McapFile
from transport.log.pieces import Choice, write_piece
from transport.log.reader import LogReader
from transport.log.records import PIECE, LogError, UnwritableError
from transport.log.repair import repair
from transport.topics import RUN_SENDER, TOPICS
from vehicles.schedule import SECOND

Warn = Callable[[str], None]


class LogPart(NamedTuple):
    """Messages to keep: times (s) after the start, topics and vehicles; None is no limit."""

    from_s: float | None = None
    to_s: float | None = None
    topics: Collection[str] | None = None
    vehicles: Collection[str] | None = None

    def described(self) -> dict[str, str]:
        times = {"from_s": self.from_s, "to_s": self.to_s}
        names = {"topics": self.topics, "vehicles": self.vehicles}
        return {
            **{name: f"{value:g}" for name, value in times.items() if value is not None},
            **{name: ",".join(value) for name, value in names.items() if value is not None},
        }


def extract(log: Path, part: LogPart, output: Path, warn: Warn) -> int:
    """Write part of a log to a new one; returns the number of messages.

    Raises LogError for times without messages, and for names that the log does not have.
    """
    reader = _opened(log, warn)
    known = [name for name in reader.vehicles if name != RUN_SENDER]
    _require("vehicle", part.vehicles, known, log)
    _require("topic", part.topics, [*TOPICS, DEVIATION], log)
    start = _start_of(reader)
    end_s = (reader.last_at - start) / SECOND
    from_s = 0.0 if part.from_s is None else part.from_s
    to_s = end_s if part.to_s is None else part.to_s
    if not from_s < to_s or from_s > end_s:
        raise LogError(
            f"{log}: nothing is recorded from {from_s:g} to {to_s:g} s; the log ends at "
            f"{end_s:.2f} s"
        )
    first = 0 if part.from_s is None else start + round(from_s * SECOND)
    last = reader.last_at if part.to_s is None else start + round(to_s * SECOND)
    choice = Choice((first, last), part.topics, part.vehicles)
    return _write([reader], output, choice, part.described())


def merge_logs(logs: Sequence[Path], output: Path, warn: Warn) -> int:
    """Write the messages of several logs of one run, each once; returns their number.

    Raises LogError for logs of different runs.
    """
    readers = [_opened(log, warn) for log in logs]
    first, *others = readers
    for other in others:
        for name, one, two in (
            ("run", _run_of(first), _run_of(other)),
            (
                "scenario",
                first.attachments().get(ATTACHED_AS),
                other.attachments().get(ATTACHED_AS),
            ),
        ):
            if one != two:
                raise LogError(f"{other.path}: is of another {name} than {first.path}")
    held = {"merged": ",".join(str(log) for log in logs)}
    return _write(readers, output, Choice(), held)


def recover_log(log: Path, output: Path) -> int:
    """Write every readable message of a truncated or damaged log; returns their number."""
    if output.exists():
        raise LogError(f"{output}: exists; a log is never overwritten")
    LogReader(log)  # refuse other files
    part = output.with_name(output.name + ".part")
    try:
        shutil.copyfile(log, part)
        repair(part, also_damaged=True)
        part.rename(output)
    except OSError as error:
        raise UnwritableError(f"{output}: cannot write the log: {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)
    return sum(LogReader(output).counts.values())


def _opened(log: Path, warn: Warn) -> LogReader:
    reader = LogReader(log)
    if reader.faults:
        warn(reader.faults)
    return reader


def _require(kind: str, names: Collection[str] | None, known: Collection[str], log: Path) -> None:
    if unknown := set(names or ()) - set(known):
        raise LogError(
            f"{log}: holds no {kind} {', '.join(sorted(unknown))}; it has {', '.join(known)}"
        )


def _start_of(reader: LogReader) -> int:
    """Start of the run (ns), or its first message."""
    for columns in reader.columns(["start"]).values():
        if len(columns):
            return int(columns.at_ns[0])
    return reader.first_at


def _run_of(reader: LogReader) -> tuple[object, ...]:
    """What distinguishes a run: its identifier, and its scenario."""
    return reader.metadata().get(METADATA_NAME, {}).get("run_id"), reader.attachments().get(
        ATTACHED_AS
    )


def _write(
    readers: Sequence[LogReader], output: Path, choice: Choice, held: Mapping[str, str]
) -> int:
    attachments: dict[str, bytes] = {}
    metadata: dict[str, dict[str, str]] = {}
    for reader in reversed(readers):
        attachments |= reader.attachments()
        metadata |= reader.metadata()
    attachments.pop(SUMMARY_NAME, None)
    metadata[PIECE] = metadata.get(PIECE, {}) | dict(held)

    def summary(path: Path) -> dict[str, bytes]:
        if ATTACHED_AS not in attachments:
            return {}
        figures = summary_of_piece(LogReader(path), metadata[PIECE])
        return {SUMMARY_NAME: to_json(figures).encode()}

    files: list[McapFile] = [reader.file for reader in readers]
    return write_piece(
        files, output, choice, metadata=metadata, attachments=attachments, add=summary
    )
