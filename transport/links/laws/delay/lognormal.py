"""A lognormal delay."""

from functools import cached_property
from math import exp, log1p, sqrt
from typing import Literal

from transport.links.laws.delay.drawn import (
    DrawnDelay,
    SomeMilliseconds,
    check_skew,
    in_ms,
)
from vehicles.schedule import MILLISECOND


class LognormalDelay(DrawnDelay):
    """Lognormal, by the mean and the standard deviation of the delay."""

    kind: Literal["lognormal"] = "lognormal"
    mean_ms: SomeMilliseconds
    deviation_ms: SomeMilliseconds

    def check(self) -> None:
        """Find a deviation far from the mean."""
        check_skew(self.mean_ms, self.deviation_ms)

    @property
    def mean_ns(self) -> float:
        """Mean delay."""
        return self.mean_ms * MILLISECOND

    @property
    def deviation_ns(self) -> float:
        """Standard deviation of the delay."""
        return self.deviation_ms * MILLISECOND

    @cached_property
    def _of_logarithm(self) -> tuple[float, float]:
        """Deviation of the logarithm, and the median (Johnson, Kotz and Balakrishnan, ch. 14)."""
        variance = log1p((self.deviation_ns / self.mean_ns) ** 2)
        return sqrt(variance), self.mean_ns * exp(-0.5 * variance)

    def at(self, normal: float) -> float:
        """Return the exponential of a normal number."""
        spread, median = self._of_logarithm
        return median * exp(spread * normal)

    def describe_law(self) -> str:
        """Give both moments."""
        return f"delay lognormal, {in_ms(self.mean_ns)} ± {in_ms(self.deviation_ns)}"
