"""Basic effects of a link: rate, cut, independent loss, constant latency, uniform jitter."""

from dataclasses import dataclass
from fractions import Fraction

from transport.links.laws.effect import Draw, Effect, TransmissionContext
from transport.links.laws.moments import Delays, Losses
from transport.reasons import DropReason
from vehicles.schedule import MILLISECOND


@dataclass(frozen=True, slots=True)
class Decimation(Effect):
    """Carries the share `kept` of the messages, evenly spaced and starting with the first.

    `kept` is link rate over source rate: 1/2 carries 0, 2, 4, …; 2/3 carries 0, 2, 3, 5, 6, ….
    """

    kept: Fraction

    key = "rate_hz"
    reason = "rate"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        seq, top, bottom = context.seq, self.kept.numerator, self.kept.denominator
        # Carried message j is the source's first message at or after the j-th period of the link.
        return 0 if seq * top // bottom > (seq - 1) * top // bottom else "rate"

    def describe(self) -> str:
        return f"rate: {self.kept.numerator} of {self.kept.denominator} messages carried"


@dataclass(frozen=True, slots=True)
class Cut(Effect):
    """Drops all messages while the link is cut."""

    key = "cut"
    reason = "cut"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return "cut"

    def losses(self, distance_m: float | None) -> Losses:
        return Losses.independent(1.0)

    def describe(self) -> str:
        return "cut"


@dataclass(frozen=True, slots=True)
class Loss(Effect):
    """Loses each message independently with probability `ratio`."""

    ratio: float

    key = "loss_ratio"
    reason = "loss"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return "loss" if draw("loss", context.seq) < self.ratio else 0

    def losses(self, distance_m: float | None) -> Losses:
        return Losses.independent(self.ratio)

    def describe(self) -> str:
        return f"independent loss {self.ratio:.4g}"


@dataclass(frozen=True, slots=True)
class Latency(Effect):
    """Delays every message by `floor` ns."""

    floor: int

    key = "latency_ms"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return self.floor

    @property
    def delays(self) -> Delays:
        return Delays(float(self.floor), 0.0)

    def describe(self) -> str:
        return f"latency {self.floor / MILLISECOND:g} ms"


@dataclass(frozen=True, slots=True)
class Jitter(Effect):
    """Delays each message independently, uniformly between 0 and `spread` ns."""

    spread: int

    key = "jitter_ms"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return round(draw("jitter", context.seq) * self.spread)

    @property
    def delays(self) -> Delays:
        return Delays(0.5 * self.spread, self.spread**2 / 12.0)

    def delay_quantile(self, share: float) -> float:
        return share * self.spread

    def describe(self) -> str:
        return f"jitter up to {self.spread / MILLISECOND:g} ms, uniform"
