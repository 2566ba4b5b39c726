"""The records of an MCAP file, which may be truncated or damaged.

A complete file is read by its index, a file without one from its beginning to the first record that
cannot be read. Chunks with a wrong checksum are left out.
"""

import fcntl
import mmap
import os
import struct
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence, Set
from contextlib import suppress
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple, cast

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, Metadata, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.summary import Summary
from mcap.writer import Writer

from transport.columns import Array, Integers
from transport.log.errors import LogError, UnwritableError
from vehicles.schedule import SECOND

MAGIC = b"\x89MCAP0\r\n"
"""An MCAP file begins and ends with these bytes (MCAP specification, section Magic)."""
_HEAD = struct.Struct("<BQ")  # opcode and length of a record
_LENGTH = struct.Struct("<Q")
_MESSAGE = struct.Struct("<BQHIQQ")  # head, channel, number, instants of recording and publication
_CHANNEL_AT, _NUMBER_AT, _LOGGED_AT = 9, 11, 15
_FOOTER_BYTES = _HEAD.size + 20
_DATA_END_BYTES = _HEAD.size + 4
_PADDING = bytes(32)
"""Bytes after unpacked records, so that a record that ends too early can be read beyond its end."""
LARGEST_RECORD = 2**30
"""Bytes; a larger stated size is damage."""

THINNED_NAME = "thinned"
"""Name of the metadata record with the maximum rates of thinned topics."""
REPAIRED = "repaired"
"""Name of the metadata record of a log that was written again from one without an end."""


class ChunkPlace(NamedTuple):
    """A chunk at byte `start` of the file, with the instants (ns) and channels of its messages.

    `before` is the size of all unpacked chunks before it.
    """

    start: int
    end: int
    first_at: int
    last_at: int
    before: int
    channels: Set[int]


class Messages(NamedTuple):
    """N messages of some chunks: message k is `content[starts[k]:ends[k]]`.

    `order` are their places in the unpacked log, `logged_at` the instants of recording (ns).
    """

    content: bytes
    order: Integers
    channels: Integers
    numbers: Integers
    logged_at: Integers
    starts: Integers
    ends: Integers

    def of(self, rows: Array) -> "Messages":
        return Messages(self.content, *(column[rows] for column in self[1:]))


class McapFile:
    """The readable records of an MCAP file.

    `damage` describes unreadable bytes in one line; empty if there are none. A `truncated` file was
    not completed. `chunks` are in the order of the file, schemas and channels by number. `stated`
    are the numbers of messages by channel when the file was completed; empty if they are unknown.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._bytes = map_log(path)
        self.truncated = not _has_ending(self._bytes)
        self.chunks: list[ChunkPlace] = []
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.attachments: dict[str, Attachment] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.stated: Mapping[int, int] = {}
        self._size = 0
        self._places: dict[int, Integers] = {}
        summary = None if self.truncated else _summary(self._bytes)
        self.damage = self._read_by(*summary) if summary else self._read_through()

    def _read_by(self, summary: Summary, summary_at: int) -> str:
        """Read a complete file by its index; returns the damage.

        Unless the checksum of the data is right, each chunk is checked by its own.
        """
        self.schemas, self.channels = summary.schemas, summary.channels
        if summary.statistics:
            self.stated = summary.statistics.channel_message_counts
        offsets = [one.offset for one in summary.attachment_indexes]
        for offset in [*offsets, *(one.offset for one in summary.metadata_indexes)]:
            self._take(offset)
        is_right = self._is_checksum_right(summary_at - _DATA_END_BYTES)
        wrong = []
        for index in sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset):
            start, end = index.chunk_start_offset, index.chunk_start_offset + index.chunk_length
            channels = index.message_index_offsets.keys()
            if is_right and channels:
                instants = index.message_start_time, index.message_end_time
                self.chunks.append(ChunkPlace(start, end, *instants, self._size, channels))
                self._size += index.uncompressed_size
            elif not self._take_chunk(start, end):
                wrong.append((start, end))
        if is_right is False and not wrong:
            return f"{self.path}: damaged, its checksum does not match its content"
        return self._describe(wrong)

    def _is_checksum_right(self, end_at: int) -> bool | None:
        """Whether the data have the checksum of their end at byte `end_at`; None without one."""
        end = _record(self._bytes, end_at)
        if not isinstance(end, DataEnd):
            return False
        if not end.data_section_crc:
            return None
        with memoryview(self._bytes) as content, content[:end_at] as data:
            return zlib.crc32(data) == end.data_section_crc

    def _read_through(self) -> str:
        """Read all records up to the first one that cannot be read; returns the damage."""
        wrong: list[tuple[int, int]] = []
        at, size, length, opcode = len(MAGIC), len(self._bytes), 0, 0
        while at + _HEAD.size <= size and opcode != Opcode.DATA_END:
            opcode, length = _HEAD.unpack_from(self._bytes, at)
            start, end = at, at + _HEAD.size + length
            if end > size:
                break
            if opcode == Opcode.CHUNK and not self._take_chunk(start, end):
                wrong.append((start, end))
            elif opcode in {Opcode.ATTACHMENT, Opcode.METADATA}:
                self._take(start)
            at = end
        if length > LARGEST_RECORD or not (self.truncated or opcode == Opcode.DATA_END):
            wrong.append((at, size))
        if not wrong and not self.truncated:
            return f"{self.path}: damaged, its index does not match its content"
        return self._describe(wrong)

    def _take(self, start: int) -> None:
        record = _record(self._bytes, start)
        if isinstance(record, Attachment):
            self.attachments[record.name] = record
        elif isinstance(record, Metadata):
            self.metadata[record.name] = record.metadata

    def _take_chunk(self, start: int, end: int) -> bool:
        """Take a chunk and the channels that it describes; False if it cannot be read."""
        try:
            chunk, content = self._unpack(start)
            for at in self._places[start].tolist():
                if content[at] not in {Opcode.SCHEMA, Opcode.CHANNEL}:
                    continue
                stream = ReadDataStream(BytesIO(content[at + _HEAD.size :]))
                if content[at] == Opcode.SCHEMA:
                    schema = Schema.read(stream)
                    self.schemas[schema.id] = schema
                else:
                    channel = Channel.read(stream)
                    self.channels[channel.id] = channel
        except (LogError, McapError, ValueError, struct.error):
            return False
        place = ChunkPlace(
            start, end, chunk.message_start_time, chunk.message_end_time, self._size, frozenset()
        )
        channels = frozenset(self.read([place]).channels.tolist())
        self.chunks.append(place._replace(channels=channels))
        self._size += len(content)
        return True

    def _unpack(self, start: int) -> tuple[Chunk, bytes]:
        """Chunk at a byte of the file, and its records; raises LogError if it is damaged."""
        chunk = _record(self._bytes, start)
        if not isinstance(chunk, Chunk) or chunk.uncompressed_size > LARGEST_RECORD:
            raise LogError(f"{self.path}: no chunk at byte {start}")
        try:
            stream, length = get_chunk_data_stream(chunk, validate_crc=True)
            content: bytes = stream.read(length)
            if start not in self._places:
                self._places[start] = _places_in(content, chunk.uncompressed_size)
        except Exception as error:  # the library, zstandard and struct raise their own
            raise LogError(f"{self.path}: damaged chunk at byte {start}: {error}") from error
        return chunk, content

    def read(self, chunks: Sequence[ChunkPlace]) -> Messages:
        """Messages of chunks, in the order of the log; raises LogError."""
        contents, places, shifts, size = [], [np.zeros(0, np.int64)], [0], 0
        for chunk in chunks:
            contents.append(self._unpack(chunk.start)[1])
            places.append(self._places[chunk.start] + size)
            shifts.append(chunk.before - size)
            size += len(contents[-1])
        content = b"".join([*contents, _PADDING])
        order = np.concatenate(places) + np.repeat(shifts, [len(part) for part in places])
        at = np.concatenate(places)
        is_message = numbers_at(content, "u1", at) == Opcode.MESSAGE
        at, order = at[is_message], order[is_message]
        return Messages(
            content,
            order,
            channels=numbers_at(content, "<u2", at + _CHANNEL_AT),
            numbers=numbers_at(content, "<u4", at + _NUMBER_AT),
            logged_at=numbers_at(content, "<i8", at + _LOGGED_AT),
            starts=at + _MESSAGE.size,
            ends=at + _HEAD.size + numbers_at(content, "<i8", at + 1),
        )

    def counts(self) -> Mapping[int, int]:
        """Number of readable messages by channel."""
        if self.stated and not self.damage:
            return self.stated
        return Counter(self.without_content.channels.tolist())

    @cached_property
    def without_content(self) -> Messages:
        """All readable messages, whose places are those in their chunks."""
        parts = [self.read([])[1:], *(self.read([chunk])[1:] for chunk in self.chunks)]
        return Messages(b"", *map(np.concatenate, zip(*parts, strict=True)))

    def _describe(self, wrong: list[tuple[int, int]]) -> str:
        """Describe damaged bytes by their place, and by the time between the nearest messages."""
        if not wrong:
            return ""
        lost = sum(end - start for start, end in wrong)
        (start, _), (_, end) = wrong[0], wrong[-1]
        where = f" in {len(wrong)} places" if len(wrong) > 1 else ""
        text = f"{self.path}: damaged, {lost} bytes cannot be read{where}, from byte {start} on"
        if not self.chunks:
            return text
        origin = self.chunks[0].first_at
        before = [chunk.last_at for chunk in self.chunks if chunk.end <= start]
        after = [chunk.first_at for chunk in self.chunks if chunk.start >= end]
        first = f"{(before[-1] - origin) / SECOND:.1f} s" if before else "the beginning"
        last = f"{(after[0] - origin) / SECOND:.1f} s" if after else "the end"
        return f"{text}, between {first} and {last}"


def map_log(path: Path) -> mmap.mmap:
    """Map an MCAP file into memory; raises LogError for missing and other files."""
    try:
        with path.open("rb") as file:
            log = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except ValueError as error:  # an empty file cannot be mapped
        raise LogError(f"{path}: is empty, not an MCAP log") from error
    except OSError as error:
        raise LogError(f"{path}: cannot read the log: {error.strerror}") from error
    if log[: len(MAGIC)] != MAGIC:
        raise LogError(f"{path}: is not an MCAP log; expected run.mcap or the folder of a run")
    return log


def ending_fault(path: Path) -> str:
    """Describe what the ending of a log shows: not completed, or bytes lost or added.

    It is empty for a complete log. Damage within the data is not searched. Raises LogError.
    """
    log = map_log(path)
    if not _has_ending(log):
        return "was not completed"
    return "" if _summary(log) else "damaged: its index does not match its content"


def _has_ending(log: mmap.mmap) -> bool:
    at = len(log) - len(MAGIC) - _FOOTER_BYTES
    return at >= len(MAGIC) and log[-len(MAGIC) :] == MAGIC and log[at] == Opcode.FOOTER


def _summary(log: mmap.mmap) -> tuple[Summary, int] | None:
    """Summary of a file and its first byte; None if it is absent or damaged."""
    end = len(log) - len(MAGIC) - _FOOTER_BYTES
    footer = _record(log, end)
    if not isinstance(footer, Footer) or not 0 < footer.summary_start < end:
        return None
    covered = log[footer.summary_start : end + _FOOTER_BYTES - 4]
    if footer.summary_crc not in {0, zlib.crc32(covered)}:
        return None
    try:
        reader = SeekingReader(cast("IO[bytes]", log), record_size_limit=LARGEST_RECORD)
        summary = reader.get_summary()
    except (McapError, ValueError, struct.error):
        return None
    return (summary, footer.summary_start) if summary and summary.statistics else None


def _record(log: mmap.mmap, at: int) -> object:
    """Record at byte `at`; None if it cannot be read."""
    try:
        log.seek(at)
        stream = cast("IO[bytes]", log)
        reader = StreamReader(
            stream, skip_magic=True, emit_chunks=True, record_size_limit=LARGEST_RECORD
        )
        return next(reader.records, None)
    except Exception:  # noqa: BLE001 - the library and struct raise their own
        return None


def _places_in(content: bytes, size: int) -> Integers:
    """Places of the records in a chunk of `size` bytes; raises ValueError or struct.error."""
    places: list[int] = []
    at, end, head, length_at = 0, len(content), _HEAD.size, _LENGTH.unpack_from
    while at < end:
        places.append(at)
        at += head + length_at(content, at + 1)[0]
    if at != end or end != size:
        raise ValueError("its size is wrong")
    return np.array(places, np.int64)


def numbers_at(data: bytes, dtype: str, places: Integers) -> Array:
    """Little-endian numbers at `places` (bytes)."""
    shape = (len(data) - np.dtype(dtype).itemsize + 1,)
    at_every_byte: Array = np.ndarray(shape, dtype, data, strides=(1,))
    numbers: Array = at_every_byte[places]
    return numbers


# ---- Logs written again


def lock(file: IO[bytes], path: Path) -> None:
    """Lock a log for writing until `file` is closed; raises LogError if it is locked."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise LogError(f"{path}: is being written by another process") from error
    except OSError:  # a file system without locks
        return


def write_again(log: McapFile, path: Path) -> None:
    """Put the readable messages, attachments and metadata of a log in place of a file.

    The metadata `repaired` has the number of messages. Raises OSError.
    """
    part = path.with_name(f"{path.name}.part")
    try:
        with part.open("wb") as file:
            _copy(log, file)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _copy(log: McapFile, file: IO[bytes]) -> None:
    count, writer = 0, Writer(file, enable_data_crcs=True)
    writer.start()
    schemas = {
        number: writer.register_schema(schema.name, schema.encoding, schema.data)
        for number, schema in log.schemas.items()
    }
    channels = {
        number: writer.register_channel(
            one.topic, one.message_encoding, schemas.get(one.schema_id, 0), one.metadata
        )
        for number, one in log.channels.items()
    }
    for name, values in log.metadata.items():
        writer.add_metadata(name, values)
    for one in log.attachments.values():
        writer.add_attachment(one.create_time, one.log_time, one.name, one.media_type, one.data)
    for chunk in log.chunks:
        read = log.read([chunk])
        for start, end in zip(read.starts.tolist(), read.ends.tolist(), strict=True):
            head = _MESSAGE.unpack_from(read.content, start - _MESSAGE.size)
            _, _, channel, number, logged_at, sent_at = head
            if channel in channels:
                data = read.content[start:end]
                writer.add_message(channels[channel], logged_at, data, sent_at, number)
                count += 1
    writer.add_metadata(REPAIRED, {"messages": str(count)})
    writer.finish()  # type: ignore[no-untyped-call]


def repair(path: Path) -> bool:
    """Replace a truncated log by a complete one with its messages; returns whether it was changed.

    Raises LogError if the file is not an MCAP log, is being written or cannot be replaced; then it
    stays as it is, which readers read up to its end.
    """
    try:
        with path.open("r+b", buffering=0) as file:
            lock(file, path)
            log = McapFile(path)
            if log.truncated:
                write_again(log, path)
            return log.truncated
    except OSError as error:
        raise UnwritableError(f"{path}: cannot repair the log: {error.strerror}") from error


def repair_if_truncated(log: Path) -> bool:
    """Repair a log if it exists and is truncated; returns whether it was repaired."""
    with suppress(LogError):  # the writer was killed before the first record
        return log.exists() and repair(log)
    return False
