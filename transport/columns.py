"""Messages as columns: an array for each field, not an object for each message."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain
from operator import attrgetter
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from transport.topics import TOPICS

Array = NDArray[Any]
Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Lists(NamedTuple):
    """A field with a list of values in each message: row k is `values[offsets[k]:offsets[k + 1]]`.

    Shapes: offsets (N + 1), values (sum of the lengths).
    """

    offsets: Integers
    values: Array

    def of(self, rows: Integers) -> "Lists":
        lengths = np.diff(self.offsets)[rows]
        offsets = np.concatenate(([0], np.cumsum(lengths)))
        return Lists(offsets, self.values[ranges(self.offsets[rows], lengths, 1)])


@dataclass(frozen=True, slots=True)
class Columns:
    """Messages of one topic of one vehicle, one row per message in the order of the log.

    `fields` has an array (N) for each field with the name and unit of the message's:

    | field          | array                                     |
    | -------------- | ----------------------------------------- |
    | float          | float64                                   |
    | FloatOrNan     | float64, NaN where the value is unknown   |
    | int            | int64, also instants (ns)                 |
    | bool           | bool                                      |
    | str or Literal | object (str); equal texts are one object  |

    `lists` has the fields with several values in each message. A field that the log lacks has
    the default of the message class. `logged_at_ns` are the
    instants of recording. `order` are places in the log, which grow from message to message of all
    topics. The field `vehicle` is left out.
    """

    vehicle: str
    topic: str
    order: Integers
    logged_at_ns: Integers
    fields: Mapping[str, Array]
    lists: Mapping[str, Lists]

    def __len__(self) -> int:
        return len(self.logged_at_ns)

    def __getitem__(self, name: str) -> Array:
        return self.fields[name]

    def of(self, rows: Array) -> "Columns":
        numbers = np.flatnonzero(rows) if rows.dtype == bool else rows
        return replace(
            self,
            order=self.order[numbers],
            logged_at_ns=self.logged_at_ns[numbers],
            fields={name: array[numbers] for name, array in self.fields.items()},
            lists={name: lists.of(numbers) for name, lists in self.lists.items()},
        )

    @property
    def at_ns(self) -> Integers:
        return self.fields[TOPICS[self.topic].instant]


def ranges(starts: Integers, counts: Integers, step: int) -> Integers:
    """Join the ranges start, start + step, … of `counts` places."""
    before = np.cumsum(counts) - counts
    number = np.arange(int(counts.sum())) - np.repeat(before, counts)
    return np.repeat(starts, counts) + step * number


# ---- Tables of messages in memory


_TYPES: Mapping[Any, type] = {float: np.float64, int: np.int64, bool: np.bool_}


class FieldType(NamedTuple):
    """Type of the values of a field in NumPy; `is_list`: several values in each message."""

    kind: type
    is_list: bool


@cache
def field_types(topic: str) -> Mapping[str, FieldType]:
    """Types of the fields of the messages of a topic, without `vehicle`."""
    types = {}
    for name, hint in get_type_hints(TOPICS[topic].message).items():
        is_list = get_origin(hint) is tuple
        kind = _TYPES.get(get_args(hint)[0] if is_list else hint, object)
        types[name] = FieldType(kind, is_list)
    del types["vehicle"]
    return types


def columns_from(
    topic: str, messages: Sequence[Any], logged_at_ns: Sequence[int], vehicle: str = ""
) -> Columns:
    """Columns of messages of one topic in memory, each recorded at its instant (ns)."""
    fields: dict[str, Array] = {}
    lists: dict[str, Lists] = {}
    for name, (kind, is_list) in field_types(topic).items():
        values = list(map(attrgetter(name), messages))
        if is_list:
            offsets = np.concatenate(([0], np.cumsum(list(map(len, values)), dtype=np.int64)))
            lists[name] = Lists(offsets, np.array(list(chain.from_iterable(values)), kind))
        else:
            fields[name] = np.array(values, kind)
    at_ns = np.array(logged_at_ns, np.int64)
    return Columns(vehicle, topic, np.arange(len(at_ns)), at_ns, fields, lists)


def joined(parts: Sequence[Columns]) -> Columns:
    """Join columns of one topic and vehicle, one below the other."""
    first, lists = parts[0], {}
    if len(parts) == 1:
        return first
    for name in first.lists:
        lengths = np.concatenate([np.diff(part.lists[name].offsets) for part in parts])
        values = np.concatenate([part.lists[name].values for part in parts])
        lists[name] = Lists(np.concatenate(([0], np.cumsum(lengths))), values)
    return replace(
        first,
        order=np.concatenate([part.order for part in parts]),
        logged_at_ns=np.concatenate([part.logged_at_ns for part in parts]),
        fields={name: np.concatenate([part[name] for part in parts]) for name in first.fields},
        lists=lists,
    )
