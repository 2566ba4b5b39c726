"""Bytes from messages and back: Protobuf, with every refusal named."""

from collections import deque
from collections.abc import Callable
from dataclasses import MISSING, fields
from itertools import repeat
from math import isfinite, isinf
from operator import attrgetter, itemgetter
from typing import Any, Literal, get_args, get_origin

from google.protobuf.message import DecodeError
from google.protobuf.unknown_fields import UnknownFieldSet

from transport import convoy_pb2
from transport.packing import packer_of
from transport.reasons import RefusalReason
from transport.texts import printable
from transport.topics import TOPICS, Topic
from vehicles.messages import FloatOrNan, Message

MAX_BYTES = 16_384
"""No message of ours is larger; larger ones are refused unread."""
NEVER_TAKEN_UP = 20
"""Values in a tuple that Python keeps for later, up to 2000 of them, and then makes anew."""


class RefusedMessageError(ValueError):
    """Bytes that are not a valid message of the topic they came on; `reason` is its word."""

    def __init__(self, reason: RefusalReason, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason


Values = tuple[Any, ...]


def _picker(places: list[int]) -> Callable[[Values], Values]:
    """Return what picks the values at some places out of those of a message."""
    if len(places) > 1:
        return itemgetter(*places)
    return lambda values: tuple([values[place] for place in places])


class _Form:
    """How one message class maps to its Protobuf message: field by field, by name.

    Values of a message are told apart by their places, in the order of its fields.
    """

    def __init__(self, message: type[Message]) -> None:
        self.message = message
        self.protobuf: Any = getattr(convoy_pb2, message.__name__)
        self.pack = packer_of(self.protobuf.DESCRIPTOR)
        self.parse: Callable[[bytes], Any] = self.protobuf.FromString
        kinds = [(place, f.name, f.type) for place, f in enumerate(fields(message))]
        self.names = tuple([name for _, name, _ in kinds])
        # Of twenty values one more is taken, which nobody asks for: see `GpsPose.vehicle`.
        more = ("DESCRIPTOR",) if len(self.names) == NEVER_TAKEN_UP else ()
        self.values: Callable[[object], Values] = attrgetter(*self.names, *more)
        self.values_of: Callable[[object], Values] = attrgetter(*self.names)
        self.vehicle = self.names.index("vehicle")
        self.words = [
            (place, name, frozenset(get_args(kind)))
            for place, name, kind in kinds
            if get_origin(kind) is Literal
        ]
        self.lists = {name: place for place, name, kind in kinds if get_origin(kind) is tuple}
        self.finite = [name for _, name, kind in kinds if kind is float]
        self.or_nan = [name for _, name, kind in kinds if kind == FloatOrNan]
        self.finite_of: Callable[[Values], tuple[float, ...]] = _picker(
            [self.names.index(name) for name in self.finite]
        )
        self.or_nan_of: Callable[[Values], tuple[float, ...]] = _picker(
            [self.names.index(name) for name in self.or_nan]
        )
        self.columns_of_numbers = [
            (place, name)
            for place, name, kind in kinds
            if get_args(kind)[:1] == (float,) and name in self.lists
        ]
        self.texts = [place for place, _, kind in kinds if kind is str]
        self.free_texts = [self.names[place] for place in self.texts if place != self.vehicle]
        # Lists whose names begin alike (piece_…, sample_…) are columns of one table.
        firsts: dict[str, str] = {}
        self.columns = [
            (first, name)
            for name in self.lists
            if (first := firsts.setdefault(name.partition("_")[0], name)) != name
        ]
        self.defaults = {f.name: f.default for f in fields(message) if f.default is not MISSING}
        """Values of the fields that a log of an earlier version may lack."""
        self.added_columns = [
            (self.lists[name], self.lists[first])
            for first, name in self.columns
            if name in self.defaults
        ]


_FORMS = {topic.message: _Form(topic.message) for topic in TOPICS.values()}
PROTOBUF: dict[type[Message], Any] = {kind: form.protobuf for kind, form in _FORMS.items()}


def encode(message: Message) -> bytes:
    """Serialise `message` as the Protobuf message of the same name."""
    return _FORMS[type(message)].pack(message)


def values_of(message: Message) -> Values:
    """Give the values of `message` in the order of its fields; see `message_of`."""
    return _FORMS[type(message)].values_of(message)


def message_of(topic: Topic, values: Values) -> Message:
    """Make the message of `topic` of what `values_of` gave; nothing is checked."""
    return _made(_FORMS[topic.message], values)


def decode(topic: Topic, data: bytes, *, exact: bool = False) -> Message:
    """Read the message of `topic` from `data`; raises RefusedMessageError with the reason.

    By default logs of every version are read: unknown fields are ignored, and a missing field gets
    its default, if it has one. With `exact`, for messages from a bus, whose members all have one
    version, every field is required and no other is allowed: bytes cut between two fields, and
    those of another message, are refused. So is a number that is not finite, unless its field
    may be NaN. Control characters in texts are escaped either way, so that they reach no terminal.
    """
    form = _FORMS[topic.message]
    values = _parse(form, data, exact=exact)
    if not values[form.vehicle]:
        raise RefusedMessageError("garbage", "no vehicle is named")
    for place, name, words in form.words:
        if values[place] not in words:
            raise RefusedMessageError("garbage", f"{name} is {values[place]!r}")
    for place in form.texts:
        if not values[place].isprintable():
            values = _with(values, place, printable(values[place]))
    if form.lists:
        values = _with_tuples(form, values, exact=exact)
    if exact:
        _check_numbers(form, values)
    for one, other in form.columns:
        if len(values[form.lists[one]]) != len(values[form.lists[other]]):
            raise RefusedMessageError("garbage", f"{one} and {other} differ in length")
    return _made(form, values)


def _made(form: _Form, values: Values) -> Message:
    """Make a message as its class does, which takes three times as long to tell names apart."""
    message: Message = object.__new__(form.message)
    # A deque that keeps nothing makes all the calls in less time than a loop of Python's takes.
    deque(map(setattr, repeat(message), form.names, values), maxlen=0)
    return message


def _with(values: Values, place: int, value: object) -> Values:
    return *values[:place], value, *values[place + 1 :]


def _with_tuples(form: _Form, values: Values, *, exact: bool) -> Values:
    """Return the values with tuples as lists; columns that a log lacks are filled with zeros."""
    found = list(values)
    for place in form.lists.values():
        found[place] = tuple(found[place])
    if not exact:
        for place, first in form.added_columns:
            found[place] = found[place] or (0.0,) * len(found[first])
    return tuple(found)


def as_read(data: bytes, message: Message) -> bytes:
    """Return the bytes of `message` as it was read from `data`, with what was escaped.

    Its vehicle is known by then, so nothing was in that name.
    """
    for name in _FORMS[type(message)].free_texts:
        if "\\" in getattr(message, name):
            return encode(message)
    return data


def _check_numbers(form: _Form, values: Values) -> None:
    """Raise RefusedMessageError for a number that no vehicle measures."""
    # A sum is finite only if each of its numbers is, and takes one look at all of them.
    numbers = form.finite_of(values)
    if not isfinite(sum(numbers, 0.0)):
        for name, value in zip(form.finite, numbers, strict=True):
            if not isfinite(value):
                raise RefusedMessageError("absurd", f"{name} is {value}")
    numbers = form.or_nan_of(values)
    if any(map(isinf, numbers)):
        for name, value in zip(form.or_nan, numbers, strict=True):
            if isinf(value):
                raise RefusedMessageError("absurd", f"{name} is {value}")
    for place, name in form.columns_of_numbers:
        if not all(map(isfinite, values[place])):
            raise RefusedMessageError("absurd", f"{name} has a number that is not finite")


def _parse(form: _Form, data: bytes, *, exact: bool) -> Values:
    """Return the values of the fields: all of them are present, or have a default in a log."""
    if len(data) > MAX_BYTES:
        raise RefusedMessageError("oversized", f"{len(data)} bytes, at most {MAX_BYTES}")
    try:
        parsed = form.parse(data)
    except DecodeError as error:
        raise RefusedMessageError("garbage", f"not a {_name(form)}") from error
    values = form.values(parsed)
    # Cut between two fields, or written by another program, bytes can still be valid Protobuf.
    # What is neither zero nor empty is there.
    if not all(values):
        for place, (name, value) in enumerate(zip(form.names, values, strict=False)):
            if value or name in form.lists or parsed.HasField(name):
                continue
            if exact or name not in form.defaults:
                raise RefusedMessageError("garbage", f"not a whole {_name(form)}")
            values = _with(values, place, form.defaults[name])
    if exact and len(UnknownFieldSet(parsed)):
        raise RefusedMessageError("garbage", f"more than a {_name(form)}")
    return values


def _name(form: _Form) -> str:
    return str(form.protobuf.DESCRIPTOR.name)
