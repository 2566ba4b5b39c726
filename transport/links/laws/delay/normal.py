"""A normal delay, truncated."""

from functools import cached_property
from math import exp, inf, pi, sqrt
from typing import Literal

from transport.links.laws.delay.drawn import (
    DrawnDelay,
    Milliseconds,
    SomeMilliseconds,
    in_ms,
    probability,
)
from transport.links.laws.law import Unfit
from transport.links.laws.normals import quantile
from vehicles.schedule import MILLISECOND


class NormalDelay(DrawnDelay):
    """Normal, cut off at 0 and at `delay_ms_max`; mean and deviation are those before the cut.

    It is truncated, not piled up. Moments of what is left: Johnson, Kotz and Balakrishnan,
    Continuous Univariate Distributions, vol. 1, ch. 13.
    """

    kind: Literal["normal"] = "normal"
    mean_ms: Milliseconds
    deviation_ms: SomeMilliseconds
    delay_ms_max: Milliseconds | None = None

    def check(self) -> None:
        """Find a maximum below the mean."""
        least = max(self.mean_ms, 0.001)
        if self.delay_ms_max is not None and self.delay_ms_max < least:
            why = f"given {self.delay_ms_max:g}, allowed at least {least:g}, the mean"
            raise Unfit("delay_ms_max", why)

    @cached_property
    def _cut(self) -> tuple[float, float, float, float, float, float]:
        """Mean, deviation and maximum (ns), and the shares below, above and between the cuts."""
        centre, spread = self.mean_ms * MILLISECOND, self.deviation_ms * MILLISECOND
        most = inf if self.delay_ms_max is None else self.delay_ms_max * MILLISECOND
        below, above = probability(-centre / spread), probability((centre - most) / spread)
        return centre, spread, most, below, above, 1.0 - below - above

    @property
    def mean_ns(self) -> float:
        """Mean of what is left."""
        centre, spread, *_ = self._cut
        return centre + spread * self._shift()

    @property
    def deviation_ns(self) -> float:
        """Deviation of what is left."""
        centre, spread, most, _, _, kept = self._cut
        low, high = -centre / spread, (most - centre) / spread
        edges = low * _density(low) - (high * _density(high) if high < inf else 0.0)
        return spread * sqrt(1.0 + edges / kept - self._shift() ** 2)

    def _shift(self) -> float:
        centre, spread, most, _, _, kept = self._cut
        low, high = -centre / spread, (most - centre) / spread
        return (_density(low) - _density(high)) / kept

    def at(self, normal: float) -> float:
        """Return the quantile at the number's probability, from the nearer tail."""
        centre, spread, most, below, above, kept = self._cut
        tail = probability(-abs(normal)) * kept
        if normal <= 0.0:
            return max(centre + spread * quantile(below + tail), 0.0)
        return min(max(centre - spread * quantile(above + tail), 0.0), most)

    def describe_law(self) -> str:
        """Give mean and deviation as requested, and where the law is cut off."""
        centre, spread, most, *_ = self._cut
        ends = "0" if most == inf else f"0 and {in_ms(most)}"
        return f"delay normal, {in_ms(centre)} ± {in_ms(spread)}, truncated at {ends}"


def _density(normal: float) -> float:
    """Density of the standard normal law."""
    return exp(-0.5 * normal * normal) / sqrt(2.0 * pi)
