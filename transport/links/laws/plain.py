"""The plain laws of a link: rate, independent loss, constant latency, uniform jitter."""

from dataclasses import dataclass
from fractions import Fraction

from transport.links.laws.effect import Draw, Passage
from transport.reasons import DropReason


@dataclass(frozen=True, slots=True)
class Decimation:
    """Carries `kept` of the source's messages, evenly spread and starting with the first.

    `kept` is link rate over source rate: 1/2 lets 0, 2, 4 … through, 2/3 lets 0, 2, 3, 5, 6 … .
    """

    kept: Fraction

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop the message unless the link's own count of messages steps on with it."""
        seq, top, bottom = passage.seq, self.kept.numerator, self.kept.denominator
        # Message j of the link is the first of the source at or after the link's j-th period.
        return 0 if seq * top // bottom > (seq - 1) * top // bottom else "rate"


@dataclass(frozen=True, slots=True)
class Loss:
    """Loses each message on its own with probability `ratio` (Bernoulli)."""

    ratio: float

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:
        """Drop when the message's draw falls below the ratio."""
        return "loss" if draw("loss", passage.seq) < self.ratio else 0


@dataclass(frozen=True, slots=True)
class Latency:
    """Delays every message by `floor` ns."""

    floor: int

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:  # noqa: ARG002 - constant
        """Delay by the floor."""
        return self.floor


@dataclass(frozen=True, slots=True)
class Jitter:
    """Delays each message by its own draw, uniform between 0 and `spread` ns."""

    spread: int

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:
        """Delay by the message's draw."""
        return round(draw("jitter", passage.seq) * self.spread)
