"""Table of the reasons for unused poses; links, recorder, figures, picture and reference read it.

A link drops messages; its verdicts are logged. A receiver refuses messages that cannot be poses of
the run or overflow its queue; they are counted.
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


@dataclass(frozen=True, slots=True)
class Reason:
    """One reason, and whether such messages count as lost or as late."""

    word: DropReason | RefusalReason
    counts_as_loss: bool
    counts_as_late: bool
    meaning: str

    @property
    def is_drop(self) -> bool:
        return self.word in get_args(DropReason)


# fmt: off
_ROWS = (
    #      word               loss   late   meaning
    Reason("rate",            False, False, "the link carries fewer messages than are sent"),
    Reason("transmitter_off", True,  False, "the sender's transmitter was off"),
    Reason("receiver_off",    True,  False, "the receiver's radio was off"),
    Reason("outage",          True,  False, "sent during an outage of the link"),
    Reason("cut",             True,  False, "sent while the link was cut by a change to the run"),
    Reason("loss",            True,  False, "random loss: independent of other messages"),
    Reason("burst",           True,  False, "lost in a burst (Markov chain)"),
    Reason("pattern",         True,  False, "lost by its number: listed, every n-th or recorded"),
    Reason("collision",       True,  False, "radio resource was also used by another sender"),
    Reason("range",           True,  False, "signal too weak over the distance or behind vehicles"),
    Reason("queue",           True,  False, "the sender's queue was full"),
    Reason("corrupted",       True,  False, "altered by the link, rejected by checksum or content"),
    Reason("garbage",         False, False, "bytes are not a complete message of the topic"),
    Reason("oversized",       False, False, "larger than any message of the topic"),
    Reason("unknown",         False, False, "unknown topic, or no link from the sender"),
    Reason("foreign",         False, False, "names another vehicle than its key, or another run"),
    Reason("reserved",        False, False, "sent under the recorder's name"),
    Reason("absurd",          False, False, "a value is out of range or not finite"),
    Reason("far",             False, False, "more than 100 km from the scenario's origin"),
    Reason("early",           False, False, "measured before the start of the run"),
    Reason("past",            False, True,  "measured more than 60 s ago"),
    Reason("future",          False, False, "measured more than 60 s ahead"),
    Reason("sequence",        False, False, "numbered ahead of the sender's schedule"),
    Reason("duplicate",       False, False, "number was received before"),
    Reason("overflow",        False, False, "the receiver's queue was full"),
)
# fmt: on
REASONS: Mapping[str, Reason] = {row.word: row for row in _ROWS}


def counts_as_loss(word: str) -> bool:
    """Whether messages dropped for this reason count as lost; unknown reasons of later logs do."""
    reason = REASONS.get(word)
    return reason is None or reason.counts_as_loss


def counts_as_late(word: str) -> bool:
    """Whether messages refused for this reason count as late."""
    reason = REASONS.get(word)
    return reason is not None and reason.counts_as_late
