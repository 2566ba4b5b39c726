"""Writes the log of a run: one MCAP file.

Our own Protobuf messages are logged unchanged under `/convoy/<vehicle>/<topic>`, with the standard
Foxglove messages of `transport/log/foxglove.py`. The scenario, versions and summary are metadata
and attachments, so that the file alone suffices to review and measure the run.
"""

import contextlib
import errno
import os
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.writer import Writer

from transport.closing import Closing
from transport.codec import PROTOBUF, encode
from transport.log.errors import LogError, UnwritableError
from transport.log.foxglove import NO_SCENE, Scene, StandardMessage, standard_messages
from transport.log.mcap_file import THINNED_NAME, lock
from transport.topics import TOPIC_OF, Thinning, Topic, key
from vehicles.messages import Message
from vehicles.schedule import SECOND, Timer

SEQUENCE_MASK = 0xFFFF_FFFF
"""MCAP has sequence numbers of 32 bits; our message contains the full number."""
CHUNK_NS = SECOND
"""Maximum duration of a chunk; a flipped bit costs the whole chunk."""


def library_name() -> str:
    """Name of the software, with the versions that determine the bytes of a log."""
    parts = ("convoy-emulator", "mcap", "protobuf", "tomli-w", "zstandard")
    return " ".join(f"{part} {version(part)}" for part in parts)


def protobuf_schema(kind: Any) -> bytes:
    """The FileDescriptorSet of the file of a Protobuf class, after all its dependencies."""
    files: dict[str, FileDescriptor] = {}

    def add(file: FileDescriptor) -> None:
        for dependency in file.dependencies:
            add(dependency)
        files.setdefault(file.name, file)

    add(kind.DESCRIPTOR.file)
    described = FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(described.file.add())
    data: bytes = described.SerializeToString(deterministic=True)
    return data


Channels = tuple[int, list[tuple[StandardMessage, int, Timer]]]
"""Channel of one topic of one vehicle, and those of its standard messages."""


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
        scene: Scene = NO_SCENE,
        rates_hz: Mapping[str, float] | None = None,
    ) -> None:
        """Create the file; raises LogError. `rates_hz` are maximum rates by topic."""
        self._path = path
        self.failure = ""
        """Why the file cannot be written; empty if it can."""
        try:
            self._file = path.open("x+b")
            lock(self._file, path)
        except FileExistsError as error:
            raise LogError(f"{path}: exists; a log is never overwritten") from error
        except OSError as error:
            raise UnwritableError(f"{path}: cannot write the log: {error.strerror}") from error
        self._writer = Writer(self._file, enable_data_crcs=True)
        self._flushed = self._log_time = self._chunk_ends_at = 0
        self._standard = standard_messages(scene)
        self._channels: dict[tuple[str, str], Channels] = {}
        self._schemas: dict[str, int] = {}
        self._thinning = Thinning(rates_hz or {})
        try:
            self._try(self._writer.start, "", library or library_name())
            self._try(self._file.flush)  # a log without messages is recognised, too
        except LogError:
            path.unlink(missing_ok=True)
            raise
        if rates_hz:
            self.metadata(THINNED_NAME, {topic: f"{rate:g}" for topic, rate in rates_hz.items()})

    def write(self, log_time: int, message: Message, data: bytes | None = None) -> None:
        """Log one message and its standard messages.

        `log_time` is the instant of recording (ns), raised to the previous one if smaller. `data`
        are the received bytes; by default the message is encoded.
        """
        topic, vehicle = TOPIC_OF[type(message)], message.vehicle
        valid_at: int = getattr(message, topic.instant)
        if self.failure or not self._thinning.keeps(topic.name, vehicle, valid_at):
            return
        own, others = self._channels.get((vehicle, topic.name)) or self._open(topic, vehicle)
        content = encode(message) if data is None else data
        self._add(own, log_time, content, valid_at, message.seq)
        for standard, channel, timer in others:
            if not standard.period_ns or timer.is_due(valid_at):
                content = standard.make(message).SerializeToString()
                self._add(channel, log_time, content, valid_at, message.seq)

    def _add(self, channel: int, log_time: int, data: bytes, sent_at: int, number: int) -> None:
        """Write one message, into a new chunk after `CHUNK_NS`."""
        self._log_time = at = max(self._log_time, log_time)
        if at >= self._chunk_ends_at:
            self._try(self._end_chunk)
            self._chunk_ends_at = at + CHUNK_NS
        sent_at = max(sent_at, 0)  # MCAP's instants are unsigned
        self._try(self._writer.add_message, channel, at, data, sent_at, number & SEQUENCE_MASK)

    def _open(self, topic: Topic, vehicle: str) -> Channels:
        origin = key(vehicle, topic)
        own = self._register(f"/{origin}", PROTOBUF[topic.message], zenoh_key=origin)
        others = []
        for standard in self._standard.get(topic.message, ()):
            channel = self._register(f"/convoy/{vehicle}/{standard.name}", standard.kind, of=origin)
            others.append((standard, channel, Timer(standard.period_ns)))
        self._channels[vehicle, topic.name] = own, others
        return own, others

    def _register(self, topic: str, kind: Any, **metadata: str) -> int:
        """Register a channel of a Protobuf class, and its schema."""
        name = kind.DESCRIPTOR.full_name
        register = self._writer.register_schema
        if name not in self._schemas:
            self._schemas[name] = self._try(register, name, "protobuf", protobuf_schema(kind))
        of = self._schemas[name]
        channel: int = self._try(self._writer.register_channel, topic, "protobuf", of, metadata)
        return channel

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file with the log time of the last message."""
        self._try(self._writer.add_attachment, 0, self._log_time, name, media_type, data)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write named text values; readers use the last record of a name."""
        self._try(self._writer.add_metadata, name, dict(values))

    def flush(self) -> None:
        self._chunk_ends_at = 0  # the next message begins a chunk
        self._try(self._end_chunk)

    def close(self) -> None:
        """Complete the log and write it to the disk; further calls have no effect."""
        if not self._file.closed:
            self._try(self._complete)

    def _complete(self) -> None:
        self._end_chunk()
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.flush()
        os.fsync(self._file.fileno())
        self._check_file()
        self._file.close()

    def _end_chunk(self) -> None:
        self._check_file()  # bytes written from now on would hide what is gone
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._file.flush()
        self._flushed = self._file.tell()
        self._check_file()

    def _check_file(self) -> None:
        """Raise OSError if the file is no longer at its path, or lost bytes that were flushed."""
        status = os.fstat(self._file.fileno())
        if not os.path.samestat(status, self._path.stat()):
            raise OSError(errno.ENOENT, "another file took its place")
        if status.st_size < self._flushed:
            raise OSError(errno.EIO, f"cut to {status.st_size} of {self._flushed} bytes")

    def _try(self, call: Callable[..., Any], *args: Any) -> Any:
        """Call, unless the log has failed; raises LogError at the first OSError."""
        try:
            return None if self.failure else call(*args)
        except OSError as error:
            self.failure = f"{self._path}: cannot write the log: {error.strerror}"
            with contextlib.suppress(OSError):
                self._file.close()
            raise UnwritableError(self.failure) from error
