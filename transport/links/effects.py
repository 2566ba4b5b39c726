"""The impairments of a directed link, each small and pure; a link is a chain of them."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

from transport.reasons import DropReason

Uniform = Callable[[str], float]
"""Draws a number in (0, 1) for a purpose; the same purpose gives the same number."""


class Effect(Protocol):
    """One impairment of a link; delays of several effects add up, any drop wins.

    A verdict must not depend on which messages came before. An effect with memory, such as a
    Gilbert–Elliott chain, has to be a function of `seq` all the same: its state at `seq` follows
    from the keyed draws of all numbers up to it, those that never came included.
    """

    def judge(self, uniform: Uniform, seq: int) -> int | DropReason:
        """Return the delay that this effect adds, in ns, or the word for why it drops `seq`."""


@dataclass(frozen=True, slots=True)
class Decimation:
    """Carries `kept` of the source's messages, evenly spread and starting with the first.

    `kept` is link rate over source rate: 1/2 lets 0, 2, 4 … through, 2/3 lets 0, 2, 3, 5, 6 … .
    """

    kept: Fraction

    def judge(self, uniform: Uniform, seq: int) -> int | DropReason:  # noqa: ARG002 - chance has no part
        """Drop `seq` unless the link's own count of messages steps on with it."""
        top, bottom = self.kept.numerator, self.kept.denominator
        # Message j of the link is the first of the source at or after the link's j-th period.
        return 0 if seq * top // bottom > (seq - 1) * top // bottom else "rate"


@dataclass(frozen=True, slots=True)
class Loss:
    """Loses each message on its own with probability `ratio` (Bernoulli)."""

    ratio: float

    def judge(self, uniform: Uniform, seq: int) -> int | DropReason:  # noqa: ARG002 - keyed by uniform
        """Drop when the message's draw falls below the ratio."""
        return "loss" if uniform("loss") < self.ratio else 0


@dataclass(frozen=True, slots=True)
class Latency:
    """Delays every message by `floor` ns."""

    floor: int

    def judge(self, uniform: Uniform, seq: int) -> int | DropReason:  # noqa: ARG002 - constant
        """Delay by the floor."""
        return self.floor


@dataclass(frozen=True, slots=True)
class Jitter:
    """Delays each message by its own draw, uniform between 0 and `spread` ns."""

    spread: int

    def judge(self, uniform: Uniform, seq: int) -> int | DropReason:  # noqa: ARG002 - keyed by uniform
        """Delay by the message's draw."""
        return round(uniform("jitter") * self.spread)
