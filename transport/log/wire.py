"""Decodes the fields of many Protobuf messages of one type at once.

Field by field, one array operation reads the value of all messages. The fields of a message must
come in the order of their numbers, as every serializer writes them; other messages are reported,
and the caller decodes them one by one. Encoding: Protocol Buffers documentation, "Encoding".
"""

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from numpy.typing import NDArray

from transport.columns import Array, Integers, ranges

Flags = NDArray[np.bool_]

_VARINT, _DOUBLE, _SIZED = 0, 1, 2
"""Wire types: integers of variable length, 8 bytes, and a length before the content."""
_WIRE_TYPES = {
    FieldDescriptor.TYPE_DOUBLE: _DOUBLE,
    FieldDescriptor.TYPE_INT64: _VARINT,
    FieldDescriptor.TYPE_UINT64: _VARINT,
    FieldDescriptor.TYPE_UINT32: _VARINT,
    FieldDescriptor.TYPE_SINT32: _VARINT,
    FieldDescriptor.TYPE_BOOL: _VARINT,
    FieldDescriptor.TYPE_STRING: _SIZED,
}
_VARINT_BYTES_MAX = 10
_LOW_BITS = 0x7F
"""Bits of a byte of an integer; a larger byte is followed by another one."""
_PADDING = bytes(16)
"""Bytes after the data, so that a message that ends too early can be read beyond its end."""


class WireField(NamedTuple):
    """A field of a message type, with the bytes before its value."""

    name: str
    type: int
    repeated: bool
    wire_type: int
    tag: bytes


def wire_fields(message_type: Descriptor) -> tuple[WireField, ...]:
    """Fields of a message type in the order of their numbers; numbers are at most 2047."""
    described = []
    for row in sorted(message_type.fields, key=lambda row: row.number):
        wire_type = _SIZED if row.is_repeated else _WIRE_TYPES[row.type]
        tag = row.number << 3 | wire_type
        packed = bytes([tag & _LOW_BITS | 0x80, tag >> 7] if tag > _LOW_BITS else [tag])
        described.append(WireField(row.name, row.type, row.is_repeated, wire_type, packed))
    return tuple(described)


@dataclass(slots=True)
class WireColumns:
    """Decoded fields of N messages.

    `values` has an array (N) for each single field: float64, int64 (also for unsigned fields), bool
    or object (str). `lists` has lengths (N) and joined values for each repeated field. `absent`
    lists the messages without a field, whose value is zero or empty. Messages with `is_odd` could
    not be decoded.
    """

    is_odd: Flags
    values: dict[str, Array] = field(default_factory=dict)
    lists: dict[str, tuple[Integers, Array]] = field(default_factory=dict)
    absent: dict[str, Flags] = field(default_factory=dict)


class WireData:
    """Bytes that hold messages at known places."""

    def __init__(self, data: bytes) -> None:
        self._raw = data + _PADDING
        self._bytes = np.frombuffer(self._raw, np.uint8)
        self._texts: dict[bytes, str] = {}

    def numbers(self, dtype: str, places: Integers) -> Array:
        """Little-endian numbers at `places` (bytes)."""
        size = np.dtype(dtype).itemsize
        shape = (len(self._raw) - size + 1,)
        at_every_byte: Array = np.ndarray(shape, dtype, self._raw, strides=(1,))
        numbers: Array = at_every_byte[places]
        return numbers

    def content(self, start: int, end: int) -> bytes:
        return self._raw[start:end]

    def decode(
        self,
        fields: tuple[WireField, ...],
        starts: Integers,
        ends: Integers,
        wanted: Collection[str],
    ) -> WireColumns:
        """Decode the `wanted` fields of the messages from `starts` to before `ends` (bytes)."""
        columns = WireColumns(np.zeros(len(starts), bool))
        at = starts.copy()
        for row in fields:
            present = self._has_tag(row, at, ends)
            rows: Any = slice(None)
            if not present.all():
                columns.absent[row.name] = ~present
                rows = np.flatnonzero(present)
            here, limit = at[rows] + len(row.tag), ends[rows]
            value, after = self._content(row, here)
            is_odd = after > limit
            after = np.minimum(after, limit)
            if row.name in wanted:
                is_odd |= self._add(columns, row, rows, value, after)
            columns.is_odd[rows] |= is_odd
            at[rows] = after
        columns.is_odd |= at != ends
        return columns

    def _has_tag(self, row: WireField, at: Integers, ends: Integers) -> Flags:
        present: Flags = at < ends
        for number, byte in enumerate(row.tag):
            present &= self._bytes[at + number] == byte
        return present

    def _content(self, row: WireField, here: Integers) -> tuple[Array, Integers]:
        """Integers, or places of other values, and the places after them."""
        if row.wire_type == _DOUBLE:
            return here, here + 8
        values, after = self._varints(here)
        if row.wire_type == _VARINT:
            return values, after
        lengths = np.minimum(values, len(self._raw)).astype(np.int64)
        return after, after + lengths

    def _add(
        self, columns: WireColumns, row: WireField, rows: Any, value: Array, after: Integers
    ) -> Flags:
        """Add the values of a field, present in `rows`; returns which of these are odd."""
        count, is_odd = len(columns.is_odd), np.zeros(len(value), bool)
        if row.repeated:
            lengths, is_odd, joined = self._packed(row, np.minimum(value, after), after)
            all_lengths = np.zeros(count, np.int64)
            all_lengths[rows] = lengths
            columns.lists[row.name] = all_lengths, joined
            return is_odd
        if row.type == FieldDescriptor.TYPE_STRING:
            texts = np.full(count, "", object)
            texts[rows], is_odd = self._strings(value, after)
            columns.values[row.name] = texts
            return is_odd
        numbers = self.numbers("<f8", value) if row.wire_type == _DOUBLE else _typed(row, value)
        values = np.zeros(count, numbers.dtype)
        values[rows] = numbers
        columns.values[row.name] = values
        return is_odd

    def _varints(self, places: Integers) -> tuple[NDArray[np.uint64], Integers]:
        """Integers of variable length at `places`, and the places after them."""
        values, after = np.zeros(len(places), np.uint64), places.copy()
        rows: Any = slice(None)
        for number in range(_VARINT_BYTES_MAX):
            part = self._bytes[after[rows]]
            values[rows] |= (part & _LOW_BITS).astype(np.uint64) << np.uint64(7 * number)
            after[rows] += 1
            goes_on = np.flatnonzero(part > _LOW_BITS)
            if not len(goes_on):
                return values, after
            rows = goes_on if number == 0 else rows[goes_on]
        after[rows] = len(self._raw)  # longer than any integer
        return values, after

    def _strings(self, starts: Integers, ends: Integers) -> tuple[Array, Flags]:
        """Texts, and which of them are not UTF-8. Equal texts are one object."""
        raw, known = self._raw, self._texts
        texts = np.empty(len(starts), object)
        is_odd = np.zeros(len(starts), bool)
        for number, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
            content = raw[start:end]
            text = known.get(content)
            if text is None:
                try:
                    text = known[content] = content.decode()
                except UnicodeDecodeError:
                    text, is_odd[number] = "", True
            texts[number] = text
        return texts, is_odd

    def _packed(
        self, row: WireField, starts: Integers, ends: Integers
    ) -> tuple[Integers, Flags, Array]:
        """Lengths of packed lists, which of them are odd, and their joined values."""
        if row.type == FieldDescriptor.TYPE_DOUBLE:
            sizes = ends - starts
            places = ranges(starts, sizes // 8, 8)
            return sizes // 8, sizes % 8 != 0, self.numbers("<f8", places)
        places = ranges(starts, ends - starts, 1)
        is_last = self._bytes[places] <= _LOW_BITS
        counts = np.concatenate(([0], np.cumsum(is_last)))
        row_ends = np.cumsum(ends - starts)
        row_starts = row_ends - (ends - starts)
        lengths = counts[row_ends] - counts[row_starts]
        is_odd = np.zeros(len(starts), bool)
        filled = row_ends > row_starts
        is_odd[filled] = ~is_last[row_ends[filled] - 1]
        begins = np.concatenate(([True], is_last[:-1]))[: len(places)]
        if is_odd.any():  # the caller decodes these messages
            return lengths, np.ones(len(starts), bool), np.zeros(int(lengths.sum()), np.int64)
        values, _ = self._varints(places[begins])
        return lengths, is_odd, _typed(row, values)


def _typed(row: WireField, values: NDArray[np.uint64]) -> Array:
    """Integers or truth values of a field."""
    if row.type == FieldDescriptor.TYPE_BOOL:
        return values.astype(bool)
    if row.type == FieldDescriptor.TYPE_SINT32:  # zigzag: 0, -1, 1, -2 …
        half = (values >> np.uint64(1)).astype(np.int64)
        half[(values & np.uint64(1)) != 0] ^= -1
        return half
    return values.view(np.int64)
