"""Writes a part of a log, or several logs of one run, into a new log.

Messages are copied without being decoded. The start of the run and the messages that are logged
once, such as the road, are always kept.
"""

import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from heapq import merge
from pathlib import Path
from typing import NamedTuple

from mcap.records import Channel, Schema
from mcap.writer import Writer

from transport.log.mcap_file import McapFile
from transport.log.records import REPAIRED, LogError, UnwritableError
from transport.log.writer import CHUNK_NS, library_name
from transport.topics import RUN_SENDER

KEPT_TOPICS = {"start"}
"""Topics that every piece holds."""
KEPT_CHANNELS = {"box"}
"""Channels with one message at the start of the run."""


class Choice(NamedTuple):
    """Messages to copy: an interval of the instants of recording (ns), topics, and vehicles."""

    span_ns: tuple[int, int] | None = None
    topics: Collection[str] | None = None
    vehicles: Collection[str] | None = None

    def channels(self, file: McapFile) -> set[int]:
        """Channels to copy, the standard messages of a topic with it."""
        return {number for number, channel in file.described().items() if self._holds(channel)}

    def _holds(self, channel: Channel) -> bool:
        _, _, vehicle, name = [*channel.topic.split("/"), "", "", ""][:4]
        topic = channel.metadata.get("of", channel.metadata.get("zenoh_key", "")).rpartition("/")[2]
        if self.vehicles is not None and vehicle not in {*self.vehicles, RUN_SENDER}:
            return False
        return self.topics is None or not {topic, name}.isdisjoint({*self.topics, *KEPT_TOPICS})


class _Raw(NamedTuple):
    """A message as it is stored; `source` is the number of its file."""

    log_time: int
    source: int
    channel: int
    sequence: int
    publish_time: int
    data: bytes


def write_piece(
    files: Sequence[McapFile],
    path: Path,
    choice: Choice,
    *,
    metadata: Mapping[str, Mapping[str, str]],
    attachments: Mapping[str, bytes],
    add: Callable[[Path], Mapping[str, bytes]],
) -> int:
    """Write the chosen messages of `files` to the new log `path`; returns their number.

    Messages in several files are written once. `metadata` and `attachments` come first; `add`
    returns further attachments from the path of the log with all messages, which is not complete
    yet. Raises LogError.
    """
    part = path.with_name(path.name + ".part")
    if path.exists():
        raise LogError(f"{path}: exists; a log is never overwritten")
    try:
        with part.open("xb") as file:
            writer = Writer(file, enable_data_crcs=True)
            writer.start(profile="", library=library_name())
            for name, values in metadata.items():
                if name != REPAIRED:
                    writer.add_metadata(name, dict(values))
            for name, content in attachments.items():
                writer.add_attachment(0, 0, name, _media_type(name), content)
            count = _copy(files, writer, choice)
            writer.flush()  # type: ignore[no-untyped-call]
            file.flush()
            for name, content in add(part).items():
                writer.add_attachment(0, 0, name, _media_type(name), content)
            writer.finish()  # type: ignore[no-untyped-call]
            file.flush()
            os.fsync(file.fileno())
        part.rename(path)
    except OSError as error:
        raise UnwritableError(f"{path}: cannot write the log: {error.strerror}") from error
    finally:
        with suppress(OSError):
            part.unlink()
    return count


def _media_type(name: str) -> str:
    return {"json": "application/json", "toml": "application/toml", "csv": "text/csv"}.get(
        name.rpartition(".")[2], "application/octet-stream"
    )


def _copy(files: Sequence[McapFile], writer: Writer, choice: Choice) -> int:
    """Copy the messages in the order of their instants of recording."""
    numbers: dict[tuple[int, int], int] = {}
    schemas: dict[tuple[str, bytes], int] = {}
    channels: dict[str, int] = {}
    written: dict[int, set[tuple[int, int]]] = {}
    count, chunk_ends_at = 0, 0
    for message in merge(*(_chosen(file, n, choice) for n, file in enumerate(files))):
        number = numbers.get((message.source, message.channel))
        if number is None:
            file = files[message.source]
            channel = file.described()[message.channel]
            schema = file.schemas()[channel.schema_id]
            number = channels.get(channel.topic)
            if number is None:
                number = channels[channel.topic] = _register(writer, channel, schema, schemas)
            numbers[message.source, message.channel] = number
        if len(files) > 1:
            seen = written.setdefault(number, set())
            if (message.sequence, message.publish_time) in seen:
                continue
            seen.add((message.sequence, message.publish_time))
        if message.log_time >= chunk_ends_at:
            writer.flush()  # type: ignore[no-untyped-call]
            chunk_ends_at = message.log_time + CHUNK_NS
        writer.add_message(
            number, message.log_time, message.data, message.publish_time, message.sequence
        )
        count += 1
    return count


def _register(
    writer: Writer, channel: Channel, schema: Schema, schemas: dict[tuple[str, bytes], int]
) -> int:
    key = schema.name, schema.data
    if key not in schemas:
        schemas[key] = writer.register_schema(schema.name, schema.encoding, schema.data)
    return writer.register_channel(
        channel.topic, channel.message_encoding, schemas[key], channel.metadata
    )


def _chosen(file: McapFile, source: int, choice: Choice) -> Iterator[_Raw]:
    wanted = choice.channels(file)
    described = file.described()
    always = {
        number
        for number in wanted
        if described[number].topic.rpartition("/")[2] in KEPT_CHANNELS | KEPT_TOPICS
        or described[number].metadata.get("of", "").endswith("/start")
    }
    first, last = choice.span_ns or (0, 2**63)
    for _, head in file.chunks:
        if not always and (head.last_at < first or head.first_at > last):
            continue
        for channel, sequence, log_time, publish_time, data in file.stored(head):
            if channel in wanted and (first <= log_time <= last or channel in always):
                yield _Raw(log_time, source, channel, sequence, publish_time, data)
