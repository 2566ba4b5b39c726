"""The messages of a chunk of an MCAP log, packed as they will be written, and the index of each."""

import struct
from collections.abc import Callable, Iterable

CHUNK_BYTES = 1024 * 1024
"""A chunk is complete once it holds more bytes than this, as in the mcap package."""
_MESSAGE = 0x05
"""Opcode of a message."""
_HEAD = struct.Struct("<BQHIQQ")
"""Opcode and length of a record; channel, number, log time and publish time of a message."""
RECORD_BYTES = 9
"""Opcode and length of a record, which its length does not count."""
_FIXED = _HEAD.size - RECORD_BYTES
"""Bytes of a message record without its opcode, its length and its data."""

PlainMessage = tuple[int, int, bytes, int, int]
"""Channel, log time, data, publish time and number of a message (instants in ns)."""


class PackedMessages:
    """Records of messages in the order in which they came, in order of log time.

    `parts` are their bytes, and `size` is the place in the chunk at which the next one begins. By
    channel, `indices` has log time and place of each message, in turn.
    """

    def __init__(self, on_full: Callable[[], object]) -> None:
        """`on_full` ends the chunk, which holds enough."""
        self._on_full = on_full
        self.parts: list[bytes] = []
        self.indices: dict[int, list[int]] = {}
        self.count = 0
        self.size = 0

    def add(self, messages: Iterable[PlainMessage]) -> None:
        """Add messages."""
        parts, indices, size = self.parts, self.indices, self.size
        for channel_id, log_time, data, publish_time, sequence in messages:
            index = indices.get(channel_id)
            if index is None:
                index = indices[channel_id] = []
            index += (log_time, size)
            length = _FIXED + len(data)
            head = _HEAD.pack(_MESSAGE, length, channel_id, sequence, log_time, publish_time)
            parts += (head, data)
            self.count += 1
            size += RECORD_BYTES + length
            if size > CHUNK_BYTES:
                self.size = size
                self._on_full()
                size = self.size
        self.size = size

    def taken(self) -> bytes:
        """Give away the bytes so far; the index goes on."""
        taken = b"".join(self.parts)
        self.parts.clear()
        return taken

    def clear(self) -> None:
        """Begin the next chunk."""
        self.parts.clear()
        self.indices.clear()
        self.count = self.size = 0
