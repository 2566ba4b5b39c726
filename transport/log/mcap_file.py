"""The records of an MCAP file, which may be truncated or damaged.

A complete file is read by its index. A file without one is read from its beginning to the first
record that cannot be read. Chunks with a wrong checksum are left out.
"""

import fcntl
import mmap
import os
import struct
import zlib
from collections import Counter
from collections.abc import Container, Iterator, Mapping, Set
from contextlib import suppress
from difflib import get_close_matches
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple, cast

import numpy as np
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, Metadata, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import Writer

from transport.columns import Integers
from transport.log.errors import LogError, UnwritableError
from transport.log.wire import WireData

MAGIC = b"\x89MCAP0\r\n"
"""An MCAP file begins and ends with these bytes (MCAP specification, section Magic)."""
_HEAD = struct.Struct("<BQ")  # opcode, length of the content
HEAD_BYTES = _HEAD.size
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
MESSAGE_HEAD_BYTES = _MESSAGE_HEAD.size
_U64 = struct.Struct("<Q")
_FOOTER_BYTES = HEAD_BYTES + 20
_DATA_END_BYTES = HEAD_BYTES + 4
MESSAGE = int(Opcode.MESSAGE)
CHANNELS = 2**16
"""Number of possible channel numbers in MCAP."""
SECOND = 1_000_000_000
LARGEST_RECORD = 2**30
"""Bytes; a larger stated size is damage."""
MAX_LISTED = 3
"""Maximum number of damaged places that are listed."""

THINNED_NAME = "thinned"
"""Name of the metadata record with the maximum rates of thinned topics."""
REPAIRED = "repaired"
"""Name of the metadata record of a log that was written again from one without an end."""
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


class ChunkPlace(NamedTuple):
    """A chunk at byte `start` of the file, with the instants (ns) of its messages.

    `size` is that of its unpacked records. `channels` are None if they are unknown.
    """

    start: int
    end: int
    first_at: int
    last_at: int
    size: int
    channels: frozenset[int] | None = None


class MessageHeads(NamedTuple):
    """Channel, sequence number, instant of recording (ns) and size (bytes) of N messages."""

    channel: Integers
    sequence: Integers
    logged_at: Integers
    size: Integers


class McapFile:
    """The readable records of an MCAP file.

    `damage` describes unreadable bytes in one line; empty if there are none. A `truncated` file was
    not completed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.bytes = map_log(path)
        self.truncated = not _has_ending(self.bytes)
        self.damage = ""
        self.chunks: list[ChunkPlace] = []
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._attachments: dict[str, Attachment] = {}
        self._metadata: dict[str, dict[str, str]] = {}
        self._stated: Mapping[int, int] = {}
        self._starts: dict[int, Integers] = {}
        self._is_changed = False
        self.is_intact = False
        if self.truncated or not self._read_index():
            self._read_through()

    def _read_index(self) -> bool:
        """Read a complete file by its index; False if the index is absent or damaged.

        Unless the checksum of the data is right, each chunk is checked by its own.
        """
        try:
            summary_at = _checked_summary(self.bytes)
            reader = SeekingReader(cast("IO[bytes]", self.bytes), record_size_limit=LARGEST_RECORD)
            summary = reader.get_summary()
        except (McapError, ValueError, struct.error):
            return False
        if summary is None or summary.statistics is None:
            return False
        self.is_intact = self._has_right_checksum(summary_at - _DATA_END_BYTES)
        self._schemas, self._channels = summary.schemas, summary.channels
        self._stated = summary.statistics.channel_message_counts
        offsets = [one.offset for one in summary.attachment_indexes]
        for offset in [*offsets, *(one.offset for one in summary.metadata_indexes)]:
            self._take(_record(self.bytes, offset))
        wrong = []
        for index in sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset):
            chunk = ChunkPlace(
                index.chunk_start_offset,
                index.chunk_start_offset + index.chunk_length,
                index.message_start_time,
                index.message_end_time,
                index.uncompressed_size,
                frozenset(index.message_index_offsets),
            )
            if self.is_intact or self._is_sound(chunk):
                self.chunks.append(chunk)
            else:
                wrong.append((chunk.start, chunk.end))
        if wrong:
            self.damage = self._describe(wrong)
        elif self._is_changed:
            self.damage = f"{self.path}: damaged, its checksum does not match its content"
        return True

    def _take(self, record: records.McapRecord | None) -> None:
        if isinstance(record, Attachment):
            self._attachments[record.name] = record
        elif isinstance(record, Metadata):
            self._metadata[record.name] = record.metadata

    def _has_right_checksum(self, end_at: int) -> bool:
        end = _record(self.bytes, end_at)
        if not isinstance(end, DataEnd):
            self._is_changed = True
            return False
        if not end.data_section_crc:  # its writer computed none
            return False
        with memoryview(self.bytes) as content, content[:end_at] as data:
            self._is_changed = zlib.crc32(data) != end.data_section_crc
        return not self._is_changed

    def _is_sound(self, chunk: ChunkPlace) -> bool:
        try:
            return all(True for _ in entries_in(self.unpack(chunk)))
        except (LogError, struct.error):
            return False

    def _read_through(self) -> None:
        """Read all records up to the first one that cannot be read."""
        wrong: list[tuple[int, int]] = []
        at, is_whole = len(MAGIC), False
        self.bytes.seek(0)
        try:
            for record in _stream(self.bytes, skip_magic=False).records:
                start, at = at, self.bytes.tell()
                if isinstance(record, Chunk) and not self._read_chunk(record, start, at):
                    wrong.append((start, at))
                self._take(record)
                if is_whole := isinstance(record, DataEnd):
                    break
        except EndOfFile:
            pass  # a truncated file ends within a record
        except Exception:  # noqa: BLE001 - the library, zstandard and struct raise their own
            if self.truncated and self.bytes.tell() < len(self.bytes):
                wrong.append((at, len(self.bytes)))
        if not self.truncated and not is_whole:
            wrong.append((at, len(self.bytes)))
        if wrong:
            self.damage = self._describe(wrong)
        elif not self.truncated:
            self.damage = f"{self.path}: damaged, its index does not match its content"

    def _read_chunk(self, chunk: Chunk, start: int, end: int) -> bool:
        """Take a chunk and the channels that it describes; False if its content is wrong."""
        try:
            data = _unpacked(chunk)
            entries = list(entries_in(data))
        except (LogError, struct.error):
            return False
        numbers = set()
        for opcode, first, last in entries:
            if opcode == MESSAGE:
                numbers.add(_MESSAGE_HEAD.unpack_from(data, first)[0])
                continue
            content = ReadDataStream(BytesIO(data[first:last]))
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(content)
                self._schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(content)
                self._channels[channel.id] = channel
        self.chunks.append(
            ChunkPlace(
                start,
                end,
                chunk.message_start_time,
                chunk.message_end_time,
                len(data),
                frozenset(numbers),
            )
        )
        return True

    def _describe(self, wrong: list[tuple[int, int]]) -> str:
        lost = sum(end - start for start, end in wrong)
        named = [self._place(*span) for span in wrong[:MAX_LISTED]]
        if len(wrong) > MAX_LISTED:
            named.append(f"and {len(wrong) - MAX_LISTED} more")
        return f"{self.path}: damaged, {lost} bytes cannot be read: {'; '.join(named)}"

    def _place(self, start: int, end: int) -> str:
        """Describe damaged bytes by their place, and by the time between the nearest messages."""
        text = f"{end - start} at byte {start}"
        if not self.chunks:
            return text
        origin = self.chunks[0].first_at
        before = [chunk.last_at for chunk in self.chunks if chunk.end <= start]
        after = [chunk.first_at for chunk in self.chunks if chunk.start >= end]
        first = f"{(before[-1] - origin) / SECOND:.1f} s" if before else "the beginning"
        last = f"{(after[0] - origin) / SECOND:.1f} s" if after else "the end"
        return f"{text}, between {first} and {last}"

    def unpack(self, chunk: ChunkPlace) -> bytes:
        """Records of a chunk."""
        record = _record(self.bytes, chunk.start)
        if not isinstance(record, Chunk):
            raise LogError(f"{self.path}: no chunk at byte {chunk.start}")
        return _unpacked(record)

    def messages(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield (channel, log time, data) of all readable messages."""
        for chunk in self.chunks:
            for channel, _, log_time, _, data in stored_in(self.unpack(chunk)):
                yield channel, log_time, data

    def metadata(self) -> dict[str, dict[str, str]]:
        return dict(self._metadata)

    def attachments(self) -> dict[str, Attachment]:
        return dict(self._attachments)

    def channels(self) -> tuple[dict[int, str], Mapping[int, int]]:
        """Topics and message counts of the channels, by channel number."""
        topics = {number: one.topic for number, one in self._channels.items()}
        if self._stated and not self.damage:
            return topics, self._stated
        return topics, Counter(self.heads.channel.tolist())

    def described(self) -> dict[int, Channel]:
        """Channels by number."""
        return self._channels

    def schemas(self) -> dict[int, Schema]:
        """Schemas by number."""
        return self._schemas

    @cached_property
    def heads(self) -> MessageHeads:
        """Heads of all readable messages."""
        columns = [[np.zeros(0, np.int64)] for _ in MessageHeads._fields]
        for number, chunk in enumerate(self.chunks):
            content = self.unpack(chunk)
            data, starts = WireData(content), self.record_starts(number, content)
            starts = starts[data.numbers("u1", starts) == MESSAGE]
            at = starts + HEAD_BYTES
            columns[0].append(data.numbers("<u2", at).astype(np.int64))
            columns[1].append(data.numbers("<u4", at + 2).astype(np.int64))
            columns[2].append(data.numbers("<i8", at + 6))
            columns[3].append(data.numbers("<i8", starts + 1) - MESSAGE_HEAD_BYTES)
        return MessageHeads(*(np.concatenate(parts) for parts in columns))

    @cached_property
    def extents(self) -> Mapping[str, ChannelExtent]:
        """Extents of the channels of an intact file by name, as its writer stated them."""
        if not self.is_intact:
            return {}
        stated = self._metadata.get(EXTENTS, {})
        return {name: ChannelExtent(*map(int, text.split())) for name, text in stated.items()}

    def totals(self, numbered: Container[int]) -> dict[int, int]:
        """Messages of each channel, by its count or, of `numbered` channels, by their numbers."""
        totals = Counter(dict(self._stated or self.channels()[1]))
        for channel, largest in self._largest_numbers().items():
            if channel in numbered:
                totals[channel] = max(totals[channel], largest + 1)
        return totals

    def _largest_numbers(self) -> dict[int, int]:
        """Largest sequence number of the messages of each channel."""
        if extents := self.extents:
            return {
                number: extents[channel.topic].last
                for number, channel in self._channels.items()
                if channel.topic in extents
            }
        largest = np.full(CHANNELS, -1, np.int64)
        np.maximum.at(largest, self.heads.channel, self.heads.sequence)
        return {channel: int(largest[channel]) for channel in np.flatnonzero(largest >= 0).tolist()}

    def may_hold(self, chunk: ChunkPlace, channels: Set[int]) -> bool:
        """Whether a chunk may hold messages of some channels."""
        return chunk.channels is None or not chunk.channels.isdisjoint(channels)

    def record_starts(self, number: int, content: bytes) -> Integers:
        """Places of the records in chunk `number`, whose unpacked content is `content`."""
        starts = self._starts.get(number)
        if starts is None:
            starts = self._starts[number] = np.array(starts_in(content), np.int64)
        return starts


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


def ending_fault(path: Path) -> str:
    """Describe what the ending of a log shows: not completed, or bytes lost or added.

    It is empty for a complete log. Damage within the data is not searched. Raises LogError.
    """
    log = map_log(path)
    if not _has_ending(log):
        return "was not completed"
    try:
        _checked_summary(log)
    except (McapError, ValueError, struct.error):
        return "damaged: its index does not match its content"
    return ""


def _has_ending(log: mmap.mmap) -> bool:
    at = len(log) - len(MAGIC) - _FOOTER_BYTES
    return at >= len(MAGIC) and log[-len(MAGIC) :] == MAGIC and log[at] == Opcode.FOOTER


def _checked_summary(log: mmap.mmap) -> int:
    """Return the first byte of the summary section; raises ValueError if it is damaged."""
    end = len(log) - len(MAGIC) - _FOOTER_BYTES
    footer = _record(log, end)
    if not isinstance(footer, Footer) or not 0 < footer.summary_start < end:
        raise ValueError("no summary section")
    covered = log[footer.summary_start : end + _FOOTER_BYTES - 4]
    if footer.summary_crc not in {0, zlib.crc32(covered)}:
        raise ValueError("wrong checksum of the summary section")
    return footer.summary_start


def _record(log: mmap.mmap, at: int) -> records.McapRecord | None:
    """Return the record at byte `at`; None if it cannot be read."""
    try:
        log.seek(at)
        return next(_stream(log, skip_magic=True).records, None)
    except Exception:  # noqa: BLE001 - the library and struct raise their own
        return None


def _stream(log: mmap.mmap, *, skip_magic: bool) -> StreamReader:
    """Reader of the records from the present position on."""
    return StreamReader(
        cast("IO[bytes]", log),
        skip_magic=skip_magic,
        emit_chunks=True,
        record_size_limit=LARGEST_RECORD,
    )


def _unpacked(chunk: Chunk) -> bytes:
    """Records of a chunk; raises LogError if its size or checksum is wrong."""
    if chunk.uncompressed_size > LARGEST_RECORD:
        raise LogError(f"a chunk of {chunk.uncompressed_size} bytes")
    try:
        stream, length = get_chunk_data_stream(chunk, validate_crc=True)
        data: bytes = stream.read(length)
    except Exception as error:  # zstandard raises its own, and MemoryError
        raise LogError(str(error)) from error
    if len(data) != chunk.uncompressed_size:
        raise LogError("the size of a chunk is wrong")
    return data


def entries_in(chunk: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield (opcode, start, end) of the contents of all records in an unpacked chunk."""
    at, size = 0, len(chunk)
    while at < size:
        opcode, length = _HEAD.unpack_from(chunk, at)
        start = at + HEAD_BYTES
        at = start + length
        if at > size:
            raise LogError("a record goes beyond its chunk")
        yield opcode, start, at


def starts_in(chunk: bytes) -> list[int]:
    """Places of the records in an unpacked chunk."""
    starts: list[int] = []
    at, last = 0, len(chunk) - HEAD_BYTES
    unpack = _U64.unpack_from
    while at <= last:
        starts.append(at)
        at += HEAD_BYTES + unpack(chunk, at + 1)[0]
    return starts


def stored_in(chunk: bytes) -> Iterator[tuple[int, int, int, int, bytes]]:
    """Yield (channel, sequence number, log time, publish time, data) of the messages in a chunk."""
    for opcode, start, end in entries_in(chunk):
        if opcode == MESSAGE:
            yield (
                *_MESSAGE_HEAD.unpack_from(chunk, start),
                chunk[start + MESSAGE_HEAD_BYTES : end],
            )


# ---- Logs written again


def lock(file: IO[bytes], path: Path) -> None:
    """Lock a log for writing until `file` is closed; raises LogError if it is locked."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise LogError(f"{path}: is being written by another process") from error
    except OSError:  # a file system without locks
        return


def write_again(log: McapFile, path: Path) -> int:
    """Write the readable messages, attachments and metadata of a log; returns the messages.

    The metadata `repaired` has their number. Raises OSError.
    """
    count = 0
    with path.open("xb") as file:
        writer = Writer(file, enable_data_crcs=True)
        writer.start()
        schemas = {
            number: writer.register_schema(schema.name, schema.encoding, schema.data)
            for number, schema in log.schemas().items()
        }
        channels = {
            number: writer.register_channel(
                one.topic, one.message_encoding, schemas.get(one.schema_id, 0), one.metadata
            )
            for number, one in log.described().items()
        }
        for name, values in log.metadata().items():
            if name != EXTENTS:
                writer.add_metadata(name, values)
        for one in log.attachments().values():
            writer.add_attachment(one.create_time, one.log_time, one.name, one.media_type, one.data)
        for chunk in log.chunks:
            for channel, sequence, log_time, publish_time, data in stored_in(log.unpack(chunk)):
                if channel in channels:
                    writer.add_message(channels[channel], log_time, data, publish_time, sequence)
                    count += 1
        writer.add_metadata(REPAIRED, {"messages": str(count)})
        writer.finish()  # type: ignore[no-untyped-call]
        file.flush()
        os.fsync(file.fileno())
    return count


def repair(path: Path) -> bool:
    """Replace a truncated log by a complete one with its messages; returns whether it was changed.

    Raises LogError if the file is not an MCAP log, is being written or cannot be replaced; then it
    stays as it is, which readers read up to its end.
    """
    try:
        with path.open("r+b", buffering=0) as file:
            lock(file, path)
            log = McapFile(path)
            if not log.truncated:
                return False
            beside = path.with_name(path.name + ".repaired")
            try:
                write_again(log, beside)
                beside.replace(path)
            finally:
                beside.unlink(missing_ok=True)
    except OSError as error:
        raise UnwritableError(f"{path}: cannot repair the log: {error.strerror}") from error
    return True


def repair_if_truncated(log: Path) -> bool:
    """Repair a log if it exists and is truncated; returns whether it was repaired."""
    with suppress(LogError):  # the writer was killed before the first record
        return log.exists() and repair(log)
    return False
