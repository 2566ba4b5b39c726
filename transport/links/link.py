"""What a directed radio link does to a message: a pure verdict, deliver at an instant or drop.

The verdict on message `seq` depends on the seed, the link and `seq` alone, never on the order in
which messages came, on other links or on whether `seq - 1` arrived. So a run on the wall clock and
a run in virtual time judge alike.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from hashlib import blake2b
from math import isfinite
from typing import Protocol

from vehicles.messages import Outcome

NS_PER_MS = 1_000_000
_STEPS = 2**52  # so that (k + 1/2) / _STEPS is exact in a double and lies strictly inside (0, 1)

Uniform = Callable[[str], float]
"""Draws a number in (0, 1) for a purpose; the same purpose gives the same number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkRule:
    """What is asked of one directed link.

    latency_ms    least delay from measurement to reception
    jitter_ms     further delay, uniform between 0 and this (so latency_ms stays the floor that the
                  real transport has to beat)
    loss_ratio    share of messages lost, each on its own (Bernoulli), 0 to 1
    rate_hz       messages a second that the link carries; None carries every message

    Raises ValueError for numbers outside these ranges.
    """

    latency_ms: float = 20.0
    jitter_ms: float = 0.0
    loss_ratio: float = 0.0
    rate_hz: float | None = None

    def __post_init__(self) -> None:
        for name in ("latency_ms", "jitter_ms"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0.0):
                raise ValueError(f"{name} is {value}; it must be a number of at least 0")
        if not 0.0 <= self.loss_ratio <= 1.0:
            raise ValueError(f"loss_ratio is {self.loss_ratio}; it must lie between 0 and 1")
        if self.rate_hz is not None and not (isfinite(self.rate_hz) and self.rate_hz > 0.0):
            raise ValueError(f"rate_hz is {self.rate_hz}; it must be greater than 0")


@dataclass(frozen=True, slots=True)
class Verdict:
    """The link's decision: `reason` is empty when delivered, otherwise one word.

    `visible_at` (ns) is the instant from which the receiver may know the message, or would have
    known it had it not been dropped.
    """

    outcome: Outcome
    reason: str
    visible_at: int


class Effect(Protocol):
    """One impairment of a link; delays of several effects add up, any drop wins.

    A verdict must not depend on which messages came before. An effect with memory, such as a
    Gilbert–Elliott chain, has to be a function of `seq` all the same: its state at `seq` follows
    from the keyed draws of all numbers up to it, those that never came included.
    """

    def judge(self, uniform: Uniform, seq: int) -> int | str:
        """Return the delay that this effect adds, in ns, or the word for why it drops `seq`."""


@dataclass(frozen=True, slots=True)
class Decimation:
    """Carries `kept` of the source's messages, evenly spread and starting with the first.

    `kept` is link rate over source rate: 1/2 lets 0, 2, 4 … through, 2/3 lets 0, 2, 3, 5, 6 … .
    """

    kept: Fraction

    def judge(self, uniform: Uniform, seq: int) -> int | str:  # noqa: ARG002 - chance has no part
        """Drop `seq` unless the link's own count of messages steps on with it."""
        top, bottom = self.kept.numerator, self.kept.denominator
        # Message j of the link is the first of the source at or after the link's j-th period.
        return 0 if seq * top // bottom > (seq - 1) * top // bottom else "rate"


@dataclass(frozen=True, slots=True)
class Loss:
    """Loses each message on its own with probability `ratio` (Bernoulli)."""

    ratio: float

    def judge(self, uniform: Uniform, seq: int) -> int | str:  # noqa: ARG002 - keyed by uniform
        """Drop when the message's draw falls below the ratio."""
        return "loss" if uniform("loss") < self.ratio else 0


@dataclass(frozen=True, slots=True)
class Latency:
    """Delays every message by `floor` ns."""

    floor: int

    def judge(self, uniform: Uniform, seq: int) -> int | str:  # noqa: ARG002 - constant
        """Delay by the floor."""
        return self.floor


@dataclass(frozen=True, slots=True)
class Jitter:
    """Delays each message by its own draw, uniform between 0 and `spread` ns."""

    spread: int

    def judge(self, uniform: Uniform, seq: int) -> int | str:  # noqa: ARG002 - keyed by uniform
        """Delay by the message's draw."""
        return round(uniform("jitter") * self.spread)


def effects(rule: LinkRule, source_rate_hz: float) -> tuple[Effect, ...]:
    """Return the impairments of `rule` for a sender of `source_rate_hz`; the first drop names."""
    found: list[Effect] = []
    if rule.rate_hz is not None and rule.rate_hz < source_rate_hz:
        found.append(Decimation(Fraction(rule.rate_hz) / Fraction(source_rate_hz)))
    if rule.loss_ratio > 0.0:
        found.append(Loss(rule.loss_ratio))
    found.append(Latency(round(rule.latency_ms * NS_PER_MS)))
    if rule.jitter_ms > 0.0:
        found.append(Jitter(round(rule.jitter_ms * NS_PER_MS)))
    return tuple(found)


def keyed_uniform(seed: int, sender: str, receiver: str, seq: int, purpose: str) -> float:
    """Return the number in (0, 1) that belongs to this key, the same on every platform."""
    key = "\0".join((str(seed), sender, receiver, str(seq), purpose)).encode()
    drawn = int.from_bytes(blake2b(key, digest_size=8).digest(), "big") >> 12
    return (drawn + 0.5) / _STEPS


def combine(chain: Iterable[Effect], uniform: Uniform, seq: int, measured_at: int) -> Verdict:
    """Let each effect judge message `seq`: delays add up, the first that drops names the reason."""
    delay, reason = 0, ""
    for effect in chain:
        judged = effect.judge(uniform, seq)
        if isinstance(judged, str):
            reason = reason or judged
        else:
            delay += judged
    return Verdict("dropped" if reason else "delivered", reason, measured_at + delay)


@dataclass(frozen=True, slots=True)
class Link:
    """A directed link of a run: judges the messages of one sender on their way to one receiver."""

    chain: tuple[Effect, ...]
    seed: int
    sender: str
    receiver: str

    def judge(self, seq: int, measured_at: int) -> Verdict:
        """Judge message `seq`, measured at `measured_at` (ns)."""
        uniform = partial(keyed_uniform, self.seed, self.sender, self.receiver, seq)
        return combine(self.chain, uniform, seq, measured_at)
