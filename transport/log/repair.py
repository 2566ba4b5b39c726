"""Repair of a truncated log: its complete records are kept and indexed.

Messages are neither decoded nor repacked. The missing end is written after the last complete
record. If a record before that is damaged, a new file without it replaces the log.
"""

import errno
import os
import struct
from collections import Counter, defaultdict
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO, RawIOBase
from pathlib import Path
from zlib import crc32

from mcap import records
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode

from transport.log.mcap_file import McapFile
from transport.log.records import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    HEAD_BYTES,
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    METADATA,
    REPAIRED,
    SCHEMA,
    ChunkHead,
    LogError,
    Record,
    Span,
    UnwritableError,
    entries_in,
    lock,
    message_index_of,
)

FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
"""Errors of a full disk."""
_MESSAGE_START = struct.Struct("<HIQ")  # channel, sequence, log time
_NUMBER = struct.Struct("<H")  # of a channel or schema
_ENTRY = struct.Struct("<QQ")  # log time, offset in the chunk


@dataclass(slots=True)
class _Kept:
    """Complete records that belong together, and their data for the index.

    For a chunk, `parts` are the chunk and its message indices, as spans of the truncated file or,
    if they are incomplete, as bytes. `channels` are in the order of the indices.
    """

    opcode: int
    parts: list[Span | bytes]
    head: ChunkHead | None = None
    channels: list[int] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    described: bytes = b""


def repair_if_truncated(log: Path) -> bool:
    """Repair a log if it exists and is truncated; returns whether it was repaired."""
    with suppress(LogError):  # the writer was killed before the first record
        return log.exists() and repair(log)
    return False


def repair(path: Path, *, make_room: bool = False, also_damaged: bool = False) -> bool:
    """Complete a truncated log with every readable record; returns whether it was changed.

    With `also_damaged`, a complete log is written again without its unreadable records.

    The metadata `repaired` contains the number of kept messages. To `make_room` for the index on a
    full disk, the last messages are removed. Raises LogError if the file is not an MCAP log, is
    being written or cannot be changed; its complete records stay.
    """
    try:
        with path.open("r+b", buffering=0) as file:
            lock(file, path)
            log = McapFile(path)
            if not (log.truncated or (also_damaged and log.damage)):
                return False
            kept = _kept(log)
            kept[2:2] = _lost_descriptions(log, kept)
            if _is_beginning(kept):
                _complete(file, kept, make_room=make_room)
            else:
                _write_beside(path, log, kept)
            log.bytes.close()
    except OSError as error:
        raise UnwritableError(f"{path}: cannot repair the log: {error.strerror}") from error
    return True


def _kept(log: McapFile) -> list[_Kept]:
    """Readable records of a log, in order."""
    heads = {record.start: head for record, head in log.chunks}
    kept: list[_Kept] = [_Kept(0, [Span(0, len(MAGIC))])]
    valid = list(log.layout.records)
    if not valid or valid[0].opcode != HEADER:
        builder = RecordBuilder()
        records.Header("", "").write(builder)
        kept.append(_Kept(HEADER, [builder.end()]))  # type: ignore[no-untyped-call]
    known: set[int] = set()
    for position, record in enumerate(valid):
        if record.opcode == CHUNK and record.start in heads:
            kept.append(_kept_chunk(log, heads[record.start], valid, position, known))
        elif record.opcode in {HEADER, ATTACHMENT, METADATA}:
            content = log.bytes[record.content]
            kept.append(_Kept(record.opcode, [Span(record.start, record.end)], described=content))
    return kept


def _kept_chunk(
    log: McapFile, head: ChunkHead, valid: Sequence[Record], position: int, known: set[int]
) -> _Kept:
    """Keep the chunk at `position` of `valid`; `known` are the channels described before.

    Its messages are read one by one only if an index may be missing, because no record follows
    directly, or if a channel is new.
    """
    record, *indices = group = _contiguous(valid, position)
    counts = Counter(dict(message_index_of(log.bytes, index) for index in indices))
    distinct = len(counts) == len(indices)  # otherwise a channel number is damaged
    after = valid[position + len(group) : position + len(group) + 1]
    followed = bool(after) and after[0].start == group[-1].end
    if distinct and followed and counts and known.issuperset(counts):
        spans = [Span(part.start, part.end) for part in (record, *indices)]
        return _Kept(CHUNK, [*spans], head, list(counts), counts)
    chunk = log.unpack(head)
    described = []
    entries: dict[int, bytearray] = defaultdict(bytearray)
    for opcode, start, end in entries_in(chunk):
        if opcode == MESSAGE:
            channel, _, log_time = _MESSAGE_START.unpack_from(chunk, start)
            entries[channel] += _ENTRY.pack(log_time, start - HEAD_BYTES)
        elif opcode in {SCHEMA, CHANNEL}:
            described.append(chunk[start - HEAD_BYTES : end])
    counted = Counter({channel: len(rows) // _ENTRY.size for channel, rows in entries.items()})
    known.update(counted)
    parts: list[Span | bytes] = [Span(record.start, record.end)]
    if distinct and counted == counts:
        parts += [Span(index.start, index.end) for index in indices]
    else:
        parts += [_index(channel, bytes(rows)) for channel, rows in entries.items()]
    channels = list(counts if distinct and counted == counts else counted)
    return _Kept(CHUNK, parts, head, channels, counted, b"".join(described))


def _lost_descriptions(log: McapFile, kept: Sequence[_Kept]) -> list[_Kept]:
    """A chunk with the channels and schemas that only the summary of the log still describes."""
    channels, schemas = log.described(), log.schemas()
    used = channels.keys() & {channel for group in kept for channel in group.counts}
    known = _described_in(kept)
    lost = sorted(number for number in used if (CHANNEL, number) not in known)
    needed = {channels[number].schema_id for number in used}
    lost_schemas = sorted(number for number in needed if (SCHEMA, number) not in known)
    chunks = [group.head for group in kept if group.head is not None]
    if not (lost or lost_schemas) or not chunks:
        return []
    builder = RecordBuilder()
    for number in lost_schemas:
        schemas[number].write(builder)
    for number in lost:
        channels[number].write(builder)
    content: bytes = builder.end()  # type: ignore[no-untyped-call]
    first_at = chunks[0].first_at
    chunk = records.Chunk("", content, first_at, first_at, crc32(content), len(content))
    chunk.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    packed = Span(0, len(content))
    head = ChunkHead(first_at, first_at, len(content), crc32(content), "", packed)
    return [_Kept(CHUNK, [data], head, described=content)]


def _described_in(kept: Sequence[_Kept]) -> set[tuple[int, int]]:
    """Opcodes and numbers of the channels and schemas that the kept chunks describe."""
    return {
        (opcode, *_NUMBER.unpack_from(group.described, start))
        for group in kept
        if group.head is not None
        for opcode, start, _ in entries_in(group.described)
    }


def _contiguous(valid: Sequence[Record], position: int) -> list[Record]:
    """The chunk at `position` and the indices directly after it."""
    group = [valid[position]]
    for record in valid[position + 1 :]:
        if record.opcode != MESSAGE_INDEX or record.start != group[-1].end:
            break
        group.append(record)
    return group


def _index(channel: int, rows: bytes) -> bytes:
    return struct.pack("<BQHI", MESSAGE_INDEX, 6 + len(rows), channel, len(rows)) + rows


def _is_beginning(kept: Sequence[_Kept]) -> bool:
    """Whether the kept spans are the beginning of the file, followed by bytes only."""
    at, has_bytes = 0, False
    for part in (part for group in kept for part in group.parts):
        if isinstance(part, bytes):
            has_bytes = True
        elif has_bytes or part.start != at:
            return False
        else:
            at = part.end
    return True


def _write_all(file: RawIOBase, data: bytes) -> None:
    left = memoryview(data)
    while left:
        left = left[file.write(left) or 0 :]


def _complete(file: RawIOBase, kept: list[_Kept], *, make_room: bool) -> None:
    """Write the end after the last complete record of the truncated file."""
    while True:
        parts = [part for group in kept for part in group.parts]
        size = max(part.end for part in parts if isinstance(part, Span))
        file.truncate(size)
        file.seek(size)
        try:
            added = b"".join(part for part in parts if isinstance(part, bytes))
            _write_all(file, added + _end(kept))
            os.fsync(file.fileno())
        except OSError as error:
            if not make_room or error.errno not in FULL or len(kept) <= 2:
                file.truncate(size)
                raise
            kept.pop()
        else:
            return


def _write_beside(path: Path, log: McapFile, kept: Sequence[_Kept]) -> None:
    beside = path.with_name(path.name + ".repaired")
    try:
        with beside.open("wb") as file:
            for part in (part for group in kept for part in group.parts):
                file.write(log.bytes[part.start : part.end] if isinstance(part, Span) else part)
            file.write(_end(kept))
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


class _Summary:
    """End of a file: index, statistics and footer (MCAP specification, section Summary)."""

    def __init__(self) -> None:
        self.schemas: dict[int, records.Schema] = {}
        self.channels: dict[int, records.Channel] = {}
        self.chunks: list[records.ChunkIndex] = []
        self.attachments: list[records.AttachmentIndex] = []
        self.metadata: list[records.MetadataIndex] = []
        self.counts: Counter[int] = Counter()

    def add(self, group: _Kept, at: int) -> int:
        """Add the records at byte `at` of the file; returns their end."""
        lengths = [len(p) if isinstance(p, bytes) else p.end - p.start for p in group.parts]
        content = ReadDataStream(BytesIO(group.described))
        if group.head is not None:
            self._add_chunk(group, group.head, at, lengths)
        elif group.opcode == ATTACHMENT:
            file = records.Attachment.read(content)
            self.attachments.append(
                records.AttachmentIndex(
                    offset=at,
                    length=lengths[0],
                    create_time=file.create_time,
                    log_time=file.log_time,
                    data_size=len(file.data),
                    name=file.name,
                    media_type=file.media_type,
                )
            )
        elif group.opcode == METADATA:
            name = records.Metadata.read(content).name
            self.metadata.append(records.MetadataIndex(offset=at, length=lengths[0], name=name))
        return at + sum(lengths)

    def _add_chunk(self, group: _Kept, head: ChunkHead, at: int, lengths: Sequence[int]) -> None:
        offsets: dict[int, int] = {}
        offset = at + lengths[0]
        for channel, length in zip(group.channels, lengths[1:], strict=True):
            offsets[channel] = offset
            offset += length
        self.chunks.append(
            records.ChunkIndex(
                chunk_start_offset=at,
                chunk_length=lengths[0],
                message_start_time=head.first_at,
                message_end_time=head.last_at,
                message_index_offsets=offsets,
                message_index_length=sum(lengths[1:]),
                compression=head.compression,
                compressed_size=head.packed.end - head.packed.start,
                uncompressed_size=head.size,
            )
        )
        self.counts += group.counts
        for opcode, start, end in entries_in(group.described):
            content = ReadDataStream(BytesIO(group.described[start:end]))
            if opcode == SCHEMA:
                schema = records.Schema.read(content)
                self.schemas[schema.id] = schema
            else:
                channel_record = records.Channel.read(content)
                self.channels[channel_record.id] = channel_record

    def statistics(self) -> records.Statistics:
        filled = [index for index in self.chunks if index.message_index_offsets]
        return records.Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=self.counts,
            chunk_count=len(self.chunks),
            message_count=self.counts.total(),
            metadata_count=len(self.metadata),
            message_start_time=min((index.message_start_time for index in filled), default=0),
            message_end_time=max((index.message_end_time for index in filled), default=0),
            schema_count=len(self.schemas),
        )

    def pack(self, at: int) -> bytes:
        """Bytes of the summary section at byte `at`, and of the footer."""
        builder = RecordBuilder()
        offsets: list[records.SummaryOffset] = []
        groups: tuple[tuple[Opcode, Sequence[records.McapRecord]], ...] = (
            (Opcode.SCHEMA, list(self.schemas.values())),
            (Opcode.CHANNEL, list(self.channels.values())),
            (Opcode.STATISTICS, [self.statistics()]),
            (Opcode.CHUNK_INDEX, self.chunks),
            (Opcode.ATTACHMENT_INDEX, self.attachments),
            (Opcode.METADATA_INDEX, self.metadata),
        )
        for opcode, group in groups:
            start = builder.count
            for record in group:
                record.write(builder)
            offsets.append(records.SummaryOffset(opcode, builder.count - start, at + start))
        offsets_at = at + builder.count
        for offset in offsets:
            offset.write(builder)
        summary: bytes = builder.end()  # type: ignore[no-untyped-call]
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, at, offsets_at)
        return summary + footer + struct.pack("<I", crc32(summary + footer)) + MAGIC


def _end(kept: Sequence[_Kept]) -> bytes:
    """Bytes of the end of a file with these records."""
    summary, at = _Summary(), 0
    for group in kept:
        at = summary.add(group, at)
    builder = RecordBuilder()
    records.Metadata(REPAIRED, {"messages": str(summary.counts.total())}).write(builder)
    note: bytes = builder.end()  # type: ignore[no-untyped-call]
    at = summary.add(_Kept(METADATA, [note], described=note[HEAD_BYTES:]), at)
    records.DataEnd(0).write(builder)
    note += builder.end()  # type: ignore[no-untyped-call]
    at += len(note) - summary.metadata[-1].length
    return note + summary.pack(at)
