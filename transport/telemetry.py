"""What only the log and the picture need goes together: messages of several ticks as one.

On the wire each message has its cost, however short it is: two hundred a second and vehicle are too
many for forty vehicles. Inside are the bytes of each as they would have come alone.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from google.protobuf.message import DecodeError

from transport.codec import MAX_BYTES, RefusedMessageError
from transport.convoy_pb2 import Records
from transport.topics import TOPICS

MAX_RECORDS_BYTES = 65_535
"""No batch is larger; larger ones are refused unread."""
_HEAD_BYTES = 48
"""More than a record has besides its message's bytes."""

_BATCHED = frozenset([topic.name for topic in TOPICS.values() if topic.batched])


class BatchRecord(NamedTuple):
    """A message in a batch: its topic, the instant (ns) at which it was valid, and its bytes."""

    topic: str
    at: int
    data: bytes


def records_key(vehicle: str) -> str:
    """Zenoh key expression of a vehicle's batches."""
    return f"convoy/{vehicle}/records"


def packed(records: Iterable[BatchRecord]) -> Iterator[bytes]:
    """Yield batches with all records, in their order; no batch is larger than is allowed."""
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
    """Return the records of a batch, whose messages are not looked into.

    Raises RefusedMessageError for bytes that are no batch. A record that is none has a topic that
    does not exist, so that it is refused alone.
    """
    if len(data) > MAX_RECORDS_BYTES:
        raise RefusedMessageError("oversized", f"{len(data)} bytes, at most {MAX_RECORDS_BYTES}")
    try:
        batch = Records.FromString(data)
    except DecodeError as error:
        raise RefusedMessageError("garbage", "not a batch of records") from error
    found: list[BatchRecord] = []
    for record in batch.record:
        topic: str = record.topic
        content: bytes = record.data
        if topic not in _BATCHED or len(content) > MAX_BYTES:
            topic = ""
        found.append(BatchRecord(topic, record.at_ns, content))
    return found
