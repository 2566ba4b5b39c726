"""A file of results, from which an interrupted study resumes.

JSON lines: the first holds the identity of the study, each further line the outcome of one job.
Each line ends with a checksum, which for outcomes covers the identity too. A damaged line, or a
line of another study, is ignored and its job runs again. So does the last line of a killed study if
it is incomplete.
"""

import fcntl
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any
from zlib import crc32

from scenarios.definition.errors import ScenarioError
from scenarios.results.files import named_errors

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
