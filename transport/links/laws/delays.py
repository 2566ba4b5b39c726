"""Base classes of delay laws: order of arrival, and correlation between messages.

A delay is a function of a standard normal number. If the normal numbers are correlated from message
to message, so are the delays (Gaussian copula), and each delay still has exactly the requested
distribution. In netem it does not: its correlated number is not uniform (sch_netem.c,
get_crandom). The delays are slightly less correlated than the normal numbers, unless normal.
"""

from collections.abc import Iterator
from functools import cached_property, lru_cache
from math import erfc, exp, fsum, inf, lgamma, log, log1p, pi, sqrt
from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from transport.links.laws.correlated_normals import CorrelatedNormals, quantile
from transport.links.laws.link_law import (
    Delays,
    Draw,
    InOrder,
    LinkLaw,
    Problem,
    StageLaw,
    TransmissionContext,
)
from transport.topics import DropReason
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
    they are unknown.

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
        return Delays(self.mean_ns, self.deviation_ns**2)


def normal_cdf(normal: float) -> float:
    return 0.5 * erfc(-normal / _ROOT_TWO)


# ---- Quantiles of the gamma distribution as a function of a standard normal number
#
# The incomplete gamma function has no closed-form inverse, and scipy takes too much memory for a
# vehicle's process. The logarithm of the quantile is solved by Newton's method at knots of the
# normal number, with cubic Hermite interpolation between them. The relative error is below 10^-7
# for shapes from 0.04 to 10^4 (tests compare it with scipy).


KNOTS_PER_UNIT = 32
MAX_NORMAL = 8.5  # Knots reach from -8.5 to 8.5; draws of 52 bits reach 8.3
_TINY = 1e-300
_EXACT = 1e-16
_SOLVED = 1e-6  # Largest last step: Newton's method squares its error, so 10^-12 remains
_LOG_ROOT_TWO_PI = 0.5 * log(2.0 * pi)


@lru_cache(maxsize=16)
def log_quantiles(shape: float) -> tuple[tuple[float, float], ...]:
    """Logarithm of the quantile (scale 1) and its slope at each knot of the normal number."""
    last = round(MAX_NORMAL * KNOTS_PER_UNIT)
    # Start at the median by Wilson and Hilferty's approximation (PNAS 17, 1931).
    middle = start = log(shape) + 3.0 * log(max(1.0 - 1.0 / (9.0 * shape), 0.1))
    knots = {}
    for sign in (1, -1):
        start = middle
        for k in range(last + 1):
            z = sign * k / KNOTS_PER_UNIT
            value = _solved(shape, z, start)
            slope = exp(_log_density(z) - _log_density_of_logarithm(shape, value))
            knots[sign * k] = value, slope
            start = value + sign * slope / KNOTS_PER_UNIT
            middle = value if k == 0 else middle
    return tuple(knots[k] for k in range(-last, last + 1))


def log_quantile(table: tuple[tuple[float, float], ...], z: float) -> float:
    """Logarithm of the quantile for the standard normal number `z`."""
    place = (min(max(z, -MAX_NORMAL), MAX_NORMAL) + MAX_NORMAL) * KNOTS_PER_UNIT
    k = min(int(place), len(table) - 2)
    u = place - k
    (before, slope), (after, slope_after) = table[k], table[k + 1]
    step = after - before
    first, second = slope / KNOTS_PER_UNIT - step, step - slope_after / KNOTS_PER_UNIT
    return before + u * (step + (1.0 - u) * ((1.0 - u) * first + u * second))


def _solved(shape: float, z: float, start: float) -> float:
    """Logarithm at which the nearer tail has the probability of the normal tail beyond `z`.

    Newton's method converges, because the logarithms of both tails are concave.
    """
    target = log(0.5 * erfc(abs(z) / sqrt(2.0)))
    value = start
    for _ in range(60):
        tail = _log_tail(shape, value, upper=z > 0.0)
        slope = exp(_log_density_of_logarithm(shape, value) - tail) * (-1.0 if z > 0.0 else 1.0)
        step = (target - tail) / slope
        value += step
        if abs(step) <= _SOLVED:
            break
    return value


def _log_density(z: float) -> float:
    return -0.5 * z * z - _LOG_ROOT_TWO_PI


def _log_density_of_logarithm(shape: float, value: float) -> float:
    return shape * value - exp(value) - lgamma(shape)


def _log_tail(shape: float, value: float, *, upper: bool) -> float:
    """Logarithm of the regularised incomplete gamma function at exp(value), lower or upper.

    Below `shape` + 1 by the series DLMF 8.11.4, above by the continued fraction 8.9.2.
    """
    x = exp(value)
    density = _log_density_of_logarithm(shape, value)
    if x < shape + 1.0:
        lower = density + log(_series(shape, x))
        return log(max(1.0 - exp(lower), _TINY)) if upper else lower
    log_upper = density + log(_fraction(shape, x))
    return log_upper if upper else log(max(1.0 - exp(log_upper), _TINY))


def _series(shape: float, x: float) -> float:
    """Sum of x^n / (shape (shape + 1) ... (shape + n)) over n (DLMF 8.11.4)."""
    term = total = 1.0 / shape
    n = shape
    while term > _EXACT * total:
        n += 1.0
        term *= x / n
        total += term
    return total


def _fraction(shape: float, x: float) -> float:
    """Continued fraction of the upper function (DLMF 8.9.2) by Lentz's method."""
    b = x + 1.0 - shape
    c, d = 1.0 / _TINY, 1.0 / b
    total = d
    for n in range(1, 10_000):
        a = n * (shape - n)
        b += 2.0
        d = 1.0 / (a * d + b or _TINY)
        c = b + a / c or _TINY
        change = c * d
        total *= change
        if abs(change - 1.0) < 4.0 * _EXACT:
            break
    return total


# ---- Delay laws by `kind`


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
