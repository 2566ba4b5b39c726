"""Readable records of the MCAP file of a log."""

import struct
import zlib
from collections import Counter
from collections.abc import Container, Iterator, Mapping, Set
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.stream_reader import get_chunk_data_stream

from transport.columns import Integers
from transport.log.records import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    EXTENTS,
    HEAD_BYTES,
    MESSAGE,
    MESSAGE_HEAD_BYTES,
    METADATA,
    SCHEMA,
    STATISTICS,
    ChannelExtent,
    ChunkHead,
    DamageError,
    Record,
    Span,
    attachment,
    chunk_head,
    entries_in,
    map_log,
    messages_in,
    metadata,
    scan,
    starts_in,
    stored_in,
)
from transport.log.wire import WireData

CHANNELS = 2**16
"""Number of possible channel numbers in MCAP."""
SECOND = 1_000_000_000
LARGEST_CHUNK = 2**30
"""Maximum size of an unpacked chunk (bytes); a larger stated size is damage."""
MAX_LISTED = 3
"""Maximum number of damaged places that are listed."""


class MessageHeads(NamedTuple):
    """Channel, sequence number, instant of recording (ns) and size (bytes) of N messages."""

    channel: Integers
    sequence: Integers
    logged_at: Integers
    size: Integers


@dataclass(slots=True)
class _SummarySection:
    """Records of the summary section, none if the file has none."""

    schemas: dict[int, records.Schema] = field(default_factory=dict)
    channels: dict[int, records.Channel] = field(default_factory=dict)
    statistics: records.Statistics | None = None


class McapFile:
    """The records of an MCAP file, which may be truncated or damaged.

    `damage` describes unreadable bytes in one line; empty if there are none.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.bytes = map_log(path)
        self.layout = scan(self.bytes)
        self.truncated = self.layout.truncated
        self.chunks: list[tuple[Record, ChunkHead]] = []
        damaged = list(self.layout.gaps)
        is_intact = self.layout.intact
        for record in self.layout.records:
            if record.opcode == CHUNK:
                head = chunk_head(self.bytes, record)
                if is_intact or self._is_sound(head):
                    self.chunks.append((record, head))
                else:
                    damaged.append(Span(record.start, record.end))
        self._damaged = _joined(damaged)
        self._starts: dict[int, Integers] = {}
        self.damage = self._describe_damage() if self._damaged else ""

    def unpack(self, head: ChunkHead) -> bytes:
        """Records of a chunk; raises DamageError."""
        packed = self.bytes[head.packed.start : head.packed.end]
        if head.size > LARGEST_CHUNK:
            raise DamageError(f"a chunk of {head.size} bytes")
        try:
            if head.compression == "zstd":
                if zstandard.frame_content_size(packed) not in {-1, head.size}:
                    raise DamageError("the size of a chunk is wrong")
                data: bytes = zstandard.decompress(packed, head.size)
            else:
                chunk = records.Chunk(head.compression, packed, 0, 0, 0, head.size)
                stream, length = get_chunk_data_stream(chunk)
                data = stream.read(length)
        except (McapError, zstandard.ZstdError, RuntimeError, MemoryError) as error:
            raise DamageError(str(error)) from error
        if len(data) != head.size:
            raise DamageError("the size of a chunk is wrong")
        return data

    def _is_sound(self, head: ChunkHead) -> bool:
        try:
            data = self.unpack(head)
            if head.crc:
                return zlib.crc32(data) == head.crc
            return all(True for _ in messages_in(data))
        except (DamageError, struct.error):
            return False

    def _describe_damage(self) -> str:
        lost = sum(span.end - span.start for span in self._damaged)
        named = [self._place(span) for span in self._damaged[:MAX_LISTED]]
        if len(self._damaged) > MAX_LISTED:
            named.append(f"and {len(self._damaged) - MAX_LISTED} more")
        return f"{self.path}: damaged, {lost} bytes cannot be read: {'; '.join(named)}"

    def _place(self, span: Span) -> str:
        """Describe a damaged span by its bytes and by the time between the nearest messages."""
        before = [head.last_at for record, head in self.chunks if record.end <= span.start]
        after = [head.first_at for record, head in self.chunks if record.start >= span.end]
        text = f"{span.end - span.start} at byte {span.start}"
        if not self.chunks:
            return text
        origin = self.chunks[0][1].first_at
        begin = f"{(before[-1] - origin) / SECOND:.1f} s" if before else "the beginning"
        end = f"{(after[0] - origin) / SECOND:.1f} s" if after else "the end"
        return f"{text}, between {begin} and {end}"

    def messages(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield (channel, log time, data) of all readable messages."""
        for _, head in self.chunks:
            yield from messages_in(self.unpack(head))

    def metadata(self) -> dict[str, dict[str, str]]:
        return dict(metadata(self.bytes, record) for record in self._of_kind(METADATA))

    def attachments(self) -> dict[str, bytes]:
        return dict(attachment(self.bytes, record) for record in self._of_kind(ATTACHMENT))

    def _of_kind(self, opcode: int) -> Iterator[Record]:
        return (record for record in self.layout.records if record.opcode == opcode)

    def channels(self) -> tuple[dict[int, str], Mapping[int, int]]:
        """Topics and message counts of the channels, by channel number."""
        topics = {number: channel.topic for number, channel in self.described().items()}
        summary = self._summary
        if summary.statistics and not self._damaged:
            return topics, summary.statistics.channel_message_counts
        return topics, Counter(self.heads.channel.tolist())

    def described(self) -> dict[int, records.Channel]:
        """Channels by number."""
        return self._descriptions[1]

    def schemas(self) -> dict[int, records.Schema]:
        """Schemas by number."""
        return self._descriptions[0]

    @cached_property
    def _descriptions(self) -> tuple[dict[int, records.Schema], dict[int, records.Channel]]:
        schemas, channels = dict(self._summary.schemas), dict(self._summary.channels)
        if self._summary.statistics and not self._damaged:
            return schemas, channels
        for _, head in self.chunks:
            chunk = self.unpack(head)
            for opcode, start, end in entries_in(chunk):
                content = ReadDataStream(BytesIO(chunk[start:end]))
                if opcode == CHANNEL:
                    channel = records.Channel.read(content)
                    channels[channel.id] = channel
                elif opcode == SCHEMA:
                    schema = records.Schema.read(content)
                    schemas[schema.id] = schema
        return schemas, channels

    def stored(self, head: ChunkHead) -> Iterator[tuple[int, int, int, int, bytes]]:
        """Yield (channel, sequence number, log time, publish time, data) of a chunk."""
        return stored_in(self.unpack(head))

    @cached_property
    def heads(self) -> MessageHeads:
        """Heads of all readable messages."""
        columns = []
        for number, (_, head) in enumerate(self.chunks):
            content = self.unpack(head)
            chunk, starts = WireData(content), self.record_starts(number, content)
            starts = starts[chunk.numbers("u1", starts) == MESSAGE]
            at = starts + HEAD_BYTES
            columns.append(
                (
                    chunk.numbers("<u2", at).astype(np.int64),
                    chunk.numbers("<u4", at + 2).astype(np.int64),
                    chunk.numbers("<i8", at + 6),
                    chunk.numbers("<i8", starts + 1) - MESSAGE_HEAD_BYTES,
                )
            )
        if not columns:
            return MessageHeads(*(np.zeros(0, np.int64) for _ in MessageHeads._fields))
        return MessageHeads(*(np.concatenate(parts) for parts in zip(*columns, strict=True)))

    @cached_property
    def extents(self) -> Mapping[str, ChannelExtent]:
        """Extents of the channels of an intact file by name, as its writer stated them."""
        if not self.layout.intact:
            return {}
        stated = self.metadata().get(EXTENTS, {})
        return {name: ChannelExtent(*map(int, text.split())) for name, text in stated.items()}

    def totals(self, numbered: Container[int]) -> dict[int, int]:
        """Messages of each channel, by the statistics of the file.

        Those of `numbered` channels are counted by their sequence numbers as well.
        """
        totals = Counter[int]()
        if self._summary.statistics:
            totals.update(self._summary.statistics.channel_message_counts)
        for channel, largest in self._largest_numbers().items():
            if channel in numbered:
                totals[channel] = max(totals[channel], largest + 1)
        return totals

    def _largest_numbers(self) -> dict[int, int]:
        """Largest sequence number of the messages of each channel."""
        if extents := self.extents:
            return {
                number: extents[channel.topic].last
                for number, channel in self.described().items()
                if channel.topic in extents
            }
        largest = np.full(CHANNELS, -1, np.int64)
        np.maximum.at(largest, self.heads.channel, self.heads.sequence)
        return {channel: int(largest[channel]) for channel in np.flatnonzero(largest >= 0).tolist()}

    def may_hold(self, record: Record, channels: Set[int]) -> bool:
        """Whether a chunk may hold messages of some channels."""
        known = self.layout.chunk_channels.get(record.start)
        return known is None or not known.isdisjoint(channels)

    def record_starts(self, number: int, chunk: bytes) -> Integers:
        """Places of the records in chunk `number`, whose unpacked content is `chunk`."""
        starts = self._starts.get(number)
        if starts is None:
            starts = self._starts[number] = np.array(starts_in(chunk), np.int64)
        return starts

    @cached_property
    def _summary(self) -> _SummarySection:
        summary = _SummarySection()
        section = self.bytes[self.layout.summary.start : self.layout.summary.end]
        for opcode, start, end in entries_in(section):
            content = ReadDataStream(BytesIO(section[start:end]))
            if opcode == SCHEMA:
                schema = records.Schema.read(content)
                summary.schemas[schema.id] = schema
            elif opcode == CHANNEL:
                channel = records.Channel.read(content)
                summary.channels[channel.id] = channel
            elif opcode == STATISTICS:
                summary.statistics = records.Statistics.read(content)
        return summary


def _joined(spans: list[Span]) -> list[Span]:
    """Sort spans and join adjacent ones."""
    joined: list[Span] = []
    for span in sorted(spans):
        if joined and span.start <= joined[-1].end:
            joined[-1] = Span(joined[-1].start, max(span.end, joined[-1].end))
        else:
            joined.append(span)
    return joined
