"""Bytes from messages and back: Protobuf, with every refusal named."""

from dataclasses import fields
from typing import Any

from google.protobuf.message import DecodeError

from transport import convoy_pb2
from transport.topics import TOPICS, Topic
from vehicles.messages import Message

MAX_BYTES = 16_384
"""No message of ours is larger; larger ones are refused unread."""


class RefusedMessageError(ValueError):
    """Bytes that are not a valid message of the topic they came on."""


_NAMES = {t.message: tuple(f.name for f in fields(t.message)) for t in TOPICS.values()}
_TUPLES = {
    t.message: tuple(f.name for f in fields(t.message) if str(f.type).startswith("tuple"))
    for t in TOPICS.values()
}
PROTOBUF: dict[type[Message], Any] = {
    t.message: getattr(convoy_pb2, t.message.__name__) for t in TOPICS.values()
}


def encode(message: Message) -> bytes:
    """Serialise `message` as the Protobuf message of the same name."""
    kind = type(message)
    values = {name: getattr(message, name) for name in _NAMES[kind]}
    data: bytes = PROTOBUF[kind](**values).SerializeToString(deterministic=True)
    return data


def decode(topic: Topic, data: bytes) -> Message:
    """Read the message of `topic` from `data`; raises RefusedMessageError with the reason."""
    if len(data) > MAX_BYTES:
        raise RefusedMessageError(f"oversized: {len(data)} bytes, at most {MAX_BYTES}")
    try:
        parsed = PROTOBUF[topic.message].FromString(data)
    except DecodeError as error:
        raise RefusedMessageError("not a Protobuf message of this topic") from error
    values = {name: getattr(parsed, name) for name in _NAMES[topic.message]}
    for name in _TUPLES[topic.message]:
        values[name] = tuple(values[name])
    return topic.message(**values)
