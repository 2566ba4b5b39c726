"""The mcap package's writer with a shorter way for messages, of which a run has very many.

The package packs a message field by field and counts it in five places, which took a fifth of a run
in virtual time. Here a message's record is packed in one go and the counting is left to the end of
its chunk; everything else, and the layout of the file, is the package's own.
"""

import struct
from io import BytesIO
from typing import IO, Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, MessageIndex, Schema, Statistics
from mcap.writer import Writer

try:
    from mcap._chunk_builder import ChunkBuilder
except ImportError:  # another version of the package, see `new_writer`
    ChunkBuilder = object  # type: ignore[assignment, misc]

__all__ = ["Writer", "new_writer"]

CHUNK_BYTES = 1024 * 1024
"""A chunk is complete once it holds more than these, as in the package."""
_HEAD = struct.Struct("<BQHIQQ")
"""Opcode and length of a record; channel, number, log time and publish time of a message."""
_FIXED = _HEAD.size - 9
"""Bytes of a message record without its opcode, its length and its data."""


class _Index(MessageIndex):
    """The messages of one channel in a chunk: log time and place of each, one after the other."""

    def __init__(self, channel_id: int) -> None:
        super().__init__(channel_id, [])
        self.flat: list[int] = []

    def write(self, stream: RecordBuilder) -> None:
        """Write the record of the index."""
        stream.start_record(Opcode.MESSAGE_INDEX)
        stream.write2(self.channel_id)
        stream.write4(8 * len(self.flat))
        stream.write(struct.pack(f"<{len(self.flat)}Q", *self.flat))
        stream.finish_record()  # type: ignore[no-untyped-call]


class _Chunk(ChunkBuilder):
    """A chunk in progress: packed messages, and before them the channels and schemas they need."""

    def __init__(self, statistics: Statistics) -> None:
        super().__init__()
        self._statistics = statistics
        self.indices: dict[int, _Index] = self.message_indices  # type: ignore[assignment]
        self.parts: list[bytes] = []
        self.size = 0

    @property
    def count(self) -> int:
        """Bytes so far."""
        return self.size

    def index(self, channel: int) -> _Index:
        """Begin to index a channel."""
        index = self.indices[channel] = _Index(channel)
        return index

    def add_channel(self, channel: Channel) -> None:
        """Put a channel after what is here."""
        self._pack()
        super().add_channel(channel)
        self.size = self.record_writer.count

    def add_schema(self, schema: Schema) -> None:
        """Put a schema after what is here."""
        self._pack()
        super().add_schema(schema)
        self.size = self.record_writer.count

    def end(self) -> bytes:
        """Give the chunk's bytes, and count what it holds."""
        self._pack()
        flats = {channel: index.flat for channel, index in self.indices.items()}
        self.message_start_time = min(flat[0] for flat in flats.values())
        self.message_end_time = max(flat[-2] for flat in flats.values())
        statistics = self._statistics
        if not statistics.message_count:
            statistics.message_start_time = self.message_start_time
        statistics.message_end_time = self.message_end_time
        statistics.message_count += self.num_messages
        for channel, flat in flats.items():
            statistics.channel_message_counts[channel] += len(flat) // 2
        self.size = 0
        data: bytes = super().end()  # type: ignore[no-untyped-call]
        return data

    def _pack(self) -> None:
        self.record_writer.write(b"".join(self.parts))
        self.parts.clear()


class _ShortWriter(Writer):
    """Writes messages, which have to come in order of log time, the short way."""

    def __init__(self, file: IO[bytes]) -> None:
        super().__init__(file)
        inside: Any = self
        self._chunk = inside._Writer__chunk_builder = _Chunk(inside._Writer__statistics)

    def add_message(
        self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0
    ) -> None:
        """Add a message (instants in ns)."""
        chunk = self._chunk
        flat = (chunk.indices.get(channel_id) or chunk.index(channel_id)).flat
        flat.append(log_time)
        flat.append(chunk.size)
        length = _FIXED + len(data)
        parts = chunk.parts
        parts.append(
            _HEAD.pack(Opcode.MESSAGE, length, channel_id, sequence, log_time, publish_time)
        )
        parts.append(data)
        chunk.num_messages += 1
        chunk.size += 9 + length
        if chunk.size > CHUNK_BYTES:
            self.flush()  # type: ignore[no-untyped-call]


def new_writer(file: IO[bytes]) -> Writer:
    """Open a writer of messages in order of time."""
    # The package has no door for this. Should it rename what is used here, its own way still works.
    if {"_Writer__chunk_builder", "_Writer__statistics"} <= vars(Writer(BytesIO())).keys():
        return _ShortWriter(file)
    return Writer(file)
