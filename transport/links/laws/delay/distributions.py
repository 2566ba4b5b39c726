"""Delay laws by `kind`."""

from collections.abc import Iterator
from functools import cached_property
from math import exp, fsum, inf, log, log1p, pi, sqrt
from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from transport.links.laws.correlated_normals import quantile
from transport.links.laws.delay.base import (
    BaseDelay,
    Milliseconds,
    PositiveMilliseconds,
    RandomDelay,
    format_ms,
    normal_cdf,
)
from transport.links.laws.delay.gamma_quantiles import log_quantile, log_quantiles
from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.link_law import Problem
from transport.links.laws.moments import Delays
from transport.reasons import DropReason
from vehicles.schedule import MILLISECOND

WIDEST, NARROWEST = 5.0, 0.01  # Limits of a skewed law's deviation over its mean
MAX_RECORDED = 1000  # Delays that every link holds in memory


class ConstantDelay(BaseDelay):
    """The same delay for all messages.

    delay_ms  the delay
    """

    kind: Literal["constant"] = "constant"
    delay_ms: Milliseconds

    @cached_property
    def _delay(self) -> int:
        return round(self.delay_ms * MILLISECOND)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return self._delay

    @property
    def typical_max_ns(self) -> float:
        return float(self._delay)

    @property
    def delays(self) -> Delays:
        return Delays(float(self._delay), 0.0)

    def describe(self) -> str:
        return f"delay of {format_ms(self._delay)}"


class UniformDelay(RandomDelay):
    """Uniformly distributed delay.

    delay_ms_min  minimum
    delay_ms_max  maximum
    """

    kind: Literal["uniform"] = "uniform"
    delay_ms_min: Milliseconds = 0.0
    delay_ms_max: Milliseconds

    def problems(self) -> Iterator[Problem]:
        if self.delay_ms_max <= self.delay_ms_min:
            allowed = f"allowed more than delay_ms_min, {self.delay_ms_min:g}"
            yield "delay_ms_max", f"given {self.delay_ms_max:g}, {allowed}"

    @cached_property
    def _ends(self) -> tuple[float, float]:
        return self.delay_ms_min * MILLISECOND, self.delay_ms_max * MILLISECOND

    @property
    def mean_ns(self) -> float:
        least, most = self._ends
        return 0.5 * (least + most)

    @property
    def deviation_ns(self) -> float:
        least, most = self._ends
        return (most - least) / sqrt(12.0)

    def at(self, normal: float) -> float:
        least, most = self._ends
        return least + normal_cdf(normal) * (most - least)

    def describe_law(self) -> str:
        least, most = self._ends
        return f"delay uniform from {format_ms(least)} to {format_ms(most)}"


class NormalDelay(RandomDelay):
    """Truncated normal distribution.

    mean_ms       mean before truncation
    deviation_ms  standard deviation before truncation
    delay_ms_max  upper end, by default none; the lower end is 0

    Moments after truncation: Johnson, Kotz and Balakrishnan, Continuous Univariate Distributions,
    vol. 1, ch. 13.
    """

    kind: Literal["normal"] = "normal"
    mean_ms: Milliseconds
    deviation_ms: PositiveMilliseconds
    delay_ms_max: Milliseconds | None = None

    def problems(self) -> Iterator[Problem]:
        least = max(self.mean_ms, 0.001)
        if self.delay_ms_max is not None and self.delay_ms_max < least:
            yield (
                "delay_ms_max",
                f"given {self.delay_ms_max:g}, allowed at least mean_ms, {least:g}",
            )

    @cached_property
    def _cut(self) -> tuple[float, float, float, float, float, float]:
        """Mean, deviation and maximum (ns), and the probabilities below, above and between."""
        centre, spread = self.mean_ms * MILLISECOND, self.deviation_ms * MILLISECOND
        most = inf if self.delay_ms_max is None else self.delay_ms_max * MILLISECOND
        below, above = normal_cdf(-centre / spread), normal_cdf((centre - most) / spread)
        return centre, spread, most, below, above, 1.0 - below - above

    @property
    def mean_ns(self) -> float:
        centre, spread, *_ = self._cut
        return centre + spread * self._shift()

    @property
    def deviation_ns(self) -> float:
        centre, spread, most, _, _, kept = self._cut
        low, high = -centre / spread, (most - centre) / spread
        edges = low * _density(low) - (high * _density(high) if high < inf else 0.0)
        return spread * sqrt(1.0 + edges / kept - self._shift() ** 2)

    def _shift(self) -> float:
        centre, spread, most, _, _, kept = self._cut
        low, high = -centre / spread, (most - centre) / spread
        return (_density(low) - _density(high)) / kept

    def at(self, normal: float) -> float:
        centre, spread, most, below, above, kept = self._cut
        tail = normal_cdf(-abs(normal)) * kept
        if normal <= 0.0:
            return max(centre + spread * quantile(below + tail), 0.0)
        return min(max(centre - spread * quantile(above + tail), 0.0), most)

    def describe_law(self) -> str:
        centre, spread, most, *_ = self._cut
        ends = "0" if most == inf else f"0 and {format_ms(most)}"
        return f"delay normal, {format_ms(centre)} ± {format_ms(spread)}, truncated at {ends}"


def _density(normal: float) -> float:
    return exp(-0.5 * normal * normal) / sqrt(2.0 * pi)


class SkewedDelay(RandomDelay):
    """Base of skewed distributions.

    mean_ms       mean of the delay
    deviation_ms  standard deviation of the delay, 0.01 to 5 times the mean
    """

    kind: str
    mean_ms: PositiveMilliseconds
    deviation_ms: PositiveMilliseconds

    def problems(self) -> Iterator[Problem]:
        least, most = NARROWEST * self.mean_ms, WIDEST * self.mean_ms
        if not least <= self.deviation_ms <= most:
            allowed = f"allowed {least:g} to {most:g}, {NARROWEST:g} to {WIDEST:g} times the mean"
            yield "deviation_ms", f"given {self.deviation_ms:g}, {allowed}"

    @property
    def mean_ns(self) -> float:
        return self.mean_ms * MILLISECOND

    @property
    def deviation_ns(self) -> float:
        return self.deviation_ms * MILLISECOND

    def describe_law(self) -> str:
        return f"delay {self.kind}, {format_ms(self.mean_ns)} ± {format_ms(self.deviation_ns)}"


class LognormalDelay(SkewedDelay):
    """Lognormal distribution.

    mean_ms       mean of the delay itself
    deviation_ms  standard deviation of the delay itself, 0.01 to 5 times the mean
    """

    kind: Literal["lognormal"] = "lognormal"

    @cached_property
    def _of_logarithm(self) -> tuple[float, float]:
        """Deviation of the logarithm, and median (Johnson, Kotz and Balakrishnan, ch. 14)."""
        variance = log1p((self.deviation_ns / self.mean_ns) ** 2)
        return sqrt(variance), self.mean_ns * exp(-0.5 * variance)

    def at(self, normal: float) -> float:
        spread, median = self._of_logarithm
        return median * exp(spread * normal)


class GammaDelay(SkewedDelay):
    """Gamma distribution.

    mean_ms       mean of the delay
    deviation_ms  standard deviation of the delay, 0.01 to 5 times the mean
    """

    kind: Literal["gamma"] = "gamma"

    @cached_property
    def _quantiles(self) -> tuple[tuple[tuple[float, float], ...], float]:
        """Table of quantiles, and logarithm of the scale."""
        table = log_quantiles((self.mean_ns / self.deviation_ns) ** 2)
        return table, log(self.deviation_ns**2 / self.mean_ns)

    def at(self, normal: float) -> float:
        table, log_scale = self._quantiles
        return exp(log_quantile(table, normal) + log_scale)


class EmpiricalDelay(RandomDelay):
    """Recorded delays, all equally likely.

    file         CSV file with the column delay_ms, relative to the scenario file
    recorded_ms  the delays, in place of a file; more than 1000 are reduced to 1000 evenly spaced
                 quantiles, which changes probabilities by at most 0.001
    source       name of the file they were read from
    """

    kind: Literal["empirical"] = "empirical"
    file: Annotated[str, StringConstraints(min_length=1)] | None = None
    source: str | None = None
    recorded_ms: Annotated[
        tuple[Milliseconds, ...], Field(strict=False, max_length=MAX_RECORDED)
    ] = ()

    def problems(self) -> Iterator[Problem]:
        if self.file is not None and self.recorded_ms:
            yield "recorded_ms", "given together with file, allowed one of them"
        if self.file is None and not self.recorded_ms:
            yield "file", "missing, needed without recorded_ms"

    @cached_property
    def _recorded(self) -> tuple[float, ...]:
        return tuple(delay_ms * MILLISECOND for delay_ms in sorted(self.recorded_ms))

    @property
    def mean_ns(self) -> float:
        return fsum(self._recorded) / len(self._recorded)

    @property
    def deviation_ns(self) -> float:
        mean = self.mean_ns
        return sqrt(fsum((delay - mean) ** 2 for delay in self._recorded) / len(self._recorded))

    def at(self, normal: float) -> float:
        count = len(self._recorded)
        return self._recorded[min(int(normal_cdf(normal) * count), count - 1)]

    def describe_law(self) -> str:
        moments = f"{format_ms(self.mean_ns)} ± {format_ms(self.deviation_ns)}"
        return f"delay drawn from {len(self._recorded)} recorded delays, {moments}"
