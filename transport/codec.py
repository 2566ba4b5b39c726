"""Encode messages as Protobuf and decode them; invalid bytes are refused with a reason."""

import sys
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import MISSING, fields
from math import isfinite, isinf
from typing import Any, Final, Literal, get_args, get_origin

from google.protobuf.message import DecodeError
from google.protobuf.unknown_fields import UnknownFieldSet

from transport import convoy_pb2
from transport.texts import printable
from transport.topics import TOPICS, RefusalReason, Topic
from vehicles.messages import FloatOrNan, Message

MAX_BYTES = 16_384  # Maximum size of a message; larger ones are refused without being parsed
LARGEST = 2**63 - 1  # Tables of messages have signed integers of 64 bits


class RefusedMessageError(ValueError):
    """Bytes that are not a valid message of their topic; `reason` is one of the table."""

    def __init__(self, reason: RefusalReason, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason


class MessageForm:
    """Fields of one message class by type; the Protobuf message has the same field names."""

    def __init__(self, message: type[Message]) -> None:
        self.message: Any = message
        self.protobuf: Any = getattr(convoy_pb2, message.__name__)
        self.name: str = self.protobuf.DESCRIPTOR.name
        kinds = [(f.name, f.type) for f in fields(message)]
        self.fields = [name for name, _ in kinds]
        self.words = [
            (name, frozenset(get_args(kind))) for name, kind in kinds if get_origin(kind) is Literal
        ]
        self.texts = [name for name, kind in kinds if kind is str]
        self.free_texts = [name for name in self.texts if name != "vehicle"]
        self.integers = [name for name, kind in kinds if kind is int]
        self.finite = [name for name, kind in kinds if kind is float]
        self.or_nan = [name for name, kind in kinds if kind == FloatOrNan]
        self.lists = [name for name, kind in kinds if get_origin(kind) is tuple]
        self.single = [name for name in self.fields if name not in self.lists]
        self.columns_of_numbers = [
            name for name, kind in kinds if name in self.lists and get_args(kind)[0] is float
        ]
        self.columns_or_nan = [
            name for name, kind in kinds if name in self.lists and get_args(kind)[0] == FloatOrNan
        ]
        # Lists with a common prefix (piece_…, sample_…) are columns of one table.
        firsts: dict[str, str] = {}
        self.columns = [
            (first, name)
            for name in self.lists
            if (first := firsts.setdefault(name.partition("_")[0], name)) != name
        ]
        self.defaults = {f.name: f.default for f in fields(message) if f.default is not MISSING}
        """Values of the fields that earlier logs may lack."""


_FORMS = {topic.message: MessageForm(topic.message) for topic in TOPICS.values()}
PROTOBUF: dict[type[Message], Any] = {kind: form.protobuf for kind, form in _FORMS.items()}


def form_of(message: type[Message]) -> MessageForm:
    return _FORMS[message]


def encode(message: Message) -> bytes:
    form = _FORMS[type(message)]
    parsed = form.protobuf(**{name: getattr(message, name) for name in form.fields})
    data: bytes = parsed.SerializeToString()
    return data


def decode(topic: Topic, data: bytes, *, exact: bool = False) -> Message:
    """Decode a message of `topic`; raises RefusedMessageError with the reason.

    By default logs of every version are accepted: unknown fields are ignored, and missing fields
    get their default. With `exact`, for messages from a bus, exactly the current fields are
    required, because all members have one version; numbers must be finite unless the field may be
    NaN, and integers at most LARGEST. Control characters in texts are always escaped, so that they
    cannot reach a terminal.
    """
    form = _FORMS[topic.message]
    values = _values(form, _parsed(form, data, exact=exact), exact=exact)
    if not values["vehicle"]:
        raise RefusedMessageError("garbage", "vehicle is empty")
    for name, words in form.words:
        if values[name] not in words:
            raise RefusedMessageError("garbage", f"{name} is {values[name]!r}")
    for name in form.texts:
        if not values[name].isprintable():
            values[name] = printable(values[name])
    if exact:
        _check_numbers(form, values)
    for first, name in form.columns:
        if len(values[first]) != len(values[name]):
            raise RefusedMessageError("garbage", f"{first} and {name} differ in length")
    message: Message = form.message(**values)
    return message


def escaped_bytes(data: bytes, message: Message) -> bytes:
    """Bytes of `message`, decoded from `data`, with control characters in free texts escaped.

    The vehicle must be a known one; its name has no control characters.
    """
    for name in _FORMS[type(message)].free_texts:
        if "\\" in getattr(message, name):
            return encode(message)
    return data


def _parsed(form: MessageForm, data: bytes, *, exact: bool) -> Any:
    if len(data) > MAX_BYTES:
        raise RefusedMessageError("oversized", f"{len(data)} bytes, at most {MAX_BYTES}")
    try:
        parsed = form.protobuf.FromString(data)
    except DecodeError as error:
        raise RefusedMessageError("garbage", f"not a {form.name}") from error
    if exact and len(UnknownFieldSet(parsed)):
        raise RefusedMessageError("garbage", f"unknown fields in a {form.name}")
    return parsed


def _values(form: MessageForm, parsed: Any, *, exact: bool) -> dict[str, Any]:
    """Values by field; in a log, missing values get their default."""
    values = {name: getattr(parsed, name) for name in form.fields}
    # Bytes cut between two fields, or of another program, can still be valid Protobuf.
    for name in form.single:
        if not values[name] and not parsed.HasField(name):
            if exact or name not in form.defaults:
                raise RefusedMessageError("garbage", f"not a complete {form.name}")
            values[name] = form.defaults[name]
    for name in form.lists:
        values[name] = tuple(values[name])
    if not exact:
        for first, name in form.columns:
            if name in form.defaults and not values[name]:
                values[name] = (0.0,) * len(values[first])
    return values


def _check_numbers(form: MessageForm, values: dict[str, Any]) -> None:
    if (largest := max([values[name] for name in form.integers])) > LARGEST:
        raise RefusedMessageError("absurd", f"an integer is {largest}")
    for name in form.finite:
        if not isfinite(values[name]):
            raise RefusedMessageError("absurd", f"{name} is {values[name]}")
    for name in form.or_nan:
        if isinf(values[name]):
            raise RefusedMessageError("absurd", f"{name} is {values[name]}")
    for name in form.columns_or_nan:
        if any(map(isinf, values[name])):
            raise RefusedMessageError("absurd", f"{name} has an infinite number")
    for name in form.columns_of_numbers:
        if not all(map(isfinite, values[name])):
            raise RefusedMessageError("absurd", f"{name} has a number that is not finite")


# ---- Received numbers of a sender's messages, for links and recorder


MAX_RANGES: Final = 1000
"""Maximum number of ranges per topic in the recorder, so that forged numbers take no memory.
Beyond it duplicates may be recorded; no message is refused wrongly."""


class MessageNumbers:
    """Numbers of a sender's messages of one topic, stored as ranges; added in any order."""

    def __init__(self, most_ranges: int = sys.maxsize, window: int = sys.maxsize) -> None:
        """Numbers that would exceed `most_ranges` ranges are not stored.

        Ranges that end `window` or more numbers behind the newest one are deleted.
        """
        self._firsts: list[int] = []
        self._lasts: list[int] = []
        self._most_ranges = most_ranges
        self._window = window

    def __contains__(self, number: int) -> bool:
        lasts = self._lasts
        if not lasts or number > lasts[-1]:  # the usual case
            return False
        return self._firsts[bisect_left(lasts, number)] <= number

    def add(self, number: int) -> bool:
        """Add a number; returns whether it is new."""
        firsts, lasts = self._firsts, self._lasts
        if lasts and number == lasts[-1] + 1:  # the usual case
            lasts[-1] = number
        elif not self._insert(number):
            return False
        while lasts[0] <= lasts[-1] - self._window:
            del firsts[0], lasts[0]
        return True

    def _insert(self, number: int) -> bool:
        firsts, lasts = self._firsts, self._lasts
        place = bisect_left(lasts, number)  # the first range that ends at it or later
        if place < len(lasts) and firsts[place] <= number:
            return False
        firsts.insert(place, number)
        lasts.insert(place, number)
        for left in (place, place - 1):  # join adjacent ranges
            if 0 <= left < len(lasts) - 1 and lasts[left] + 1 == firsts[left + 1]:
                del lasts[left], firsts[left + 1]
        if len(firsts) > self._most_ranges:
            del lasts[place], firsts[place]
        return True

    @property
    def newest(self) -> int:
        """Largest number so far, -1 without any."""
        return self._lasts[-1] if self._lasts else -1

    def ranges(self) -> Iterator[tuple[int, int]]:
        """Yield (first, last) of each range of stored numbers, in order."""
        return zip(self._firsts, self._lasts, strict=True)
