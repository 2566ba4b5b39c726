"""Messages of a log by columns: field by field, one array operation reads all messages.

The fields of a message type come from its Protobuf descriptor. They must be in the order of their
numbers, as every serializer writes them; other messages are decoded one by one. Encoding: Protocol
Buffers documentation, "Encoding".
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.descriptor import FieldDescriptor

from transport.codec import MessageForm, RefusedMessageError, decode, form_of
from transport.columns import Array, Columns, Flags, Integers, Lists, columns_from, joined, ranges
from transport.log.errors import LogError
from transport.log.mcap_file import ChunkPlace, McapFile, Messages, numbers_at
from transport.texts import printable
from transport.topics import TOPICS

BATCH_BYTES = 2**24
"""Size of the records that are decoded at once; limits the memory."""
_VARINT, _DOUBLE, _SIZED = 0, 1, 2
"""Wire types: integers of variable length, 8 bytes, and a length before the content."""
_LOW_BITS = 0x7F
"""Bits of a byte of an integer; a larger byte is followed by another one."""
_VARINT_BITS = 64


# ---- Fields of a message type


class _Field(NamedTuple):
    """A field of a message type, with the bytes before its value."""

    name: str
    type: int
    is_list: bool
    wire_type: int
    tag: bytes


class _Layout(NamedTuple):
    """Fields of the messages of a topic; all are read but the vehicle."""

    topic: str
    fields: tuple[_Field, ...]
    form: MessageForm


@cache
def _layout(topic: str) -> _Layout:
    form = form_of(TOPICS[topic].message)
    rows = sorted(form.protobuf.DESCRIPTOR.fields, key=lambda row: row.number)
    return _Layout(topic, tuple(map(_field, rows)), form)


def _field(row: FieldDescriptor) -> _Field:
    wire_type = _DOUBLE if row.type == FieldDescriptor.TYPE_DOUBLE else _VARINT
    if row.is_repeated or row.type == FieldDescriptor.TYPE_STRING:
        wire_type = _SIZED
    tag = row.number << 3 | wire_type  # of at most two bytes
    packed = bytes([tag & _LOW_BITS | 0x80, tag >> 7] if tag > _LOW_BITS else [tag])
    return _Field(row.name, row.type, row.is_repeated, wire_type, packed)


# ---- Messages of a log


def read_columns(
    file: McapFile,
    channels: Mapping[int, tuple[str, str]],
    span: tuple[int, int],
) -> dict[tuple[str, str], Columns]:
    """Read messages by (vehicle, topic); `channels` are these by channel number.

    Only the chunks within `span` (ns) are read. Raises LogError for a message that its topic
    refuses.
    """
    parts: dict[tuple[str, str], list[Columns]] = {key: [] for key in channels.values()}
    for batch in _batches(file, channels, span):
        is_within = (batch.logged_at >= span[0]) & (batch.logged_at <= span[1])
        for topic in dict.fromkeys(topic for _, topic in parts):
            numbers = {number: key[0] for number, key in channels.items() if key[1] == topic}
            messages = batch.of(is_within & np.isin(batch.channels, list(numbers)))
            try:
                for part in _read(messages, _layout(topic), numbers):
                    parts[part.vehicle, topic].append(part)
            except (RefusedMessageError, OverflowError) as error:
                raise LogError(f"{file.path}: topic {topic}: {error}") from error
    # Parts are released one by one: together they are as large as the result.
    return {key: joined(parts.pop(key)) for key in list(parts)}


def _batches(
    file: McapFile, channels: Mapping[int, object], span: tuple[int, int]
) -> Iterator[Messages]:
    """Yield the messages of the chunks that may hold messages to read."""
    chosen: list[ChunkPlace] = []
    for chunk in file.chunks:
        if chosen and chunk.before - chosen[0].before > BATCH_BYTES:
            yield file.read(chosen)
            chosen = []
        is_within = chunk.first_at <= span[1] and chunk.last_at >= span[0]
        if is_within and not chunk.channels.isdisjoint(channels):
            chosen.append(chunk)
    yield file.read(chosen)


def _read(messages: Messages, layout: _Layout, vehicles: Mapping[int, str]) -> Iterator[Columns]:
    """Decode the messages of a topic, and split them by vehicle."""
    columns, is_odd = _decode(messages, layout)
    if is_odd.any():
        odd = _decode_singly(messages.of(is_odd), layout.topic)
        columns = joined([columns.of(~is_odd), odd])
        columns = columns.of(np.argsort(columns.order))
    for vehicle in dict.fromkeys(vehicles.values()):
        numbers = [number for number, name in vehicles.items() if name == vehicle]
        yield replace(columns.of(np.isin(messages.channels, numbers)), vehicle=vehicle)


def _decode_singly(messages: Messages, topic: str) -> Columns:
    """Decode messages one by one; raises RefusedMessageError."""
    spans = zip(messages.starts.tolist(), messages.ends.tolist(), strict=True)
    decoded = [decode(TOPICS[topic], messages.content[start:end]) for start, end in spans]
    columns = columns_from(topic, decoded, messages.logged_at.tolist())
    return replace(columns, order=messages.order)


def _decode(messages: Messages, layout: _Layout) -> tuple[Columns, Flags]:
    """Decode the messages of a topic; returns also which of them have to be decoded one by one."""
    data, ends = _WireData(messages.content), messages.ends
    at, is_odd = messages.starts.copy(), np.zeros(len(ends), bool)
    fields: dict[str, Array] = {}
    lists: dict[str, Lists] = {}
    defaults = layout.form.defaults
    for row in layout.fields:
        is_there = data.has_tag(row.tag, at) & (at < ends)
        rows: Any = slice(None) if is_there.all() else np.flatnonzero(is_there)
        if not row.is_list and row.name not in defaults:
            is_odd |= ~is_there
        values, begin, after = data.span(row, at[rows] + len(row.tag))
        is_wrong = after > ends[rows]
        after = np.minimum(after, ends[rows])
        if row.is_list:
            counts, values, is_wrong_list = data.packed(row, np.minimum(begin, after), after)
            lengths = np.zeros(len(at), np.int64)
            lengths[rows] = counts
            lists[row.name] = Lists(np.concatenate(([0], np.cumsum(lengths))), values)
            is_wrong |= is_wrong_list
        elif row.name != "vehicle":
            if row.type == FieldDescriptor.TYPE_STRING:
                values, is_wrong_text = data.texts(begin, after)
                is_wrong |= is_wrong_text
            fields[row.name] = np.full(len(at), defaults.get(row.name, 0), values.dtype)
            fields[row.name][rows] = values
        is_odd[rows] |= is_wrong
        at[rows] = after
    is_odd |= at != ends
    for first, name in layout.form.columns:
        is_odd |= np.diff(lists[first].offsets) != np.diff(lists[name].offsets)
    for name, words in layout.form.words:
        if unknown := set(fields[name]) - words:
            is_odd |= np.isin(fields[name], list(unknown))
    columns = Columns("", layout.topic, messages.order, messages.logged_at, fields, lists)
    return columns, is_odd


class _WireData:
    """Bytes that hold messages at known places."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        self._bytes = np.frombuffer(self.content, np.uint8)
        self._texts: dict[bytes, str | None] = {}

    def has_tag(self, tag: bytes, at: Integers) -> Flags:
        is_there: Flags = self._bytes[at] == tag[0]
        for number, byte in enumerate(tag[1:], 1):
            is_there &= self._bytes[at + number] == byte
        return is_there

    def span(self, row: _Field, at: Integers) -> tuple[Array, Integers, Integers]:
        """Numbers, and the places of the contents and after them; a text has its length."""
        if row.wire_type == _DOUBLE:
            return numbers_at(self.content, "<f8", at), at, at + 8
        values, after = self._varints(at)
        if row.wire_type == _VARINT:
            return _typed(row, values), at, after
        lengths = np.minimum(values.view(np.uint64), len(self.content)).astype(np.int64)
        return values, after, after + lengths

    def _varints(self, places: Integers) -> tuple[Integers, Integers]:
        """Integers of variable length at `places`, and the places after them."""
        byte = self._bytes[places]
        values, after = (byte & _LOW_BITS).astype(np.int64), places + 1
        rows, shift = np.flatnonzero(byte > _LOW_BITS), 7
        while len(rows) and shift < _VARINT_BITS:
            byte = self._bytes[after[rows]]
            values[rows] |= (byte & _LOW_BITS).astype(np.int64) << shift
            after[rows] += 1
            rows, shift = rows[byte > _LOW_BITS], shift + 7
        after[rows] = len(self.content)  # longer than any integer
        return values, after

    def texts(self, starts: Integers, ends: Integers) -> tuple[Array, Flags]:
        """Printable texts, and which of them are not UTF-8. Equal texts are one object."""
        content, known = self.content, self._texts
        spans = zip(starts.tolist(), ends.tolist(), strict=True)
        raws = [content[start:end] for start, end in spans]
        for raw in set(raws) - known.keys():
            try:
                known[raw] = printable(raw.decode())
            except UnicodeDecodeError:
                known[raw] = None
        texts = [known[raw] for raw in raws]
        return np.array(texts, object), np.array([text is None for text in texts], bool)

    def packed(
        self, row: _Field, starts: Integers, ends: Integers
    ) -> tuple[Integers, Array, Flags]:
        """Lengths of packed lists, their joined values, and which of the lists are wrong."""
        sizes = ends - starts
        if row.type == FieldDescriptor.TYPE_DOUBLE:
            values = numbers_at(self.content, "<f8", ranges(starts, sizes // 8, 8))
            return sizes // 8, values, sizes % 8 != 0
        places = ranges(starts, sizes, 1)
        is_last = self._bytes[places] <= _LOW_BITS
        lasts = np.concatenate(([0], np.cumsum(is_last)))
        row_ends = np.cumsum(sizes)
        lengths = lasts[row_ends] - lasts[row_ends - sizes]
        is_wrong = (sizes > 0) & (self._bytes[ends - 1] > _LOW_BITS)
        if is_wrong.any():  # values run into each other
            return np.zeros_like(lengths), np.zeros(0, np.int64), np.ones_like(is_wrong)
        begins = places[np.concatenate(([True], is_last))[: len(places)]]
        values, _ = self._varints(begins)
        return lengths, _typed(row, values), is_wrong


def _typed(row: _Field, values: Integers) -> Array:
    """Integers or truth values of a field."""
    if row.type == FieldDescriptor.TYPE_BOOL:
        is_true: Flags = values != 0
        return is_true
    if row.type == FieldDescriptor.TYPE_SINT32:  # zigzag: 0, -1, 1, -2 …
        return (values >> 1) ^ -(values & 1)
    return values
