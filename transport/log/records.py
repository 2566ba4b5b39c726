"""Valid records of an MCAP file that may be truncated or damaged.

A record is valid if its content has the structure of its type. After an invalid one the scan
resumes at the next valid record followed by another one, so that a damaged length costs one record.
"""

import fcntl
import mmap
import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import IO, NamedTuple

from transport.texts import ConvoyError

MAGIC = b"\x89MCAP0\r\n"
"""An MCAP file begins and ends with these bytes (MCAP specification, section Magic)."""
_HEAD = struct.Struct("<BQ")  # opcode, length of the content
HEAD_BYTES = _HEAD.size
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
MESSAGE_HEAD_BYTES = _MESSAGE_HEAD.size
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last log time, size, CRC, length of a name
_FOOTER_HEAD = struct.Struct("<BQQQI")  # opcode, length, summary, its offsets, CRC
_U32 = struct.Struct("<I")
_U64 = struct.Struct("<Q")
_ENTRY = struct.Struct("<HQ")  # channel, place of its index
_PLACE = struct.Struct("<QQ")  # start and length of a record
_COUNTS = struct.Struct("<QHIIII")  # messages, schemas, channels, attachments, metadata, chunks
HEADER = 0x01
_FOOTER = 0x02
SCHEMA = 0x03
CHANNEL = 0x04
MESSAGE = 0x05
CHUNK = 0x06
MESSAGE_INDEX = 0x07
ATTACHMENT = 0x09
METADATA = 0x0C
STATISTICS = 0x0B
_CHUNK_INDEX, _ATTACHMENT_INDEX, _METADATA_INDEX = 0x08, 0x0A, 0x0D
DATA_END = 0x0F
_BEGINNING = re.compile(rb"[\x06\x07\x09\x0c\x0f](?=.{4}\x00{4})", re.DOTALL)
"""Opcode of a record of the data section, and a length below 4 GiB."""


THINNED_NAME = "thinned"
"""Name of the metadata record with the maximum rates of thinned topics."""
REPAIRED = "repaired"
"""Name of the metadata record of a repaired log."""
EXTENTS = "channels"
"""Name of the metadata record with the `ChannelExtent` of each channel, by its name."""


class ChannelExtent(NamedTuple):
    """Smallest and largest number of the messages of a channel, and bounds (ns) of their instants.

    Every instant in a message is between `earliest` and `latest` after the instant of its
    recording; negative values are before it. So the messages with an instant in an interval are
    found without reading others.
    """

    first: int
    last: int
    earliest: int
    latest: int


class LogError(ConvoyError):
    """A log that cannot be written or read, in one line."""


class UnwritableError(LogError):
    """A log or summary that cannot be written: a full disk, a removed file."""


class DamageError(ValueError):
    """A record whose content does not have the structure of its type."""


class Span(NamedTuple):
    """Bytes of a file from `start` to before `end`."""

    start: int
    end: int


class Record(NamedTuple):
    """A valid record: opcode, start, and start of the next record."""

    opcode: int
    start: int
    end: int

    @property
    def content(self) -> slice:
        """Bytes without opcode and length."""
        return slice(self.start + _HEAD.size, self.end)


class ChunkHead(NamedTuple):
    """Header of a chunk (instants in ns), and its packed bytes."""

    first_at: int
    last_at: int
    size: int
    crc: int
    compression: str
    packed: Span


@dataclass(frozen=True, slots=True)
class Layout:
    """Valid records of the data section, and the gaps between them.

    A `truncated` file was not completed. `summary` is the summary section, empty if it is missing
    or its checksum is wrong.

    The checksum of an `intact` file covers its data section and is right. Then `records` has only
    the chunks, attachments and metadata that the summary lists, and `chunk_channels` are the
    numbers of the channels in each chunk.
    """

    records: tuple[Record, ...]
    gaps: tuple[Span, ...]
    truncated: bool
    summary: Span
    intact: bool = False
    chunk_channels: Mapping[int, frozenset[int]] = field(default_factory=dict)


def lock(file: IO[bytes], path: Path) -> None:
    """Lock a log for writing until `file` is closed; raises LogError if it is locked."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise LogError(f"{path}: is being written by another process") from error
    except OSError:  # a file system without locks
        return


def map_log(path: Path) -> mmap.mmap:
    """Map an MCAP file into memory; raises LogError for missing and other files."""
    try:
        with path.open("rb") as file:
            log = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except ValueError as error:  # an empty file cannot be mapped
        raise LogError(f"{path}: is empty, not an MCAP log") from error
    except OSError as error:
        text = f"{path}: cannot read the log: {error.strerror}{_similar(path)}"
        raise LogError(text) from error
    if log[: len(MAGIC)] != MAGIC:
        raise LogError(f"{path}: is not an MCAP log; expected run.mcap or the folder of a run")
    return log


def _similar(path: Path) -> str:
    """Return a question that offers a folder or file with a similar name; empty without one."""
    if path.exists() or not path.parent.is_dir():
        return ""
    names = [one.name for one in path.parent.iterdir()]
    matches = get_close_matches(path.name, names, n=1, cutoff=0.7)
    return f", did you mean {path.with_name(matches[0])}?" if matches else ""


def scan(log: mmap.mmap) -> Layout:
    """Find the valid records of a file: by its index if the checksums are right."""
    complete, summary = _ending(log)
    if complete and _has_checksum(log, summary):
        layout = _indexed(log, summary)
        if layout is not None:
            return layout
    return _walked(log, complete, summary)


def _has_checksum(log: mmap.mmap, summary: Span) -> bool:
    """Whether the file has checksums of its data and summary sections, and both are right."""
    end = _record_at(log, summary.start - HEAD_BYTES - _U32.size)
    if end is None or end.opcode != DATA_END or end.end != summary.start:
        return False
    (data_crc,) = _U32.unpack_from(log, end.content.start)
    summary_crc: int = _FOOTER_HEAD.unpack_from(log, summary.end)[-1]
    if not (data_crc and summary_crc and _summary_is_valid(log, summary)):
        return False
    with memoryview(log) as content, content[: end.start] as data:
        return bool(zlib.crc32(data) == data_crc)


def _indexed(log: mmap.mmap, summary: Span) -> Layout | None:
    """Records of an intact file by its index; None if the index does not list all of them."""
    content = log[summary.start : summary.end]
    places: dict[int, list[int]] = {CHUNK: [], ATTACHMENT: [], METADATA: []}
    channels: dict[int, frozenset[int]] = {}
    counts: list[int] = []
    for opcode, start, _ in entries_in(content):
        if opcode == _CHUNK_INDEX:
            at, _ = _PLACE.unpack_from(content, start + _PLACE.size)  # after two instants
            (length,) = _U32.unpack_from(content, start + 2 * _PLACE.size)
            first = start + 2 * _PLACE.size + _U32.size
            numbers = [row[0] for row in _ENTRY.iter_unpack(content[first : first + length])]
            places[CHUNK].append(at)
            channels[at] = frozenset(numbers)
        elif opcode in {_ATTACHMENT_INDEX, _METADATA_INDEX}:
            at, _ = _PLACE.unpack_from(content, start)
            places[ATTACHMENT if opcode == _ATTACHMENT_INDEX else METADATA].append(at)
        elif opcode == STATISTICS:
            _, _, _, *counts = _COUNTS.unpack_from(content, start)
    if not counts or counts != [len(places[kind]) for kind in (ATTACHMENT, METADATA, CHUNK)]:
        return None
    listed = sorted((at, kind) for kind, starts in places.items() for at in starts)
    records = [record for at, _ in listed if (record := _record_at(log, at)) is not None]
    if [(record.start, record.opcode) for record in records] != listed or not channels:
        return None
    return Layout(tuple(records), (), False, summary, intact=True, chunk_channels=channels)


def _walked(log: mmap.mmap, complete: bool, summary: Span) -> Layout:
    """Find the valid records of a file by reading all of them."""
    records: list[Record] = []
    gaps: list[Span] = []
    at = len(MAGIC)
    while True:
        record = _record_at(log, at)
        if record is None:
            resumed_at = _next_valid(log, at + 1)
            if resumed_at is None:
                break
            gaps.append(Span(at, resumed_at))
            at = resumed_at
        elif record.opcode == DATA_END:
            at = record.end
            break
        else:
            records.append(record)
            at = record.end
    if at < summary.end and at != summary.start:  # bytes before were lost, or added
        gaps.append(Span(at, summary.end))
        summary = Span(0, 0)
    elif summary.end and not _summary_is_valid(log, summary):
        gaps.append(summary)
        summary = Span(0, 0)
    return Layout(tuple(records), tuple(gaps), not complete, summary)


def ending_fault(path: Path) -> str:
    """Describe what the ending of a log shows: not completed, or bytes lost or added.

    It is empty for a complete log. Damage within the data is not searched. Raises LogError.
    """
    log = map_log(path)
    complete, summary = _ending(log)
    if not complete:
        return "was not completed"
    if summary.end and not _summary_is_valid(log, summary):
        return "damaged: its index does not match its content"
    return ""


def _ending(log: mmap.mmap) -> tuple[bool, Span]:
    """Whether the file has a complete ending, and its summary section, which may be empty.

    The section begins at the footer if it is not where the footer has it: bytes before are missing.
    """
    at = len(log) - len(MAGIC) - _FOOTER_HEAD.size
    if at < len(MAGIC) or log[-len(MAGIC) :] != MAGIC:
        return False, Span(0, 0)
    opcode, length, start, _, _ = _FOOTER_HEAD.unpack_from(log, at)
    if opcode != _FOOTER or length != _FOOTER_HEAD.size - _HEAD.size:
        return False, Span(0, 0)
    if not start:
        return True, Span(0, 0)
    return True, Span(start if len(MAGIC) < start < at else at, at)


def _summary_is_valid(log: mmap.mmap, summary: Span) -> bool:
    crc: int = _FOOTER_HEAD.unpack_from(log, summary.end)[-1]
    covered = log[summary.start : summary.end + _FOOTER_HEAD.size - _U32.size]
    return crc in {0, zlib.crc32(covered)}


def _next_valid(log: mmap.mmap, at: int) -> int | None:
    """Find the next valid record that is followed by another one or by the end of the file."""
    for match in _BEGINNING.finditer(log, at):
        record = _record_at(log, match.start())
        if record and (record.end == len(log) or _record_at(log, record.end)):
            return record.start
        if record and record.opcode == DATA_END:
            return record.start
    return None


def _record_at(log: mmap.mmap, at: int) -> Record | None:
    """Record at byte `at`; None if it is not valid."""
    if at + _HEAD.size > len(log):
        return None
    opcode, length = _HEAD.unpack_from(log, at)
    record = Record(opcode, at, at + _HEAD.size + length)
    if record.end > len(log):
        return None
    check = {
        HEADER: _check_header,
        CHUNK: chunk_head,
        MESSAGE_INDEX: message_index_of,
        ATTACHMENT: attachment,
        METADATA: metadata,
        DATA_END: _check_data_end,
    }.get(opcode)
    try:
        if check is None:
            return None
        check(log, record)
    except (DamageError, struct.error, UnicodeDecodeError):
        return None
    return record


def _check_header(log: mmap.mmap, record: Record) -> None:
    at = record.content.start
    for _ in ("profile", "library"):
        _, at = _text(log, at, record.end)
    if record.start != len(MAGIC) or at != record.end:
        raise DamageError("not a header")


def _check_data_end(_: mmap.mmap, record: Record) -> None:
    if record.end - record.content.start != _U32.size:
        raise DamageError("not the end of the data")


def chunk_head(log: mmap.mmap, record: Record) -> ChunkHead:
    at = record.content.start
    if at + _CHUNK_HEAD.size > record.end:
        raise DamageError("not a chunk")
    first_at, last_at, size, crc, _ = _CHUNK_HEAD.unpack_from(log, at)
    compression, at = _text(log, at + _CHUNK_HEAD.size - _U32.size, record.end)
    (length,) = _U64.unpack_from(log, at)
    at += _U64.size
    if at + length != record.end:
        raise DamageError("not a chunk")
    return ChunkHead(first_at, last_at, size, crc, compression, Span(at, record.end))


def message_index_of(log: mmap.mmap, record: Record) -> tuple[int, int]:
    """Channel of a message index, and the number of messages."""
    at = record.content.start
    if record.end - at < 6:
        raise DamageError("not an index")
    channel, length = struct.unpack_from("<HI", log, at)
    if at + 6 + length != record.end or length % 16:
        raise DamageError("not an index")
    return channel, length // 16


def attachment(log: mmap.mmap, record: Record) -> tuple[str, bytes]:
    """Name and content of an attached file."""
    at = record.content.start
    crc_at = record.end - _U32.size
    name, start = _text(log, at + 2 * _U64.size, crc_at)
    _, start = _text(log, start, crc_at)
    (length,) = _U64.unpack_from(log, start)
    start += _U64.size
    if start + length != crc_at:
        raise DamageError("not an attachment")
    (crc,) = _U32.unpack_from(log, crc_at)
    if crc not in {0, zlib.crc32(log[at:crc_at])}:
        raise DamageError("wrong checksum")
    return name, log[start:crc_at]


def metadata(log: mmap.mmap, record: Record) -> tuple[str, dict[str, str]]:
    """Name and values of a metadata record."""
    name, at = _text(log, record.content.start, record.end)
    (length,) = _U32.unpack_from(log, at)
    at += _U32.size
    if at + length != record.end:
        raise DamageError("not metadata")
    values: dict[str, str] = {}
    while at < record.end:
        key, at = _text(log, at, record.end)
        values[key], at = _text(log, at, record.end)
    return name, values


def _text(log: mmap.mmap, at: int, end: int) -> tuple[str, int]:
    """Read a text with its length, which must end by `end`; returns the text and its end."""
    (length,) = _U32.unpack_from(log, at)
    at += _U32.size
    if at + length > end:
        raise DamageError("a text exceeds its record")
    return log[at : at + length].decode(), at + length


def entries_in(chunk: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield (opcode, start, end) of the contents of all records in an unpacked chunk."""
    at, size = 0, len(chunk)
    unpack, head = _HEAD.unpack_from, _HEAD.size
    while at < size:
        if at + head > size:
            raise DamageError("a record goes beyond its chunk")
        opcode, length = unpack(chunk, at)
        start = at + head
        at = start + length
        if at > size:
            raise DamageError("a record goes beyond its chunk")
        yield opcode, start, at


def starts_in(chunk: bytes) -> list[int]:
    """Places of the records in an unpacked chunk."""
    starts: list[int] = []
    at, last = 0, len(chunk) - HEAD_BYTES
    unpack = _U64.unpack_from
    while at <= last:
        starts.append(at)
        at += HEAD_BYTES + unpack(chunk, at + 1)[0]
    if at != len(chunk):
        raise DamageError("a record goes beyond its chunk")
    return starts


def stored_in(chunk: bytes) -> Iterator[tuple[int, int, int, int, bytes]]:
    """Yield (channel, sequence number, log time, publish time, data) of the messages in a chunk."""
    unpack, head = _MESSAGE_HEAD.unpack_from, _MESSAGE_HEAD.size
    for opcode, start, end in entries_in(chunk):
        if opcode == MESSAGE:
            yield (*unpack(chunk, start), chunk[start + head : end])


def messages_in(chunk: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Yield (channel, log time, data) of the messages in an unpacked chunk."""
    unpack, head = _MESSAGE_HEAD.unpack_from, _MESSAGE_HEAD.size
    for opcode, start, end in entries_in(chunk):
        if opcode == MESSAGE:
            channel, _, log_time, _ = unpack(chunk, start)
            yield channel, log_time, chunk[start + head : end]
