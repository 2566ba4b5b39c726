"""Bytes from messages and back: Protobuf, with every refusal named."""

from collections.abc import Callable, Mapping
from dataclasses import fields
from math import isfinite, isinf
from operator import attrgetter
from typing import Any, Literal, get_args, get_origin

from google.protobuf.message import DecodeError
from google.protobuf.unknown_fields import UnknownFieldSet

from transport import convoy_pb2
from transport.reasons import RefusalReason
from transport.texts import printable
from transport.topics import TOPICS, Topic
from vehicles.messages import FloatOrNan, Message

MAX_BYTES = 16_384
"""No message of ours is larger; larger ones are refused unread."""
ADDED = {"piece_curvature_rate_per_m2": "piece_curvature_per_m"}
"""Columns of numbers that logs of earlier versions lack, and one as long: they are read as 0."""


class RefusedMessageError(ValueError):
    """Bytes that are not a valid message of the topic they came on; `reason` is its word."""

    def __init__(self, reason: RefusalReason, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason


class _Form:
    """How one message class maps to its Protobuf message: field by field, by name."""

    def __init__(self, message: type[Message]) -> None:
        self.message: Callable[..., Message] = message
        self.protobuf: Any = getattr(convoy_pb2, message.__name__)
        self.names = tuple(f.name for f in fields(message))
        self.values: Callable[[object], tuple[Any, ...]] = attrgetter(*self.names)
        self.words = {
            f.name: frozenset(get_args(f.type))
            for f in fields(message)
            if get_origin(f.type) is Literal
        }
        self.lists = [f.name for f in fields(message) if get_origin(f.type) is tuple]
        self.single = tuple(name for name in self.names if name not in self.lists)
        self.finite = [f.name for f in fields(message) if f.type is float]
        self.or_nan = [f.name for f in fields(message) if f.type == FloatOrNan]
        self.columns_of_numbers = [
            f.name
            for f in fields(message)
            if get_args(f.type)[:1] == (float,) and f.name in self.lists
        ]
        self.texts = [f.name for f in fields(message) if f.type is str]
        self.free_texts = [name for name in self.texts if name != "vehicle"]
        # Lists whose names begin alike (piece_…, sample_…) are columns of one table.
        firsts: dict[str, str] = {}
        self.columns = [
            (first, name)
            for name in self.lists
            if (first := firsts.setdefault(name.partition("_")[0], name)) != name
        ]
        self.added = [(name, ADDED[name]) for name in self.lists if name in ADDED]


_FORMS = {topic.message: _Form(topic.message) for topic in TOPICS.values()}
PROTOBUF: dict[type[Message], Any] = {kind: form.protobuf for kind, form in _FORMS.items()}


def encode(message: Message) -> bytes:
    """Serialise `message` as the Protobuf message of the same name."""
    form = _FORMS[type(message)]
    parsed = form.protobuf(**dict(zip(form.names, form.values(message), strict=True)))
    data: bytes = parsed.SerializeToString()  # no maps, so there is but one way to write it
    return data


def decode(topic: Topic, data: bytes, *, exact: bool = False) -> Message:
    """Read the message of `topic` from `data`; raises RefusedMessageError with the reason.

    Fields that are not in the schema are passed over, as Protobuf means it, so that the log of a
    later version can be read. With `exact` they are refused: for what comes off a bus, where all
    are of one version, and where one message's bytes often hold every field of another. Then a
    number that is not finite is refused too, unless its field may be NaN. Control characters in
    texts are escaped either way, so that they reach no terminal.
    """
    form = _FORMS[topic.message]
    parsed = _parse(form, data, exact=exact)
    values = dict(zip(form.names, form.values(parsed), strict=True))
    if not values["vehicle"]:
        raise RefusedMessageError("garbage", "no vehicle is named")
    for name, words in form.words.items():
        if values[name] not in words:
            raise RefusedMessageError("garbage", f"{name} is {values[name]!r}")
    for name in form.lists:
        values[name] = tuple(values[name])
    for name in form.texts:
        values[name] = printable(values[name])
    if exact:
        _check_numbers(form, values)
    else:
        for name, like in form.added:
            values[name] = values[name] or (0.0,) * len(values[like])
    for one, other in form.columns:
        if len(values[one]) != len(values[other]):
            raise RefusedMessageError("garbage", f"{one} and {other} differ in length")
    return form.message(**values)


def as_read(data: bytes, message: Message) -> bytes:
    """Return the bytes of `message` as it was read from `data`, with what was escaped.

    Its vehicle is known by then, so nothing was in that name.
    """
    for name in _FORMS[type(message)].free_texts:
        if "\\" in getattr(message, name):
            return encode(message)
    return data


def _check_numbers(form: _Form, values: Mapping[str, Any]) -> None:
    """Raise RefusedMessageError for a number that no vehicle measures."""
    # A sum is finite only if each of its numbers is, and takes one look at all of them.
    if not isfinite(sum([values[name] for name in form.finite])):
        for name in form.finite:
            if not isfinite(values[name]):
                raise RefusedMessageError("absurd", f"{name} is {values[name]}")
    for name in form.or_nan:
        if isinf(values[name]):
            raise RefusedMessageError("absurd", f"{name} is {values[name]}")
    for name in form.columns_of_numbers:
        if not all(map(isfinite, values[name])):
            raise RefusedMessageError("absurd", f"{name} has a number that is not finite")


def _parse(form: _Form, data: bytes, *, exact: bool) -> Any:
    name = form.protobuf.DESCRIPTOR.name
    if len(data) > MAX_BYTES:
        raise RefusedMessageError("oversized", f"{len(data)} bytes, at most {MAX_BYTES}")
    try:
        parsed = form.protobuf.FromString(data)
    except DecodeError as error:
        raise RefusedMessageError("garbage", f"not a {name}") from error
    # Cut between two fields, or written by another program, bytes can still be valid Protobuf.
    if not all(map(parsed.HasField, form.single)):
        raise RefusedMessageError("garbage", f"not a whole {name}")
    if exact and len(UnknownFieldSet(parsed)):
        raise RefusedMessageError("garbage", f"more than a {name}")
    return parsed
