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

from transport.log.packed_messages import RECORD_BYTES, PackedMessages

try:
    from mcap._chunk_builder import ChunkBuilder
except ImportError:  # another version of the package, see `can_be_fast`
    ChunkBuilder = object  # type: ignore[assignment, misc]

__all__ = ["FastWriter", "Writer", "new_writer"]

_INDEX_HEAD = struct.Struct("<BQHI")
"""Opcode and length of an index record, its channel, and the length of what follows."""
_CHUNK_ATTRIBUTES = {
    "message_end_time",
    "message_indices",
    "message_start_time",
    "num_messages",
    "record_writer",
}
"""What `_Chunk` uses of the package's chunk builder."""


class _Index(MessageIndex):
    """The messages of one channel in a chunk: log time and place of each, in turn."""

    def __init__(self, channel_id: int, flat: list[int]) -> None:
        super().__init__(channel_id, [])
        self.flat = flat

    def write(self, stream: RecordBuilder) -> None:
        """Write the record of the index: on the wall clock each channel has five a second."""
        entries = struct.pack(f"<{len(self.flat)}Q", *self.flat)
        length = _INDEX_HEAD.size - RECORD_BYTES + len(entries)
        head = _INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, length, self.channel_id, len(entries))
        stream.write(head + entries)


class _Chunk(ChunkBuilder):
    """A chunk in progress: channels, schemas and packed messages, in the order of the calls."""

    def __init__(self, statistics: Statistics, messages: PackedMessages) -> None:
        super().__init__()
        self._statistics = statistics
        self._messages = messages

    @property
    def count(self) -> int:
        """Bytes so far."""
        return self._messages.size

    def add_channel(self, channel: Channel) -> None:
        """Append a channel."""
        self._pack()
        super().add_channel(channel)
        self._messages.size = self.record_writer.count

    def add_schema(self, schema: Schema) -> None:
        """Append a schema."""
        self._pack()
        super().add_schema(schema)
        self._messages.size = self.record_writer.count

    def count_messages(self) -> None:
        """Say how many there are: the package leaves out a chunk without any."""
        self.num_messages = self._messages.count

    def end(self) -> bytes:
        """Return the chunk's bytes, and add its messages to the statistics."""
        self._pack()
        flats = self._messages.indices
        self.message_indices |= {channel: _Index(channel, flat) for channel, flat in flats.items()}
        self.message_start_time = min(flat[0] for flat in flats.values())
        self.message_end_time = max(flat[-2] for flat in flats.values())
        statistics = self._statistics
        if not statistics.message_count:
            statistics.message_start_time = self.message_start_time
        statistics.message_end_time = self.message_end_time
        statistics.message_count += self.num_messages
        for channel, flat in flats.items():
            statistics.channel_message_counts[channel] += len(flat) // 2
        data: bytes = super().end()  # type: ignore[no-untyped-call]
        return data

    def reset(self) -> None:
        """Begin the next chunk."""
        super().reset()  # type: ignore[no-untyped-call]
        self._messages.clear()

    def _pack(self) -> None:
        self.record_writer.write(self._messages.taken())


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
    """Writes messages, which have to come in order of log time, in the faster way.

    `messages` are those of the chunk in progress.
    """

    def __init__(self, file: IO[bytes]) -> None:
        super().__init__(file)
        private: Any = self
        self.messages = PackedMessages(self.flush)
        self._chunk = _Chunk(private._Writer__statistics, self.messages)
        private._Writer__chunk_builder = self._chunk
        self._indices: list[ChunkIndex | _PackedIndex] = private._Writer__chunk_indices

    def flush(self) -> None:
        """Finish the chunk in progress and hand all to the operating system."""
        self._chunk.count_messages()
        super().flush()  # type: ignore[no-untyped-call]
        if self._indices and isinstance(last := self._indices[-1], ChunkIndex):
            self._indices[-1] = _PackedIndex(last)

    def finish(self) -> None:
        """Complete the file."""
        self._chunk.count_messages()
        super().finish()  # type: ignore[no-untyped-call]

    def add_message(
        self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0
    ) -> None:
        """Add a message (instants in ns)."""
        self.messages.add(((channel_id, log_time, data, publish_time, sequence),))


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
