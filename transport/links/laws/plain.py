"""The plain effects of a link: rate, a cut, independent loss, constant latency, uniform jitter."""

from dataclasses import dataclass
from fractions import Fraction
from math import inf

from transport.links.laws.effect import Draw, Effect, TransmissionContext
from transport.links.laws.moments import Delays
from transport.reasons import DropReason
from vehicles.schedule import MILLISECOND


@dataclass(frozen=True, slots=True)
class Decimation(Effect):
    """Carries `kept` of the source's messages, evenly spread and starting with the first.

    `kept` is link rate over source rate: 1/2 lets 0, 2, 4 … through, 2/3 lets 0, 2, 3, 5, 6 … .
    """

    kept: Fraction

    key = "rate_hz"
    reason = "rate"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop the message unless the link's own count of messages steps on with it."""
        seq, top, bottom = context.seq, self.kept.numerator, self.kept.denominator
        # Message j of the link is the first of the source at or after the link's j-th period.
        return 0 if seq * top // bottom > (seq - 1) * top // bottom else "rate"

    def describe(self) -> str:
        """Give the share of messages carried."""
        return f"rate: {self.kept.numerator} of {self.kept.denominator} messages carried"


@dataclass(frozen=True, slots=True)
class Cut(Effect):
    """Carries nothing, as long as the link is cut."""

    key = "cut"
    reason = "cut"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop the message."""
        return "cut"

    @property
    def mean_loss_ratio(self) -> float:
        """All are lost."""
        return 1.0

    @property
    def mean_burst_messages(self) -> float:
        """It never stops by itself."""
        return inf

    def describe(self) -> str:
        """Name it."""
        return "cut"


@dataclass(frozen=True, slots=True)
class Loss(Effect):
    """Loses each message on its own with probability `ratio` (Bernoulli)."""

    ratio: float

    key = "loss_ratio"
    reason = "loss"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        """Drop when the message's draw falls below the ratio."""
        return "loss" if draw("loss", context.seq) < self.ratio else 0

    @property
    def mean_loss_ratio(self) -> float:
        """Share of messages lost."""
        return self.ratio

    @property
    def mean_burst_messages(self) -> float | None:
        """Mean of a geometric distribution."""
        if not self.ratio:
            return None
        return 1.0 / (1.0 - self.ratio) if self.ratio < 1.0 else inf

    def describe(self) -> str:
        """Name the law and its loss."""
        return f"independent loss {self.ratio:.4g}"


@dataclass(frozen=True, slots=True)
class Latency(Effect):
    """Delays every message by `floor` ns."""

    floor: int

    key = "latency_ms"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:  # noqa: ARG002 - constant
        """Delay by the floor."""
        return self.floor

    @property
    def delays(self) -> Delays:
        """The floor."""
        return Delays(float(self.floor), 0.0)

    def describe(self) -> str:
        """Name the law and its delay."""
        return f"latency {self.floor / MILLISECOND:g} ms"


@dataclass(frozen=True, slots=True)
class Jitter(Effect):
    """Delays each message by its own draw, uniform between 0 and `spread` ns."""

    spread: int

    key = "jitter_ms"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        """Delay by the message's draw."""
        return round(draw("jitter", context.seq) * self.spread)

    @property
    def delays(self) -> Delays:
        """Moments of a uniform distribution."""
        return Delays(0.5 * self.spread, self.spread**2 / 12.0)

    def delay_quantile(self, share: float) -> float:
        """Share of the spread."""
        return share * self.spread

    def describe(self) -> str:
        """Name the law and its largest delay."""
        return f"jitter up to {self.spread / MILLISECOND:g} ms, uniform"
