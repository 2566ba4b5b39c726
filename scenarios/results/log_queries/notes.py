"""Notes on instants of a run, in a file next to its log, which they do not change."""

import tomllib
from dataclasses import asdict, dataclass
from pathlib import Path

import tomli_w
from pydantic import TypeAdapter, ValidationError

from scenarios.definition.errors import ScenarioError
from scenarios.results.files import write_whole
from transport.log.reader import LogReader
from vehicles.messages import RunStart
from vehicles.schedule import SECOND

SUFFIX = ".notes.toml"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunNote:
    """A text about the time `at_s` (s after the start); `written_at` is a time in ISO 8601."""

    at_s: float
    text: str
    written_at: str = ""


_NOTES = TypeAdapter(list[RunNote])


def notes_file(log: Path) -> Path:
    """Path of the notes of a log: `run.notes.toml` next to `run.mcap`."""
    return log.with_name(log.stem + SUFFIX)


def duration_s(log: Path) -> float:
    """Recorded time (s) of a log from the start of its run; raises LogError."""
    reader = LogReader(log)
    for at, _, message in reader.messages():
        if isinstance(message, RunStart):
            return (reader.last_at - message.start_at_ns) / SECOND
        if at - reader.first_at > SECOND:  # the start was not recorded
            break
    return (reader.last_at - reader.first_at) / SECOND


def read_notes(log: Path) -> tuple[RunNote, ...]:
    """Notes of a log in order of time; raises ScenarioError for an invalid file."""
    path = notes_file(log)
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
        notes = _NOTES.validate_python(tables.get("note", []))
    except FileNotFoundError:
        return ()
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise ScenarioError([f"{path}: note {place}: {first['msg'].lower()}"]) from error
    except ValueError as error:  # not UTF-8, or not TOML
        raise ScenarioError([f"{path}: {error}"]) from error
    return tuple(sorted(notes, key=lambda note: note.at_s))


def add_note(log: Path, note: RunNote) -> None:
    """Add a note; raises ScenarioError or OSError."""
    _write(log, (*read_notes(log), note))


def delete_note(log: Path, number: int) -> RunNote:
    """Delete and return a note by its number from 1 in order of time; raises ScenarioError."""
    notes = read_notes(log)
    if not 1 <= number <= len(notes):
        allowed = f"1 to {len(notes)}" if notes else "none: there are no notes"
        raise ScenarioError([f"{notes_file(log)}: no note {number}, allowed {allowed}"])
    _write(log, (*notes[: number - 1], *notes[number:]))
    return notes[number - 1]


def _write(log: Path, notes: tuple[RunNote, ...]) -> None:
    path = notes_file(log)
    if not notes:
        path.unlink()
        return
    ordered = sorted(notes, key=lambda note: note.at_s)
    text = tomli_w.dumps({"note": [asdict(note) for note in ordered]})
    write_whole(path, text.encode())
