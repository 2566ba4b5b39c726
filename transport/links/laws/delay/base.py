"""Base classes of delay laws: order of arrival, and correlation between messages.

A delay is a function of a standard normal number. If the normal numbers are correlated from message
to message, so are the delays (Gaussian copula), and each delay still has exactly the requested
distribution. In netem it does not: its correlated number is not uniform (sch_netem.c,
get_crandom). The delays are slightly less correlated than the normal numbers, unless normal.
"""

from functools import cached_property
from math import erfc, sqrt
from typing import Annotated, Literal

from pydantic import Field

from transport.links.laws.correlated_normals import CorrelatedNormals, quantile
from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.link_law import LinkLaw, described_parameters
from transport.links.laws.moments import Delays
from transport.links.laws.stage import InOrder, StageLaw
from transport.reasons import DropReason
from vehicles.schedule import MILLISECOND

PURPOSE = "delay"  # Purpose of the draws of delays
_ROOT_TWO = sqrt(2.0)

Milliseconds = Annotated[float, Field(ge=0, le=60_000)]
PositiveMilliseconds = Annotated[float, Field(ge=0.001, le=60_000)]  # At least a microsecond


class BaseDelay(LinkLaw):
    """Base of delay laws: a Pydantic model whose fields are its parameters.

    `judge` returns the delay of one message (ns), which is added to the latency of the link. It
    must depend only on `draw` and `context`, not on other messages, so that it is the same on every
    clock: `draw("mine", context.seq)` is the random number in (0, 1) of a purpose and a message.

    `delays` may state mean and variance, `Delays(mean_ns, variance_ns2)`, which `convoy check`
    compares with the achieved ones, and by which followers know when a message is late; by default
    they are unknown. `describe` may describe the law in one line.

    order  "free": messages may overtake each other; "in_order": they wait for earlier ones
    """

    key = "delay"

    order: Literal["free", "in_order"] = "free"

    @property
    def delays(self) -> Delays | None:
        return None

    @property
    def typical_max_ns(self) -> float:
        """Mean plus two standard deviations; 0 if they are unknown."""
        delays = self.delays
        return 0.0 if delays is None else delays.mean + 2.0 * sqrt(delays.variance)

    def describe(self) -> str:
        return described_parameters(self)

    @property
    def stages(self) -> tuple[StageLaw, ...]:
        return (InOrder(),) if self.order == "in_order" else ()


class RandomDelay(BaseDelay):
    """Base of random delay laws; values derived from the keys are in ns.

    correlation_ratio  correlation of the normal numbers of successive messages
    """

    correlation_ratio: Annotated[float, Field(ge=0, le=0.99)] = 0.0

    @property
    def mean_ns(self) -> float:
        raise NotImplementedError

    @property
    def deviation_ns(self) -> float:
        raise NotImplementedError

    def at(self, normal: float) -> float:
        """Delay for a standard normal number, increasing."""
        raise NotImplementedError

    def describe_law(self) -> str:
        """Describe the distribution without its correlation."""
        raise NotImplementedError

    @cached_property
    def _normals(self) -> CorrelatedNormals:
        return CorrelatedNormals(PURPOSE, self.correlation_ratio)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return round(self.at(self._normals.at(draw, context.seq)))

    @property
    def typical_max_ns(self) -> float:
        return self.mean_ns + 2.0 * self.deviation_ns

    @property
    def delays(self) -> Delays:
        return Delays(self.mean_ns, self.deviation_ns**2, self.correlation_ratio)

    def delay_quantile(self, share: float) -> float:
        return self.at(quantile(share))

    def describe(self) -> str:
        correlation = f", correlation {self.correlation_ratio:g}" if self.correlation_ratio else ""
        return self.describe_law() + correlation


def normal_cdf(normal: float) -> float:
    return 0.5 * erfc(-normal / _ROOT_TWO)


def format_ms(nanoseconds: float) -> str:
    return f"{nanoseconds / MILLISECOND:g} ms"
