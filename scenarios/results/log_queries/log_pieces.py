"""Parts of logs as logs of their own, and logs put together again."""

import shutil
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from scenarios.definition.errors import ScenarioError
from scenarios.definition.library import ATTACHED_AS
from scenarios.results.files import SUMMARY_NAME
from scenarios.results.log_summary import scenario_in, summary_of_joined, summary_of_piece
from scenarios.results.summarise import METADATA_NAME
from scenarios.results.summary import to_json
from transport.columns import DEVIATION
from transport.log.mcap_file import McapFile
from transport.log.pieces import KEPT_TOPICS, Choice, write_piece
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
    held = _held_in(reader)
    times = {"from_s": max(float(held.get("from_s", 0.0)), from_s), "to_s": to_s}
    if "to_s" in held:
        times["to_s"] = min(float(held["to_s"]), to_s)
    described = part.described()
    kept = {name: f"{times[name]:g}" for name in times if name in {*held, *described}}
    return _write([reader], output, choice, {**held, **described, **kept})


def merge_logs(logs: Sequence[Path], output: Path, warn: Warn) -> tuple[int, bool]:
    """Write the messages of several logs of one run, each once.

    Returns their number, and whether the new log holds the whole run: then it is no piece. Raises
    LogError for logs of different runs.
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
    parts = [_held_in(reader) for reader in readers]
    if _has_end(readers) and _covers_run(parts, _vehicles_of(readers)):
        return _write(readers, output, Choice(), {}), True
    held = {"merged": ",".join(str(log) for log in logs)}
    begins = [part.get("from_s") for part in parts]
    if None not in begins:
        held["from_s"] = f"{min(float(begin or 0.0) for begin in begins):g}"
    return _write(readers, output, Choice(), held), False


def _held_in(reader: LogReader) -> dict[str, str]:
    """What a piece holds, as in its metadata; empty for another log."""
    return dict(reader.metadata().get(PIECE, {}))


def _vehicles_of(readers: Sequence[LogReader]) -> set[str]:
    """Names of the vehicles of a run; those of the logs if they lack the scenario."""
    try:
        return set(scenario_in(readers[0]).vehicle_names)
    except (LogError, ScenarioError):
        return {name for reader in readers for name in reader.vehicles} - {RUN_SENDER}


def _has_end(readers: Sequence[LogReader]) -> bool:
    return any(reader.counts.get((RUN_SENDER, "end")) for reader in readers)


def _covers_run(parts: Sequence[Mapping[str, str]], vehicles: Collection[str]) -> bool:
    """Whether pieces together hold every time of every topic and vehicle of a run."""
    known = [part for part in parts if "merged" not in part]
    for topic in {*TOPICS, DEVIATION} - KEPT_TOPICS:
        for vehicle in vehicles:
            spans = sorted(
                (float(part.get("from_s", "-inf")), float(part.get("to_s", "inf")))
                for part in known
                if topic in part.get("topics", topic).split(",")
                and vehicle in part.get("vehicles", vehicle).split(",")
            )
            covered_to = float("-inf")
            for begin, end in spans:
                if begin > covered_to:
                    return False
                covered_to = max(covered_to, end)
            if covered_to < float("inf"):
                return False
    return True


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
    metadata.pop(PIECE, None)
    if held:
        metadata[PIECE] = dict(held)

    def summary(path: Path) -> dict[str, bytes]:
        if ATTACHED_AS not in attachments:
            return {}
        for reader in readers:
            written = reader.attachments().get(SUMMARY_NAME)
            if not (held or _held_in(reader) or reader.faults) and written is not None:
                return {SUMMARY_NAME: written}
        piece = LogReader(path)
        figures = summary_of_piece(piece, held) if held else summary_of_joined(piece)
        return {SUMMARY_NAME: to_json(figures).encode()}

    files: list[McapFile] = [reader.file for reader in readers]
    return write_piece(
        files, output, choice, metadata=metadata, attachments=attachments, add=summary
    )
