"""Readable records of the MCAP file of a log."""

import struct
import zlib
from collections import Counter
from collections.abc import Container, Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import IO, cast

import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.stream_reader import get_chunk_data_stream
from mcap.summary import Summary

from transport.columns import Integers
from transport.log.records import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    HEAD_BYTES,
    MESSAGE,
    METADATA,
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
)
from transport.log.wire import WireData

CHANNELS = 2**16
"""Number of possible channel numbers in MCAP."""
SECOND = 1_000_000_000
LARGEST_CHUNK = 2**30
"""Maximum size of an unpacked chunk (bytes); a larger stated size is damage."""
MAX_LISTED = 3
"""Maximum number of damaged places that are listed."""


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
        for record in self.layout.records:
            if record.opcode == CHUNK:
                head = chunk_head(self.bytes, record)
                if self._is_sound(head):
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
        topics: dict[int, str] = {}
        if summary := self._summary():
            topics = {number: channel.topic for number, channel in summary.channels.items()}
            if summary.statistics and not self._damaged:
                return topics, summary.statistics.channel_message_counts
        for _, head in self.chunks:
            chunk = self.unpack(head)
            for opcode, start, end in entries_in(chunk):
                if opcode == CHANNEL:
                    channel = records.Channel.read(ReadDataStream(BytesIO(chunk[start:end])))
                    topics[channel.id] = channel.topic
        return topics, Counter(channel for channel, _, _ in self.messages())

    def totals(self, numbered: Container[int]) -> dict[int, int]:
        """Messages of each channel, by the statistics of the file.

        Those of `numbered` channels are counted by their largest sequence number as well.
        """
        summary, totals = self._summary(), Counter[int]()
        if summary and summary.statistics:
            totals.update(summary.statistics.channel_message_counts)
        largest = np.full(CHANNELS, -1, np.int64)
        for number, (_, head) in enumerate(self.chunks):
            chunk = WireData(self.unpack(head))
            heads = self.record_starts(number, chunk.content(0, head.size))
            heads = heads[chunk.numbers("u1", heads) == MESSAGE] + HEAD_BYTES
            channels, sequences = chunk.numbers("<u2", heads), chunk.numbers("<u4", heads + 2)
            np.maximum.at(largest, channels, sequences)
        for channel in np.flatnonzero(largest >= 0).tolist():
            if channel in numbered:
                totals[channel] = max(totals[channel], int(largest[channel]) + 1)
        return totals

    def record_starts(self, number: int, chunk: bytes) -> Integers:
        """Places of the records in chunk `number`, whose unpacked content is `chunk`."""
        starts = self._starts.get(number)
        if starts is None:
            starts = self._starts[number] = np.array(starts_in(chunk), np.int64)
        return starts

    def _summary(self) -> Summary | None:
        if not self.layout.summary.end:
            return None
        return SeekingReader(cast("IO[bytes]", self.bytes)).get_summary()


def _joined(spans: list[Span]) -> list[Span]:
    """Sort spans and join adjacent ones."""
    joined: list[Span] = []
    for span in sorted(spans):
        if joined and span.start <= joined[-1].end:
            joined[-1] = Span(joined[-1].start, max(span.end, joined[-1].end))
        else:
            joined.append(span)
    return joined
