"""The MCAP file of a log: its complete records, and the repair of one that breaks off.

Reads with the mcap package; `transport/log/fast_mcap.py` writes with it.
"""

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import IO, cast

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.reader import SeekingReader
from mcap.stream_reader import CRCValidationError, StreamReader, get_chunk_data_stream
from zstandard import ZstdError

from transport.log.fast_mcap import Writer
from transport.log.records import (
    ATTACHMENT,
    CHUNK,
    METADATA,
    LogError,
    map_log,
    messages_in,
    records_in,
)

__all__ = ["McapFile", "repair"]


class McapFile:
    """The complete records of an MCAP file, which may break off in the middle of one."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._bytes, self.truncated = map_log(path)

    def __iter__(self) -> Iterator[records.McapRecord]:
        """Give the records of the data section, those in chunks one by one."""
        self._bytes.seek(0)
        stream = StreamReader(cast("IO[bytes]", self._bytes), validate_crcs=True)
        with self._name_damage(), suppress(EndOfFile):  # a broken log ends after some record
            for record in stream.records:
                if isinstance(record, records.DataEnd):
                    return
                yield record

    def messages(self) -> Iterator[tuple[int, int, bytes]]:
        """Give (channel, log time, data) of all messages, several times as fast as one by one."""
        for content in records_in(self._bytes, CHUNK):
            chunk = records.Chunk.read(_stream(content))
            with self._name_damage():
                stream, length = get_chunk_data_stream(chunk, validate_crc=True)
            yield from messages_in(stream.read(length))

    def metadata(self) -> dict[str, dict[str, str]]:
        """Return the named text values."""
        found = (records.Metadata.read(_stream(r)) for r in records_in(self._bytes, METADATA))
        return {record.name: record.metadata for record in found}

    def attachments(self) -> dict[str, bytes]:
        """Return the attached files by name."""
        found = (records.Attachment.read(_stream(r)) for r in records_in(self._bytes, ATTACHMENT))
        return {record.name: record.data for record in found}

    def channels(self) -> tuple[dict[int, str], Mapping[int, int]]:
        """Return the channels' topics by number, and the number of messages of each."""
        if not self.truncated:
            found = SeekingReader(cast("IO[bytes]", self._bytes)).get_summary()
            if found and found.statistics:
                topics = {number: channel.topic for number, channel in found.channels.items()}
                return topics, found.statistics.channel_message_counts
        topics = {r.id: r.topic for r in self if isinstance(r, records.Channel)}
        return topics, Counter(channel for channel, _, _ in self.messages())

    @contextmanager
    def _name_damage(self) -> Iterator[None]:
        try:
            yield
        except (CRCValidationError, McapError, ZstdError) as error:
            raise LogError(f"{self.path}: the log is damaged: {error}") from error


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))


def repair(path: Path) -> bool:
    """Complete a log that breaks off, with every record that can be read.

    Writes a new file beside it and then replaces it in one step; a complete log is not changed. The
    metadata `repaired` say how many messages were kept. Returns whether the log was
    repaired. Raises LogError if the file is no MCAP log.
    """
    broken = McapFile(path)
    if not broken.truncated:
        return False
    beside = path.with_name(path.name + ".repaired")
    try:
        with beside.open("wb") as file:
            _copy(broken, Writer(file))
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
    return True


def _copy(broken: McapFile, writer: Writer) -> None:
    """Write all records again and complete them with an index and a summary."""
    kept = 0
    schemas = {0: 0}
    channels: dict[int, int] = {}
    for r in broken:
        match r:
            case records.Header():
                writer.start(r.profile, r.library)
            case records.Schema():
                schemas[r.id] = writer.register_schema(r.name, r.encoding, r.data)
            case records.Channel():
                channels[r.id] = writer.register_channel(
                    r.topic, r.message_encoding, schemas[r.schema_id], r.metadata
                )
            case records.Message():
                kept += 1
                channel = channels[r.channel_id]
                writer.add_message(channel, r.log_time, r.data, r.publish_time, r.sequence)
            case records.Attachment():
                writer.add_attachment(r.create_time, r.log_time, r.name, r.media_type, r.data)
            case records.Metadata():
                writer.add_metadata(r.name, r.metadata)
    writer.add_metadata("repaired", {"messages": str(kept)})
    writer.finish()  # type: ignore[no-untyped-call]
