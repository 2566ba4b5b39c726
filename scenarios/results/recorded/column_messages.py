"""Messages made from columns, for figures that take messages."""

from collections.abc import Iterator
from typing import TypeVar

from transport.columns import Columns
from vehicles.messages import Message

Kind = TypeVar("Kind", bound=Message)


def messages_of(columns: Columns, kind: type[Kind]) -> Iterator[Kind]:
    """Yield the messages of `columns`, without their lists."""
    names = list(columns.fields)
    for values in zip(*(columns[name].tolist() for name in names), strict=True):
        yield kind(vehicle=columns.vehicle, **dict(zip(names, values, strict=True)))
