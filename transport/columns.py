"""Messages as columns: an array for each field, not an object for each message."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from transport.topics import TOPICS

Array = NDArray[Any]
Integers = NDArray[np.int64]

DEVIATION = "deviation"  # Topic of the true errors and gaps, which only the log has


def instant_of(topic: str) -> str:
    """Field with the instant at which a message of `topic` was valid."""
    return "true_at_ns" if topic == DEVIATION else TOPICS[topic].instant


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
        return self.fields[instant_of(self.topic)]


def ranges(starts: Integers, counts: Integers, step: int) -> Integers:
    """Join the ranges start, start + step, … of `counts` places."""
    before = np.cumsum(counts) - counts
    number = np.arange(int(counts.sum())) - np.repeat(before, counts)
    return np.repeat(starts, counts) + step * number
