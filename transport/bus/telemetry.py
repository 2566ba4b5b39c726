"""Batches of messages that only the log and the picture need, from several ticks.

Each message on the wire has a constant cost; 200 messages per second and vehicle are too many for
40 vehicles. A batch holds the unchanged bytes of each message.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from google.protobuf.message import DecodeError

from transport.codec import MAX_BYTES, RefusedMessageError
from transport.convoy_pb2 import Records
from transport.topics import TOPICS

MAX_RECORDS_BYTES = 65_535  # Maximum size of a batch; larger ones are refused without being parsed
_HEAD_BYTES = 48  # Upper bound on the bytes of a record without its message

_BATCHED = frozenset([topic.name for topic in TOPICS.values() if topic.batched])


class BatchRecord(NamedTuple):
    """A message in a batch: topic, instant of validity (ns) and bytes."""

    topic: str
    at: int
    data: bytes


def records_key(vehicle: str) -> str:
    return f"convoy/{vehicle}/records"


def packed(records: Iterable[BatchRecord]) -> Iterator[bytes]:
    """Yield batches of at most `MAX_RECORDS_BYTES` with all records in order."""
    batch, size = Records(), 0
    for topic, at, data in records:
        if size + len(data) + _HEAD_BYTES > MAX_RECORDS_BYTES:
            yield batch.SerializeToString()
            batch, size = Records(), 0
        batch.record.add(topic=topic, at_ns=at, data=data)
        size += len(data) + _HEAD_BYTES
    if size:
        yield batch.SerializeToString()


def unpacked(data: bytes) -> list[BatchRecord]:
    """Records of a batch, messages not decoded; raises RefusedMessageError for invalid bytes.

    Invalid records get an empty topic, so that they are refused one by one.
    """
    if len(data) > MAX_RECORDS_BYTES:
        raise RefusedMessageError("oversized", f"{len(data)} bytes, at most {MAX_RECORDS_BYTES}")
    try:
        batch = Records.FromString(data)
    except DecodeError as error:
        raise RefusedMessageError("garbage", "not a batch of records") from error
    records: list[BatchRecord] = []
    for record in batch.record:
        topic: str = record.topic
        content: bytes = record.data
        if topic not in _BATCHED or len(content) > MAX_BYTES:
            topic = ""
        records.append(BatchRecord(topic, record.at_ns, content))
    return records
