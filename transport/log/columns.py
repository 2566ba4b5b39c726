"""Messages of a log by columns: an array for each field, not an object for each message."""

from collections.abc import Collection, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from transport.codec import MessageForm, RefusedMessageError, decode, form_of
from transport.columns import DEVIATION, Array, Columns, Integers, Lists, instant_of, ranges
from transport.convoy_pb2 import Deviation
from transport.log.errors import LogError
from transport.log.mcap_file import (
    CHANNELS,
    HEAD_BYTES,
    MESSAGE,
    MESSAGE_HEAD_BYTES,
    McapFile,
)
from transport.log.wire import (
    WireColumns,
    WireData,
    WireField,
    wire_fields,
)
from transport.texts import printable
from transport.topics import TOPICS

BATCH_BYTES = 2**24
"""Size of the messages that are decoded at once; limits the memory."""


class Selection(NamedTuple):
    """Messages to read.

    `fields` are the fields by topic, None for all; the instant of the message is always added.
    Vehicles None are all. `span_ns` is the first and the last instant of recording.
    """

    fields: Mapping[str, Collection[str] | None]
    vehicles: Collection[str] | None = None
    span_ns: tuple[int, int] | None = None


@dataclass(frozen=True, slots=True)
class _Layout:
    """Fields of the messages of a topic; the deviation has no message class, so no `form`."""

    topic: str
    instant: str
    wire: tuple[WireField, ...]
    form: MessageForm | None

    def wanted(self, names: Collection[str] | None) -> frozenset[str]:
        """Fields to decode; raises ValueError for an unknown name."""
        known = {row.name for row in self.wire} - {"vehicle"}
        if names is None:
            return frozenset(known)
        if unknown := set(names) - known:
            raise ValueError(f"topic {self.topic} has no field {', '.join(sorted(unknown))}")
        tables = self.form.columns if self.form else []
        firsts = {first for first, name in tables if name in names}
        return frozenset({*names, *firsts, self.instant})

    def decode(self, data: bytes) -> Any:
        """Decode one message; raises RefusedMessageError."""
        return decode(TOPICS[self.topic], data) if self.form else Deviation.FromString(data)


@cache
def _layout(topic: str) -> _Layout:
    form = None if topic == DEVIATION else form_of(TOPICS[topic].message)
    protobuf = form.protobuf if form else Deviation
    return _Layout(topic, instant_of(topic), wire_fields(protobuf.DESCRIPTOR), form)


def read_columns(
    file: McapFile, channels: Mapping[int, tuple[str, str]], selection: Selection
) -> dict[tuple[str, str], Columns]:
    """Read messages by (vehicle, topic); `channels` are these by channel number.

    Only the chunks within the span are read. Raises LogError for a message that its topic refuses.
    """
    chosen = {
        number: key
        for number, key in channels.items()
        if key[1] in selection.fields
        and (selection.vehicles is None or key[0] in selection.vehicles)
    }
    parts: dict[tuple[str, str], list[_Part]] = {key: [] for key in chosen.values()}
    for batch in _batches(file, chosen.keys(), selection.span_ns):
        for topic in {topic for _, topic in parts}:
            numbers = {number: key for number, key in chosen.items() if key[1] == topic}
            wanted = _layout(topic).wanted(selection.fields[topic])
            try:
                for key, part in _decode(batch, _layout(topic), wanted, numbers):
                    parts[key].append(part)
            except RefusedMessageError as error:
                raise LogError(f"{file.path}: topic {topic}: {error}") from error
    # Parts are released one by one: together they are as large as the result.
    return {key: _joined(key, parts.pop(key)) for key in list(parts)}


class _Batch(NamedTuple):
    """Bytes of several chunks; place in the log, channel and instant of recording by message."""

    data: WireData
    order: Integers
    channels: Integers
    logged_at: Integers
    starts: Integers
    ends: Integers

    def of(self, rows: Array) -> "_Batch":
        return self._replace(
            order=self.order[rows],
            channels=self.channels[rows],
            logged_at=self.logged_at[rows],
            starts=self.starts[rows],
            ends=self.ends[rows],
        )


class _Chunk(NamedTuple):
    """Records of a chunk and their places in it; `before` are the unpacked bytes before it."""

    before: int
    content: bytes
    records: Integers


def _batches(file: McapFile, channels: Set[int], span: tuple[int, int] | None) -> Iterator[_Batch]:
    """Yield the messages of the chunks that may hold messages to read."""
    chunks: list[_Chunk] = []
    before = size = 0
    for number, head in enumerate(file.chunks):
        is_within = span is None or (head.first_at <= span[1] and head.last_at >= span[0])
        if is_within and file.may_hold(head, channels):
            content = file.unpack(head)
            chunks.append(_Chunk(before, content, file.record_starts(number, content)))
            size += head.size
        before += head.size
        if size > BATCH_BYTES:
            yield _batch(chunks, span)
            chunks, size = [], 0
    yield _batch(chunks, span)


def _batch(chunks: Sequence[_Chunk], span: tuple[int, int] | None) -> _Batch:
    """Messages of chunks, in the order of the log."""
    places, shifts, size = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], 0
    for chunk in chunks:
        places.append(chunk.records + size)
        shifts.append(np.full(len(chunk.records), chunk.before - size))
        size += len(chunk.content)
    starts = np.concatenate(places)
    data = WireData(b"".join(chunk.content for chunk in chunks))
    is_message = data.numbers("u1", starts) == MESSAGE
    heads = starts[is_message]
    contents = heads + HEAD_BYTES
    batch = _Batch(
        data,
        order=heads + np.concatenate(shifts)[is_message],
        channels=data.numbers("<u2", contents).astype(np.int64),
        logged_at=data.numbers("<i8", contents + 6),
        starts=contents + MESSAGE_HEAD_BYTES,
        ends=contents + data.numbers("<i8", heads + 1),
    )
    if span is None:
        return batch
    return batch.of((batch.logged_at >= span[0]) & (batch.logged_at <= span[1]))


@dataclass(slots=True)
class _Part:
    """Rows of one vehicle and topic; the lists by their lengths and joined values."""

    order: Integers
    logged_at: Integers
    values: dict[str, Array]
    lists: dict[str, tuple[Integers, Array]]


def _decode(
    batch: _Batch,
    layout: _Layout,
    wanted: frozenset[str],
    numbers: Mapping[int, tuple[str, str]],
) -> Iterator[tuple[tuple[str, str], _Part]]:
    """Decode the messages of a topic in a batch, and split them by vehicle."""
    keys = list(dict.fromkeys(numbers.values()))
    place = np.full(CHANNELS, -1, np.int64)
    for number, key in numbers.items():
        place[number] = keys.index(key)
    batch = batch.of(place[batch.channels] >= 0)
    owners = place[batch.channels]
    columns = batch.data.decode(layout.wire, batch.starts, batch.ends, wanted)
    _complete(columns, layout, wanted, batch)
    for number, key in enumerate(keys):
        rows = np.flatnonzero(owners == number)
        values = {name: array[rows] for name, array in columns.values.items()}
        lists = {}
        for name, (lengths, joined) in columns.lists.items():
            first = np.cumsum(lengths) - lengths
            lists[name] = lengths[rows], joined[ranges(first[rows], lengths[rows], 1)]
        yield key, _Part(batch.order[rows], batch.logged_at[rows], values, lists)


def _complete(columns: WireColumns, layout: _Layout, wanted: frozenset[str], batch: _Batch) -> None:
    """Fill absent fields with their defaults, and check and escape texts.

    Messages that cannot be decoded by columns are decoded one by one.
    """
    form = layout.form
    for name, absent in columns.absent.items():
        if form and name in form.lists:
            continue
        if form is None or name not in form.defaults:
            columns.is_odd |= absent
        elif name in wanted:
            columns.values[name][absent] = form.defaults[name]
    for first, name in form.columns if form else ():
        if name in wanted:
            columns.is_odd |= columns.lists[first][0] != columns.lists[name][0]
    if columns.is_odd.any():
        _patch(columns, layout, batch)
    if form:
        _check_texts(form, columns.values)


def _check_texts(form: MessageForm, values: Mapping[str, Array]) -> None:
    """Escape control characters of foreign texts; raises RefusedMessageError for unknown words."""
    for name in values.keys() & set(form.texts):
        texts = values[name]
        hidden = {text: printable(text) for text in set(texts) if not text.isprintable()}
        for row in np.flatnonzero([text in hidden for text in texts]) if hidden else ():
            texts[row] = hidden[texts[row]]
    for name, words in form.words:
        if unknown := set(values.get(name, ())) - words:
            raise RefusedMessageError("garbage", f"{name} is {unknown.pop()!r}")


def _patch(columns: WireColumns, layout: _Layout, batch: _Batch) -> None:
    """Decode the odd messages one by one."""
    rows = np.flatnonzero(columns.is_odd).tolist()
    starts, ends = batch.starts.tolist(), batch.ends.tolist()
    messages = [layout.decode(batch.data.content(starts[row], ends[row])) for row in rows]
    for name, values in columns.values.items():
        values[rows] = [getattr(message, name) for message in messages]
    for name, (lengths, joined) in columns.lists.items():
        pieces = np.split(joined, np.cumsum(lengths)[:-1])
        for row, message in zip(rows, messages, strict=True):
            pieces[row] = np.array(getattr(message, name), joined.dtype)
        new_lengths = np.array([len(piece) for piece in pieces], np.int64)
        columns.lists[name] = new_lengths, np.concatenate(pieces)


def _joined(key: tuple[str, str], parts: Sequence[_Part]) -> Columns:
    first = parts[0]
    lists = {}
    for name in first.lists:
        lengths = np.concatenate([part.lists[name][0] for part in parts])
        offsets = np.concatenate(([0], np.cumsum(lengths)))
        lists[name] = Lists(offsets, np.concatenate([part.lists[name][1] for part in parts]))
    return Columns(
        *key,
        order=np.concatenate([part.order for part in parts]),
        logged_at_ns=np.concatenate([part.logged_at for part in parts]),
        fields={
            name: np.concatenate([part.values[name] for part in parts]) for name in first.values
        },
        lists=lists,
    )
