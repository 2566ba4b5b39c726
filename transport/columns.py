"""Messages as columns: an array for each field, not an object for each message."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from transport.topics import TOPICS

Array = NDArray[Any]
Integers = NDArray[np.int64]

DEVIATION = "deviation"
"""Topic of the true errors and gaps, which only the log has."""


def instant_of(topic: str) -> str:
    """Field with the instant at which a message of `topic` was valid."""
    return "true_at_ns" if topic == DEVIATION else TOPICS[topic].instant


class Lists(NamedTuple):
    """A field with a list of values in each message: row k is `values[offsets[k]:offsets[k + 1]]`.

    Shapes: offsets (N + 1), values (sum of the lengths).
    """

    offsets: Integers
    values: Array


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

    `lists` has the fields with several values in each message. A field that the log lacks, because
    an earlier version wrote it, has the default of the message class. `logged_at_ns` are the
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
        """Array of a field with one value in each message."""
        return self.fields[name]

    @property
    def at_ns(self) -> Integers:
        """Instants at which the messages were valid."""
        return self.fields[instant_of(self.topic)]
