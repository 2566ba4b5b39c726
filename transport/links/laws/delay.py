"""Laws of delay beyond the floor, each message's tied to that of the one before it.

A law is a function of a standard normal number: where that is correlated from message to message,
so is the delay (a Gaussian copula), and single delays still follow the law asked for exactly. In
netem they do not: its correlated number is no longer uniform (sch_netem.c, get_crandom). The
`correlation` is that of the normal numbers; that of the delays themselves is a little smaller,
unless their law is normal too. All delays are in ns.
"""

from dataclasses import dataclass, field
from math import erfc, exp, fsum, inf, log, log1p, pi, sqrt
from typing import Protocol

from transport.links.laws.effect import Draw, LosesNothing, Passage
from transport.links.laws.gamma import log_quantile, log_quantiles
from transport.links.laws.normals import Normals, quantile
from transport.reasons import DropReason
from vehicles.schedule import MILLISECOND

_ROOT_TWO = sqrt(2.0)


class DelayLaw(Protocol):
    """How delays are distributed, as a function of a standard normal number."""

    @property
    def mean_ns(self) -> float:
        """Mean delay."""

    @property
    def deviation_ns(self) -> float:
        """Standard deviation of the delay."""

    def at(self, normal: float) -> float:
        """Delay that belongs to a standard normal number, which it grows with."""

    def in_words(self) -> str:
        """Say the law in a few words, with units."""


@dataclass(frozen=True, slots=True)
class DrawnDelay(LosesNothing):
    """Delays each message by a law's delay for its own normal number."""

    law: DelayLaw
    normals: Normals

    @property
    def mean_ns(self) -> float:
        """Mean delay."""
        return self.law.mean_ns

    @property
    def deviation_ns(self) -> float:
        """Standard deviation of the delay."""
        return self.law.deviation_ns

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:
        """Delay by the law."""
        return round(self.law.at(self.normals.at(draw, passage.seq)))

    def in_words(self) -> str:
        """Say law and correlation."""
        tied = self.normals.correlation
        return f"{self.law.in_words()}, correlation {tied:g}" if tied else self.law.in_words()


@dataclass(frozen=True, slots=True)
class ConstantDelay(LosesNothing):
    """Always `delay` ns."""

    delay: int

    @property
    def mean_ns(self) -> float:
        """The delay."""
        return float(self.delay)

    @property
    def deviation_ns(self) -> float:
        """None."""
        return 0.0

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:  # noqa: ARG002 - no chance
        """Delay by it."""
        return self.delay

    def at(self, normal: float) -> float:  # noqa: ARG002 - no chance
        """Return it, whatever the number."""
        return float(self.delay)

    def in_words(self) -> str:
        """Say it."""
        return f"delay of {_ms(self.delay)}"


@dataclass(frozen=True, slots=True)
class UniformDelay:
    """Uniform from `least` to `most`."""

    least: float
    most: float

    @property
    def mean_ns(self) -> float:
        """The middle."""
        return 0.5 * (self.least + self.most)

    @property
    def deviation_ns(self) -> float:
        """The width over √12."""
        return (self.most - self.least) / sqrt(12.0)

    def at(self, normal: float) -> float:
        """Where the probability has it between both ends."""
        return self.least + _probability(normal) * (self.most - self.least)

    def in_words(self) -> str:
        """Say both ends."""
        return f"delay uniform from {_ms(self.least)} to {_ms(self.most)}"


@dataclass(frozen=True, slots=True)
class NormalDelay:
    """Normal by `centre` and `spread`, cut off (truncated, not piled up) at 0 and at `most`.

    `centre` is from 0 to `most`. Mean and deviation are those of what is left.
    """

    centre: float
    spread: float
    most: float = inf
    _below: float = field(init=False, repr=False, compare=False)
    _above: float = field(init=False, repr=False, compare=False)
    _kept: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Work out what is cut off at both ends."""
        object.__setattr__(self, "_below", _probability(-self.centre / self.spread))
        object.__setattr__(self, "_above", _probability((self.centre - self.most) / self.spread))
        object.__setattr__(self, "_kept", 1.0 - self._below - self._above)

    @property
    def mean_ns(self) -> float:
        """Mean of what is left (Johnson, Kotz and Balakrishnan, vol. 1, ch. 13)."""
        return self.centre + self.spread * self._shift()

    @property
    def deviation_ns(self) -> float:
        """Deviation of what is left (the same)."""
        low, high = -self.centre / self.spread, (self.most - self.centre) / self.spread
        edges = low * _density(low) - (high * _density(high) if high < inf else 0.0)
        return self.spread * sqrt(1.0 + edges / self._kept - self._shift() ** 2)

    def _shift(self) -> float:
        low, high = -self.centre / self.spread, (self.most - self.centre) / self.spread
        return (_density(low) - _density(high)) / self._kept

    def at(self, normal: float) -> float:
        """The quantile at the number's probability, from the nearer tail."""
        tail = _probability(-abs(normal)) * self._kept
        if normal <= 0.0:
            return max(self.centre + self.spread * quantile(self._below + tail), 0.0)
        return min(max(self.centre - self.spread * quantile(self._above + tail), 0.0), self.most)

    def in_words(self) -> str:
        """Say what was asked for, and where it is cut off."""
        ends = "0" if self.most == inf else f"0 and {_ms(self.most)}"
        asked = f"{_ms(self.centre)} ± {_ms(self.spread)}"
        return f"delay normal, {asked}, truncated at {ends}"


@dataclass(frozen=True, slots=True)
class LognormalDelay:
    """Lognormal, by the mean and the standard deviation of the delay itself."""

    mean_ns: float
    deviation_ns: float
    _spread: float = field(init=False, repr=False, compare=False)
    _median: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Work out the normal law of its logarithm (Johnson, Kotz and Balakrishnan, ch. 14)."""
        variance = log1p((self.deviation_ns / self.mean_ns) ** 2)
        object.__setattr__(self, "_spread", sqrt(variance))
        object.__setattr__(self, "_median", self.mean_ns * exp(-0.5 * variance))

    def at(self, normal: float) -> float:
        """The exponential of a normal number."""
        return self._median * exp(self._spread * normal)

    def in_words(self) -> str:
        """Say both moments."""
        return f"delay lognormal, {_ms(self.mean_ns)} ± {_ms(self.deviation_ns)}"


@dataclass(frozen=True, slots=True)
class GammaDelay:
    """Gamma, by the mean and the standard deviation of the delay itself."""

    mean_ns: float
    deviation_ns: float
    _table: tuple[tuple[float, float], ...] = field(init=False, repr=False, compare=False)
    _log_scale: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Make the table of quantiles."""
        table = log_quantiles((self.mean_ns / self.deviation_ns) ** 2)
        object.__setattr__(self, "_table", table)
        object.__setattr__(self, "_log_scale", log(self.deviation_ns**2 / self.mean_ns))

    def at(self, normal: float) -> float:
        """From the table."""
        return exp(log_quantile(self._table, normal) + self._log_scale)

    def in_words(self) -> str:
        """Say both moments."""
        return f"delay gamma, {_ms(self.mean_ns)} ± {_ms(self.deviation_ns)}"


@dataclass(frozen=True, slots=True)
class EmpiricalDelay:
    """One of the recorded delays, each as likely as another; they are sorted."""

    recorded: tuple[float, ...]

    @property
    def mean_ns(self) -> float:
        """Mean of those recorded."""
        return fsum(self.recorded) / len(self.recorded)

    @property
    def deviation_ns(self) -> float:
        """Deviation of those recorded, which are the whole law."""
        mean = self.mean_ns
        return sqrt(fsum((one - mean) ** 2 for one in self.recorded) / len(self.recorded))

    def at(self, normal: float) -> float:
        """The one at the number's probability."""
        count = len(self.recorded)
        return self.recorded[min(int(_probability(normal) * count), count - 1)]

    def in_words(self) -> str:
        """Say how many, and their moments."""
        moments = f"{_ms(self.mean_ns)} ± {_ms(self.deviation_ns)}"
        return f"delay as in {len(self.recorded)} recorded ones, {moments}"


def _probability(normal: float) -> float:
    """Share of standard normal numbers below one."""
    return 0.5 * erfc(-normal / _ROOT_TWO)


def _density(normal: float) -> float:
    """Density of the standard normal law."""
    return exp(-0.5 * normal * normal) / sqrt(2.0 * pi)


def _ms(nanoseconds: float) -> str:
    return f"{nanoseconds / MILLISECOND:g} ms"
