"""Reasons for unused poses as a table: links, recorder, figures, picture and reference read it.

A link drops a message by its verdict, which is logged. Messages that cannot be poses of the run, or
overflow the receiver's queue, are refused there and counted.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

DropReason = Literal[
    "rate",
    "transmitter_off",
    "receiver_off",
    "outage",
    "cut",
    "loss",
    "burst",
    "pattern",
    "collision",
    "range",
    "queue",
    "corrupted",
]
"""Words of a link that drops a message."""

RefusalReason = Literal[
    "garbage",
    "oversized",
    "unknown",
    "foreign",
    "reserved",
    "absurd",
    "far",
    "early",
    "past",
    "future",
    "sequence",
    "duplicate",
    "overflow",
]
"""Words of a receiver, vehicle or recorder, that refuses a message."""


@dataclass(frozen=True, slots=True)
class Reason:
    """One row: a word, its meaning, and whether such a message counts as lost or as late."""

    word: DropReason | RefusalReason
    counts_as_loss: bool
    counts_as_late: bool
    meaning: str

    @property
    def is_drop(self) -> bool:
        """Whether a link gives this reason, rather than a receiver."""
        return self.word in get_args(DropReason)


# fmt: off
_ROWS = (
    #      word               loss   late   meaning
    Reason("rate",            False, False, "the link's own rate does not carry it"),
    Reason("transmitter_off", True,  False, "the sender's transmitter was off"),
    Reason("receiver_off",    True,  False, "the receiver's own receiver was off"),
    Reason("outage",          True,  False, "sent when or where the link carries nothing"),
    Reason("cut",             True,  False, "sent while the link was cut by a change to the run"),
    Reason("loss",            True,  False, "lost on the link"),
    Reason("burst",           True,  False, "lost by a link that loses several in a row"),
    Reason("pattern",         True,  False, "lost by its number: listed, every n-th, or on record"),
    Reason("collision",       True,  False, "sent in a resource that another sender had, too"),
    Reason("range",           True,  False, "too far, or too weak behind other vehicles"),
    Reason("queue",           True,  False, "more waited to be sent than the link's queue holds"),
    Reason("corrupted",       True,  False, "altered on the link, and refused for that"),
    Reason("garbage",         False, False, "the bytes are no whole message of the topic"),
    Reason("oversized",       False, False, "larger than any message of the topic"),
    Reason("unknown",         False, False, "under a key without a subscriber"),
    Reason("foreign",         False, False, "names another vehicle than its key"),
    Reason("reserved",        False, False, "in the recorder's own name"),
    Reason("absurd",          False, False, "a number that no vehicle measures, or none at all"),
    Reason("far",             False, False, "more than 100 km from the scenario's origin"),
    Reason("early",           False, False, "measured before the run started"),
    Reason("past",            False, True,  "measured more than 60 s ago"),
    Reason("future",          False, False, "measured more than 60 s ahead"),
    Reason("sequence",        False, False, "numbered ahead of the sender's schedule"),
    Reason("duplicate",       False, False, "the number was received before"),
    Reason("overflow",        False, False, "more than the receiver's queue holds"),
)
# fmt: on
REASONS: Mapping[str, Reason] = {row.word: row for row in _ROWS}


def counts_as_loss(word: str) -> bool:
    """Whether a message dropped for this reason is lost; so are unknown ones of later logs."""
    reason = REASONS.get(word)
    return reason is None or reason.counts_as_loss


def counts_as_late(word: str) -> bool:
    """Whether a message refused for this reason came too late."""
    reason = REASONS.get(word)
    return reason is not None and reason.counts_as_late
