"""Writes the log of a run, one MCAP file.

Our Protobuf messages are logged unchanged under `/convoy/<vehicle>/<topic>`, with the standard
Foxglove messages of `transport/log/foxglove.py`. The scenario, versions and summary are metadata
and attachments, so that the file alone suffices to review and measure the run.
"""

import contextlib
import errno
import os
import struct
from collections.abc import Iterator, Mapping
from dataclasses import fields
from importlib.metadata import version
from itertools import count
from pathlib import Path
from typing import NoReturn

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import Writer

from transport.closing import Closing
from transport.codec import PROTOBUF, encode
from transport.convoy_pb2 import Deviation
from transport.log.errors import LogError, UnwritableError
from transport.log.foxglove import (
    Scene,
    Schema,
    StandardMessage,
    protobuf_schema,
    standard_messages,
)
from transport.log.mcap_file import EXTENTS, MAGIC, THINNED_NAME, ChannelExtent, lock
from transport.topics import TOPIC_OF, TOPICS, Thinning, Topic, key
from vehicles.messages import Message
from vehicles.schedule import SECOND, Timer

SEQUENCE_MASK = 0xFFFF_FFFF
"""MCAP has sequence numbers of 32 bits; our message contains the full number."""
FOREVER = 2**63
"""After every instant (ns)."""
CHUNK_NS = SECOND
"""Maximum duration of a chunk; a flipped bit costs the whole chunk."""


TAIL_BYTES = 32
"""Number of last flushed bytes that are compared before the next ones are written."""
CHUNK = b"\x06"
"""Opcode of a chunk in MCAP."""


def library_name() -> str:
    """Name of the software, with the versions that determine the bytes of a log."""
    parts = ("convoy-emulator", "mcap", "protobuf", "tomli-w", "zstandard")
    return " ".join(f"{part} {version(part)}" for part in parts)


FUTURE_INSTANTS = {"stops_at_ns", "relayed_stops_at_ns"}
"""Fields with instants that a vehicle announces; they do not bound what was recorded."""


class _Channel:
    """Channels of one topic of one vehicle: our message and its standard messages."""

    __slots__ = (
        "_earliest",
        "_first",
        "_instants",
        "_last",
        "_latest",
        "identifier",
        "standard_messages",
    )

    def __init__(
        self,
        identifier: int,
        standard_messages: tuple[tuple[StandardMessage, int, Timer], ...],
        instants: tuple[str, ...] = (),
    ) -> None:
        """`instants` are the fields with instants."""
        self.identifier = identifier
        self.standard_messages = standard_messages
        self._instants = instants
        self._first, self._last = SEQUENCE_MASK, -1
        self._earliest, self._latest = FOREVER, -FOREVER

    def note(self, log_time: int, message: Message) -> None:
        """Take a recorded message for the extent; instants of 0 are unknown."""
        number = message.seq & SEQUENCE_MASK
        self._first, self._last = min(self._first, number), max(self._last, number)
        for name in self._instants:
            if at := getattr(message, name):
                self._earliest = min(self._earliest, at - log_time)
                self._latest = max(self._latest, at - log_time)

    @property
    def extent(self) -> ChannelExtent | None:
        """Extent of its messages, None if there are none."""
        if self._last < 0 or self._latest < self._earliest:
            return None
        return ChannelExtent(self._first, self._last, self._earliest, self._latest)


def _instants_of(message: type[Message]) -> tuple[str, ...]:
    names = [row.name for row in fields(message) if row.name.endswith("_at_ns")]
    return tuple(name for name in names if name not in FUTURE_INSTANTS)


def _cut_magic(descriptor: int) -> None:
    size = os.fstat(descriptor).st_size
    if size > 2 * len(MAGIC) and os.pread(descriptor, len(MAGIC), size - len(MAGIC)) == MAGIC:
        os.ftruncate(descriptor, size - len(MAGIC))


class LogWriter(Closing):
    """Writes the log of one run to `path`; the same calls give the same bytes.

    No clock is read. A kill loses messages written after the last `flush()`: call it at least twice
    a second on the wall clock; in virtual time `close()` is enough. A chunk contains at most one
    second or one mebibyte, which bounds the memory. Not thread-safe.

    If the file cannot be written (full disk, removed file), the first call raises LogError; the
    file is closed and later calls do nothing, so that a run can end. `repair` completes the file.
    """

    def __init__(
        self,
        path: Path,
        *,
        library: str | None = None,
        scene: Scene | None = None,
        rates_hz: Mapping[str, float] | None = None,
    ) -> None:
        """Create the file; raises LogError. `rates_hz` are maximum rates by topic."""
        self._path = path
        self.failure = ""
        """Why the file cannot be written."""
        try:
            self._file = path.open("x+b")
            lock(self._file, path)
        except FileExistsError as error:
            raise LogError(f"{path}: exists; a log is never overwritten") from error
        except OSError as error:
            raise UnwritableError(f"{path}: cannot write the log: {error.strerror}") from error
        self._writer = Writer(self._file, enable_data_crcs=True)
        try:
            with self._named_failure():
                self._writer.start(profile="", library=library or library_name())
                self._file.flush()  # a log without messages is recognised, too
        except LogError:
            path.unlink(missing_ok=True)
            raise
        self._written = 0
        self._flushed, self._tail = 0, b""
        self._twins = standard_messages(scene)
        self._deviations: dict[str, tuple[_Channel, Iterator[int]]] = {}
        self._channels: dict[tuple[str, str], _Channel] = {}
        self._schemas: dict[str, int] = {}
        self._log_time = 0
        self._chunk_ends_at = 0
        self._thinning = Thinning(rates_hz) if rates_hz else None
        if rates_hz:
            self.metadata(THINNED_NAME, {topic: f"{rate:g}" for topic, rate in rates_hz.items()})

    @property
    def broken(self) -> bool:
        """True once the file cannot be written."""
        return bool(self.failure)

    def write(self, log_time: int, message: Message, data: bytes | None = None) -> None:
        """Log one message and its standard messages.

        `log_time` is the instant of recording (ns), raised to the previous one if smaller. `data`
        are the received bytes; by default the message is encoded.
        """
        if self.broken:
            return
        topic, vehicle = TOPIC_OF[type(message)], message.vehicle
        valid_at: int = getattr(message, topic.instant)
        if self._thinning and not self._thinning.keeps(topic.name, vehicle, valid_at):
            return
        self._log_time = log_time = max(self._log_time, log_time)
        channel = self._channels.get((vehicle, topic.name)) or self._open(topic, vehicle)
        content = encode(message) if data is None else data
        channel.note(log_time, message)
        self._add(channel.identifier, log_time, content, valid_at, message.seq)
        for twin, identifier, timer in channel.standard_messages:
            if not twin.period_ns or timer.is_due(valid_at):
                self._add(identifier, log_time, twin.make(message), valid_at, message.seq)

    def write_deviation(
        self, log_time: int, vehicle: str, true_at: int, error: float, gap: float
    ) -> None:
        """Log the true error and gap (m, may be NaN) of a vehicle at an instant (ns)."""
        if self.broken:
            return
        opened = self._deviations.get(vehicle)
        if opened is None:
            name = f"/convoy/{vehicle}/deviation"
            of = {"of": key(vehicle, TOPICS["truth"])}
            identifier = self._register(name, protobuf_schema(Deviation), of)
            opened = self._deviations[vehicle] = _Channel(identifier, ()), count()
        channel, numbers = opened
        message = Deviation(
            vehicle=vehicle, true_at_ns=true_at, cross_track_error_m=error, true_gap_m=gap
        )
        self._log_time = at = max(self._log_time, log_time)
        self._add(channel.identifier, at, message.SerializeToString(), true_at, next(numbers))

    def _add(self, channel: int, log_time: int, data: bytes, sent_at: int, number: int) -> None:
        """Write one message, into a new chunk after `CHUNK_NS`."""
        self._written += 1
        try:
            if log_time >= self._chunk_ends_at:
                self._end_chunk()
                self._chunk_ends_at = log_time + CHUNK_NS
            # MCAP's instants are unsigned.
            self._writer.add_message(
                channel, log_time, data, max(sent_at, 0), number & SEQUENCE_MASK
            )
        except OSError as error:
            self._give_up(error)

    def _open(self, topic: Topic, vehicle: str) -> _Channel:
        origin = key(vehicle, topic)
        own = self._register(
            f"/{origin}", protobuf_schema(PROTOBUF[topic.message]), {"zenoh_key": origin}
        )
        standard_messages = tuple(
            (
                twin,
                self._register(f"/convoy/{vehicle}/{twin.name}", twin.schema, {"of": origin}),
                Timer(twin.period_ns),
            )
            for twin in self._twins.get(topic.message, ())
        )
        instants = _instants_of(topic.message)
        channel = self._channels[vehicle, topic.name] = _Channel(own, standard_messages, instants)
        return channel

    def _register(self, topic: str, schema: Schema, metadata: dict[str, str]) -> int:
        with self._named_failure():
            if schema.name not in self._schemas:
                self._schemas[schema.name] = self._writer.register_schema(
                    name=schema.name, encoding=schema.encoding, data=schema.data
                )
            return self._writer.register_channel(
                topic=topic,
                message_encoding=schema.message_encoding,
                schema_id=self._schemas[schema.name],
                metadata=metadata,
            )

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file with the log time of the last message."""
        if self.broken:
            return
        with self._named_failure():
            self._writer.add_attachment(0, self._log_time, name, media_type, data)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write named text values; readers use the last record of a name."""
        if self.broken:
            return
        with self._named_failure():
            self._writer.add_metadata(name, dict(values))

    def flush(self) -> None:
        if self.broken:
            return
        self._chunk_ends_at = 0  # the next message begins a chunk
        with self._named_failure():
            self._end_chunk()

    def close(self) -> None:
        """Complete the log and write it to the disk; further calls have no effect."""
        if self._file.closed:
            return
        extents = {
            f"/{key(vehicle, TOPICS[topic])}": " ".join(map(str, extent))
            for (vehicle, topic), channel in self._channels.items()
            if (extent := channel.extent) is not None
        }
        with self._named_failure():
            self._check_file()
            self._end_chunk()
            self._writer.add_metadata(EXTENTS, extents)
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._note_end()
            os.fsync(self._file.fileno())
            self._compare_counts()
            self._file.close()

    def _end_chunk(self) -> None:
        self._check_file()  # bytes written from now on would hide what is gone
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._note_end()

    def _note_end(self) -> None:
        """Flush the file, and note its last bytes for the next check."""
        self._file.flush()
        self._flushed = self._file.tell()
        self._tail = os.pread(self._file.fileno(), TAIL_BYTES, max(0, self._flushed - TAIL_BYTES))
        self._check_file()

    def _check_file(self) -> None:
        """Raise OSError if the file is no longer at its path, or lost bytes that were flushed."""
        status = os.fstat(self._file.fileno())
        if not os.path.samestat(status, self._path.stat()):
            raise OSError(errno.ENOENT, "another file took its place")
        if status.st_size < self._flushed:
            raise OSError(errno.EIO, f"cut to {status.st_size} of {self._flushed} bytes")
        start = max(0, self._flushed - TAIL_BYTES)
        if os.pread(self._file.fileno(), self._flushed - start, start) != self._tail:
            raise OSError(errno.EIO, "written bytes were changed or lost")

    def _compare_counts(self) -> None:
        """Raise OSError if the completed file does not hold all messages that were written."""
        self._file.seek(0)
        try:
            summary = make_reader(self._file).get_summary()
            held = 0
            if summary is not None and summary.statistics is not None:
                held = summary.statistics.message_count
            for chunk in summary.chunk_indexes if summary is not None else ():
                header = os.pread(self._file.fileno(), 9, chunk.chunk_start_offset)
                if header != CHUNK + (chunk.chunk_length - 9).to_bytes(8, "little"):
                    raise OSError(errno.EIO, f"no chunk at byte {chunk.chunk_start_offset}")
        except (McapError, ValueError, struct.error) as error:
            raise OSError(errno.EIO, f"it cannot be read: {error}") from error
        if held != self._written:
            raise OSError(errno.EIO, f"it holds {held} of {self._written} messages")

    def _open_end(self) -> None:
        """Remove the last bytes of a log that became complete although a call failed.

        `repair` completes it as a log that breaks off: its attached summary does not hold.
        """
        if self._file.closed:  # closing was the call that failed
            with self._path.open("r+b", buffering=0) as file:
                _cut_magic(file.fileno())
        else:
            self._file.flush()
            _cut_magic(self._file.fileno())

    @contextlib.contextmanager
    def _named_failure(self) -> Iterator[None]:
        """Turn OSError into LogError, and stop writing."""
        try:
            yield
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> NoReturn:
        self.failure = f"{self._path}: cannot write the log: {error.strerror}"
        with contextlib.suppress(OSError):
            self._open_end()
        with contextlib.suppress(OSError):
            self._file.close()
        raise UnwritableError(self.failure) from error
