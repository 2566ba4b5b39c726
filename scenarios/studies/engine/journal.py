"""Results in a file that survives the driver, which resumes from it.

JSON lines: the first holds the question, each further one the outcome of one job. Each line ends
with a checksum, and that of an outcome covers the question too: so a damaged line, or one that
belongs to another question, never becomes a figure. A line is written whole and at once, so a
driver that is killed leaves at most its last line torn; its job is done again.
"""

import fcntl
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any
from zlib import crc32

from scenarios.definition.errors import ScenarioError

JOURNAL = "journal.jsonl"
SCHEMA = "convoy.journal/2"
CHECKSUM, CHECKSUM_BYTES = re.compile(rb',"crc32":"([0-9a-f]{8})"}'), 20
OTHER_FOLDER = "give another folder by --out"

Entry = dict[str, Any]
"""What is kept of one job: only what JSON has."""


class RunJournal:
    """The open journal of one folder; `entries` are those in it, by job."""

    def __init__(self, path: Path, file: IO[bytes], identity: Mapping[str, Any]) -> None:
        self._path = path
        self._file = file
        self._identity_crc = crc32(json.dumps(identity, sort_keys=True).encode())
        self.entries: dict[str, Entry] = {}

    def add(self, key: str, entry: Entry) -> Entry:
        """Write the outcome of a job at once; returns it as it will be read back."""
        line = _encoded({"run": key, "entry": entry}, self._identity_crc)
        self._file.write(line)
        self._file.flush()
        self.entries[key] = json.loads(line)["entry"]
        return self.entries[key]

    def load(self, line: bytes) -> bool:
        """Read a line of the file; false if it is damaged or belongs to another question."""
        content = _decoded(line, self._identity_crc)
        if content is None or "run" not in content:
            return False
        self.entries[content["run"]] = content["entry"]
        return True

    def write_header(self, identity: Mapping[str, Any]) -> None:
        self._file.write(_encoded({"schema": SCHEMA, "identity": identity}))
        self._file.flush()

    def remove(self) -> None:
        self._path.unlink(missing_ok=True)


@contextmanager
def open_journal(
    folder: Path, identity: Mapping[str, Any], report: Callable[[str], None]
) -> Iterator[RunJournal]:
    """Open the journal of `folder`, a new one or that of the same question.

    A damaged line is reported to `report`, and its job runs again. Raises ScenarioError if the
    journal belongs to another question, or if another process writes it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / JOURNAL
    wanted = json.loads(json.dumps(dict(identity)))  # as it comes back from the file
    with os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT, 0o666), "rb+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            why = f"another command writes into this folder; {OTHER_FOLDER}"
            raise ScenarioError([f"{folder}: {why}"]) from error
        journal = RunJournal(path, file, wanted)
        _read(journal, file, path, wanted, report)
        yield journal


def _read(
    journal: RunJournal,
    file: IO[bytes],
    path: Path,
    wanted: Mapping[str, Any],
    report: Callable[[str], None],
) -> None:
    """Read all lines; blanks damaged ones and leaves the file at its end."""
    content = file.read()
    *lines, torn = content.split(b"\n")
    if len(lines) == 1:  # a question without answers: this one takes its place
        lines, torn = [], content
    file.truncate(len(content) - len(torn))
    damaged, begins, has_question = [], 0, False
    for number, line in enumerate(lines, start=1):
        header = _decoded(line)
        if header is not None and "identity" in header:
            _refuse_other(path, header, wanted)
            has_question = True
        elif line.strip() and not journal.load(line):
            _refuse_other_version(path, line)
            damaged.append((number, begins, len(line)))
        begins += len(line) + 1
    if damaged and not has_question and not journal.entries:
        raise ScenarioError([f"{path}, line 1: damaged; {OTHER_FOLDER}"])
    for number, at, length in damaged:
        report(f"{path}, line {number}: damaged; what it held is computed again")
        file.seek(at)
        file.write(b" " * length)
    file.seek(0, os.SEEK_END)
    if not has_question:
        journal.write_header(wanted)


def _encoded(content: Mapping[str, Any], question: int = 0) -> bytes:
    """Encode one line with its checksum, which covers the question too."""
    text = json.dumps(content, separators=(",", ":")).encode()[:-1]
    return text + b',"crc32":"%08x"}\n' % crc32(text, question)


def _decoded(line: bytes, question: int = 0) -> dict[str, Any] | None:
    """Decode a line; None if its checksum does not match content and question."""
    text, checksum = line[:-CHECKSUM_BYTES], CHECKSUM.fullmatch(line[-CHECKSUM_BYTES:])
    if checksum is None or int(checksum[1], 16) != crc32(text, question):
        return None
    content: dict[str, Any] = json.loads(text + b"}")
    return content


def _refuse_other_version(path: Path, line: bytes) -> None:
    """Raise ScenarioError if a line without a valid checksum begins a journal of another schema."""
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        return
    if not isinstance(content, dict) or "crc32" in content:
        return
    if content.get("schema", SCHEMA) != SCHEMA:
        why = f"given {content['schema']}, allowed {SCHEMA}; {OTHER_FOLDER}"
        raise ScenarioError([f"{path}: schema: {why}"])


def _refuse_other(path: Path, header: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Raise ScenarioError, with the differences, unless the journal has the same question."""
    if header["schema"] != SCHEMA:
        why = f"given {header['schema']}, allowed {SCHEMA}; {OTHER_FOLDER}"
        raise ScenarioError([f"{path}: schema: {why}"])
    before = header["identity"]
    names = [name for name in {**wanted, **before} if before.get(name) != wanted.get(name)]
    if names:
        differs = "; ".join(
            f"{name}: {_difference(before.get(name), wanted.get(name))}" for name in names
        )
        what = f"holds the answers to another command: {differs}"
        raise ScenarioError([f"{path.parent}: {what}; {OTHER_FOLDER}"])


MAX_SHOWN = 60
"""Letters of a value that are shown."""


def _difference(there: Any, here: Any) -> str:
    shown = [text if isinstance(text, str) else json.dumps(text) for text in (there, here)]
    if max(map(len, shown)) > MAX_SHOWN:
        return "not the same"
    return f"{shown[0]} there, {shown[1]} now"
