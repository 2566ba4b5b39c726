"""Messages made from columns, for figures that take messages."""

from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np

from transport.columns import Columns
from vehicles.messages import Message

Kind = TypeVar("Kind", bound=Message)
Entry = TypeVar("Entry")


def messages_of(columns: Columns, kind: type[Kind]) -> Iterator[Kind]:
    """Yield the messages of `columns`, without their lists."""
    names = list(columns.fields)
    for values in zip(*(columns[name].tolist() for name in names), strict=True):
        yield kind(vehicle=columns.vehicle, **dict(zip(names, values, strict=True)))


def in_order(
    columns: Sequence[Columns], sources: Sequence[Iterator[Entry]]
) -> Iterator[tuple[int, Entry]]:
    """Yield the next entry of the source of each message, in the order of the log.

    `sources` has an entry for each message of the `columns`; its place in the log comes with it.
    """
    order = np.concatenate([np.zeros(0, np.int64), *(rows.order for rows in columns)])
    by_order = np.argsort(order)
    numbers = np.repeat(np.arange(len(columns)), [len(rows) for rows in columns])[by_order]
    for place, number in zip(order[by_order].tolist(), numbers.tolist(), strict=True):
        yield place, next(sources[number])
