"""What all laws of delay beyond the floor have: order, and correlation from message to message.

A law is a function of a standard normal number: where that is correlated from message to message,
so is the delay (a Gaussian copula), and single delays still follow the requested law exactly. In
netem they do not: its correlated number is no longer uniform (sch_netem.c, get_crandom). The
correlation is that of the normal numbers; that of the delays themselves is a little smaller, unless
their law is normal, too.
"""

from functools import cached_property
from math import erfc, sqrt
from typing import Annotated, Literal

from pydantic import Field

from transport.links.laws.correlated_normals import CorrelatedNormals, quantile
from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.link_law import LinkLaw
from transport.links.laws.moments import Delays
from transport.links.laws.stage import InOrder, StageLaw
from transport.reasons import DropReason
from vehicles.schedule import MILLISECOND

PURPOSE = "delay"
"""The word under which delays are drawn."""
_ROOT_TWO = sqrt(2.0)

Milliseconds = Annotated[float, Field(ge=0, le=60_000)]
PositiveMilliseconds = Annotated[float, Field(ge=0.001, le=60_000)]
"""The least is a microsecond."""


class BaseDelay(LinkLaw):
    """What all laws of delay have: whether messages may overtake one another ("free")."""

    key = "delay"

    order: Literal["free", "in_order"] = "free"

    @property
    def typical_max_ns(self) -> float:
        """Delay that most messages do not exceed: the mean and two deviations."""
        raise NotImplementedError

    @property
    def stages(self) -> tuple[StageLaw, ...]:
        return (InOrder(),) if self.order == "in_order" else ()


class RandomDelay(BaseDelay):
    """Beside it, for laws with chance: how much a message's delay has of the one before it.

    It is the correlation of the normal numbers that delays are drawn by; delays have that law
    whatever the correlation. All that follows from the keys is in ns.
    """

    correlation_ratio: Annotated[float, Field(ge=0, le=0.99)] = 0.0

    @property
    def mean_ns(self) -> float:
        raise NotImplementedError

    @property
    def deviation_ns(self) -> float:
        raise NotImplementedError

    def at(self, normal: float) -> float:
        """Return the delay that belongs to a standard normal number, which it grows with."""
        raise NotImplementedError

    def describe_law(self) -> str:
        """Describe the law without its correlation."""
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
        tied = self.correlation_ratio
        return f"{self.describe_law()}, correlation {tied:g}" if tied else self.describe_law()


def normal_cdf(normal: float) -> float:
    """Share of standard normal numbers below one."""
    return 0.5 * erfc(-normal / _ROOT_TWO)


def format_ms(nanoseconds: float) -> str:
    return f"{nanoseconds / MILLISECOND:g} ms"
