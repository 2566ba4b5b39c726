"""Results as they come, in a file that outlives the driver: killed and started again, it goes on.

JSON lines: the first says what is asked, each further one what came of one run. A line is written
whole and at once, so a driver that is killed leaves at most its last line torn, which is dropped.
"""

import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from scenarios.definition.errors import ScenarioError

JOURNAL = "journal.jsonl"
SCHEMA = "convoy.journal/1"

Entry = dict[str, Any]
"""What is kept of one run: only what JSON has."""


class RunJournal:
    """The journal of one folder, open for writing; `entries` are those that it held, by run."""

    def __init__(self, file: IO[bytes], entries: Mapping[str, Entry]) -> None:
        self._file = file
        self.entries = dict(entries)

    def add(self, key: str, entry: Entry) -> None:
        """Keep what came of a run, at once."""
        self._file.write(_line({"run": key} | entry))
        self._file.flush()
        self.entries[key] = entry


@contextmanager
def open_journal(folder: Path, asked: Mapping[str, Any]) -> Iterator[RunJournal]:
    """Open the journal of `folder`, a new one or that of the very same question.

    Raises ScenarioError if it holds the answers to another one, if another process writes it, or if
    it was damaged otherwise than by a kill.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / JOURNAL
    wanted = json.loads(json.dumps(dict(asked)))  # as it comes back from the file
    with path.open("ab+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            why = "another command writes into this folder; give another one by --out"
            raise ScenarioError([f"{folder}: {why}"]) from error
        lines = _whole_lines(file, path)
        if not lines:
            file.write(_line({"schema": SCHEMA, "asked": wanted}))
            file.flush()
        else:
            _refuse_other(folder, lines[0].get("asked"), wanted)
        entries = {str(one.pop("run")): one for one in lines[1:]}
        yield RunJournal(file, entries)


def _line(content: Entry) -> bytes:
    return json.dumps(content, allow_nan=False, separators=(",", ":")).encode() + b"\n"


def _whole_lines(file: IO[bytes], path: Path) -> list[Entry]:
    """Read all lines; a last one without its end is cut off the file."""
    file.seek(0)
    text = file.read()
    whole = text.rfind(b"\n") + 1
    if whole < len(text):
        os.truncate(path, whole)
    lines = []
    for number, line in enumerate(text[:whole].splitlines(), start=1):
        try:
            entry = json.loads(line)
        except ValueError:
            entry = None
        if not isinstance(entry, dict) or ("schema" if number == 1 else "run") not in entry:
            raise ScenarioError([f"{path}, line {number}: damaged; give another folder by --out"])
        lines.append(entry)
    if lines and lines[0]["schema"] != SCHEMA:
        why = f"given {lines[0]['schema']}, allowed {SCHEMA}; give another folder by --out"
        raise ScenarioError([f"{path}: schema: {why}"])
    return lines


def _refuse_other(folder: Path, there: Any, wanted: Mapping[str, Any]) -> None:
    """Raise ScenarioError, with what differs, unless the journal answers the same question."""
    before = there if isinstance(there, dict) else {}
    names = [name for name in {**wanted, **before} if before.get(name) != wanted.get(name)]
    if names:
        differs = "; ".join(
            f"{name}: {_differs(before.get(name), wanted.get(name))}" for name in names
        )
        what = f"holds the answers to another command: {differs}"
        raise ScenarioError([f"{folder}: {what}; give another folder by --out"])


LONGEST = 60
"""Letters of a value that are shown."""


def _differs(there: Any, here: Any) -> str:
    shown = [text if isinstance(text, str) else json.dumps(text) for text in (there, here)]
    if max(map(len, shown)) > LONGEST:
        return "not the same"
    return f"{shown[0]} there, {shown[1]} now"
