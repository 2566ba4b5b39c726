"""The mcap package's writer with a faster way to add messages, of which a run has very many.

The package packs a message field by field and counts it in five places, which took a fifth of a run
in virtual time. Here a message's record is packed in one call and the counting is done at the end
of its chunk; everything else is done by the package, and the file is the same to the byte.

The index of each chunk, with a place in the file for every channel, is kept packed until the end:
as the package keeps it, it takes ten times the memory, a megabyte a minute on the wall clock.

The package offers no public interface for this, so three of its private attributes are used.
Where it does not have them (another version), its own writer is used, and the log of a run says so.
"""

import struct
from io import BytesIO
from typing import IO, Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, MessageIndex, Schema, Statistics
from mcap.writer import Writer

try:
    from mcap._chunk_builder import ChunkBuilder
except ImportError:  # another version of the package, see `can_be_fast`
    ChunkBuilder = object  # type: ignore[assignment, misc]

__all__ = ["FastWriter", "Writer", "new_writer"]

CHUNK_BYTES = 1024 * 1024
"""A chunk is complete once it holds more bytes than this, as in the package."""
_MESSAGE = int(Opcode.MESSAGE)
_HEAD = struct.Struct("<BQHIQQ")
"""Opcode and length of a record; channel, number, log time and publish time of a message."""
_FIXED = _HEAD.size - 9
"""Bytes of a message record without its opcode, its length and its data."""
_CHUNK_ATTRIBUTES = {
    "message_end_time",
    "message_indices",
    "message_start_time",
    "num_messages",
    "record_writer",
}
"""What `_Chunk` uses of the package's chunk builder."""


class _Index(MessageIndex):
    """The messages of one channel in a chunk: log time and offset of each, in turn."""

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
    """A chunk in progress: channels, schemas and packed messages, in the order of the calls."""

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
        """Begin the index of a channel."""
        index = self.indices[channel] = _Index(channel)
        return index

    def add_channel(self, channel: Channel) -> None:
        """Append a channel."""
        self._pack()
        super().add_channel(channel)
        self.size = self.record_writer.count

    def add_schema(self, schema: Schema) -> None:
        """Append a schema."""
        self._pack()
        super().add_schema(schema)
        self.size = self.record_writer.count

    def end(self) -> bytes:
        """Return the chunk's bytes, and add its messages to the statistics."""
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


class _PackedIndex:
    """The index of one chunk, as it will be written."""

    __slots__ = ("_record",)

    def __init__(self, index: ChunkIndex) -> None:
        builder = RecordBuilder()
        index.write(builder)
        self._record: bytes = builder.end()  # type: ignore[no-untyped-call]

    def write(self, stream: RecordBuilder) -> None:
        """Write the record of the index."""
        stream.write(self._record)


class FastWriter(Writer):
    """Writes messages, which have to come in order of log time, in the faster way."""

    def __init__(self, file: IO[bytes]) -> None:
        super().__init__(file)
        private: Any = self
        self._chunk = private._Writer__chunk_builder = _Chunk(private._Writer__statistics)
        self._indices: list[ChunkIndex | _PackedIndex] = private._Writer__chunk_indices

    def flush(self) -> None:
        """Finish the chunk in progress and hand all to the operating system."""
        super().flush()  # type: ignore[no-untyped-call]
        if self._indices and isinstance(last := self._indices[-1], ChunkIndex):
            self._indices[-1] = _PackedIndex(last)

    def add_message(
        self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0
    ) -> None:
        """Add a message (instants in ns)."""
        chunk = self._chunk
        index = chunk.indices.get(channel_id)
        if index is None:
            index = chunk.index(channel_id)
        size, length = chunk.size, _FIXED + len(data)
        index.flat += (log_time, size)
        chunk.parts += (
            _HEAD.pack(_MESSAGE, length, channel_id, sequence, log_time, publish_time),
            data,
        )
        chunk.num_messages += 1
        chunk.size = size = size + 9 + length
        if size > CHUNK_BYTES:
            self.flush()


def can_be_fast() -> bool:
    """Whether the installed package has the private attributes that `FastWriter` needs."""
    writer = vars(Writer(BytesIO()))
    chunk = writer.get("_Writer__chunk_builder")
    return (
        ChunkBuilder is not object
        and isinstance(chunk, ChunkBuilder)
        and vars(chunk).keys() >= _CHUNK_ATTRIBUTES
        and {"_Writer__statistics", "_Writer__chunk_indices"} <= writer.keys()
    )


def new_writer(file: IO[bytes]) -> Writer:
    """Open a writer of messages in order of log time: a `FastWriter` if there can be one."""
    return FastWriter(file) if can_be_fast() else Writer(file)
