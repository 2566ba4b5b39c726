"""Read a log by the libraries `mcap` and `mcap-protobuf-support` alone.

Damaged chunks are skipped; all else of the log must be valid.
"""

import math
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap_protobuf.decoder import DecoderFactory

from transport import convoy_pb2

MESSAGES = {
    "gps": "GpsPose",
    "truth": "TruePose",
    "trajectory": "CompositeTrajectory",
    "tracking": "Tracking",
    "command": "Command",
    "verdict": "LinkVerdict",
    "health": "Health",
    "log": "LogText",
    "change": "Change",
    "start": "RunStart",
    "end": "RunEnd",
}
"""Message types by topic."""


@dataclass(frozen=True)
class SecondReading:
    """Decoded messages by (vehicle, topic), and the number of damaged chunks."""

    messages: dict[tuple[str, str], list[Any]]
    damaged: int

    def of(self, vehicle: str, topic: str) -> list[Any]:
        return self.messages.get((vehicle, topic), [])

    def values(self, vehicle: str, topic: str, field: str) -> list[Any]:
        return [value(message, topic, field) for message in self.of(vehicle, topic)]


def value(message: Any, topic: str, field: str) -> Any:
    number = getattr(convoy_pb2, MESSAGES[topic]).DESCRIPTOR.fields_by_name[field].number
    written = message.DESCRIPTOR.fields_by_number.get(number)
    if written is None:
        return None
    content = getattr(message, written.name)
    if written.is_repeated:
        return list(content)
    return content if message.HasField(written.name) else None


def read(path: Path) -> SecondReading:
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    messages: defaultdict[tuple[str, str], list[Any]] = defaultdict(list)
    factory, damaged = DecoderFactory(), 0
    with path.open("rb") as file:
        for chunk in StreamReader(file, emit_chunks=True).records:
            if not isinstance(chunk, Chunk):
                continue
            try:
                records = breakup_chunk(chunk, validate_crc=True)
            except (McapError, Exception):  # noqa: BLE001 - zstandard's, for damaged data
                damaged += 1
                continue
            for record in records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    _, _, vehicle, topic = ["", *channel.topic.rsplit("/", 2)][-4:]
                    if channel.topic == f"/convoy/{vehicle}/{topic}" and topic in MESSAGES:
                        decoder = factory.decoder_for("protobuf", schemas[channel.schema_id])
                        assert decoder is not None
                        messages[vehicle, topic].append(decoder(record.data))
    return SecondReading(dict(messages), damaged)


def same(first: object, second: object) -> bool:
    """Whether two values are equal, NaN being equal to NaN."""
    if isinstance(first, float) and isinstance(second, float):
        return first == second or (math.isnan(first) and math.isnan(second))
    return first == second
