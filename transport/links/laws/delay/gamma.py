"""A gamma delay."""

from functools import cached_property
from math import exp, log
from typing import Literal

from transport.links.laws.delay.drawn import (
    DrawnDelay,
    SomeMilliseconds,
    check_skew,
    in_ms,
)
from transport.links.laws.delay.gamma_quantiles import log_quantile, log_quantiles
from vehicles.schedule import MILLISECOND


class GammaDelay(DrawnDelay):
    """Gamma, by the mean and the standard deviation of the delay."""

    kind: Literal["gamma"] = "gamma"
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
    def _quantiles(self) -> tuple[tuple[tuple[float, float], ...], float]:
        """Table of quantiles, and the logarithm of the scale."""
        table = log_quantiles((self.mean_ns / self.deviation_ns) ** 2)
        return table, log(self.deviation_ns**2 / self.mean_ns)

    def at(self, normal: float) -> float:
        """Return the delay from the table."""
        table, log_scale = self._quantiles
        return exp(log_quantile(table, normal) + log_scale)

    def describe_law(self) -> str:
        """Give both moments."""
        return f"delay gamma, {in_ms(self.mean_ns)} ± {in_ms(self.deviation_ns)}"
