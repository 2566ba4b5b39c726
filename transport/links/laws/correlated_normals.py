"""Standard normal numbers by message number, correlated from message to message.

A first-order autoregression has autocorrelation ρ^m at lag m, but each value depends on all earlier
ones. Here the recursion restarts at zero one block of B numbers before the block of a number, with
ρ^B ≤ RESIDUAL_WEIGHT. The error of variance and correlations is ρ^(2B) = 10^-18, less than the
rounding error. Each number therefore has one value, by the same operations in the same order,
whether it is computed alone (up to 2 B draws) or in sequence (one draw).
"""

from collections.abc import Callable
from math import ceil, log, sqrt
from statistics import NormalDist

from transport.links.laws.link_law import Draw

RESIDUAL_WEIGHT = 1e-9  # Maximum weight of a draw after one block
MAX_CORRELATION = 0.99  # Of neighbours, with blocks of 2062 numbers
RECENT = 64  # Number of cached values, for messages out of order
quantile: Callable[[float], float] = NormalDist().inv_cdf  # Algorithm AS 241, error 1e-16


class CorrelatedNormals:
    """Keyed standard normal numbers with autocorrelation `correlation` ** lag.

    The state of the recursion and the last values are cached; they do not change results.
    """

    __slots__ = (
        "_after", "_block", "_draw", "_first", "_last", "_recent", "_scale", "_value",
        "correlation", "purpose",
    )  # fmt: skip

    def __init__(self, purpose: str, correlation: float = 0.0) -> None:
        """Raises ValueError unless `correlation` is from 0 to 0.99."""
        if not 0.0 <= correlation <= MAX_CORRELATION:
            raise ValueError(f"correlation {correlation}, allowed 0 to {MAX_CORRELATION}")
        self.purpose, self.correlation = purpose, correlation
        self._block = ceil(log(RESIDUAL_WEIGHT) / log(correlation)) if correlation else 0
        self._scale = sqrt(1.0 - correlation * correlation)
        self._draw: Draw | None = None
        self._first = self._last = 0
        self._value = self._after = 0.0
        self._recent: dict[int, float] = {}

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, CorrelatedNormals):
            return NotImplemented
        return (self.purpose, self.correlation) == (other.purpose, other.correlation)

    def __hash__(self) -> int:
        return hash((self.purpose, self.correlation))

    def __repr__(self) -> str:
        return f"CorrelatedNormals({self.purpose!r}, {self.correlation!r})"

    def at(self, draw: Draw, seq: int) -> float:
        if not self._block:
            return quantile(draw(self.purpose, seq))
        if self._draw is not draw or not -RECENT < seq - self._last <= 2 * self._block:
            self._begin(draw, seq)
        elif seq <= self._last:
            known = self._recent.get(seq)
            if known is not None:
                return known
            self._begin(draw, seq)
        while self._last < seq:
            self._step(draw)
        return self._recent[seq]

    def _begin(self, draw: Draw, seq: int) -> None:
        """Restart one block before that of `seq`."""
        self._draw = draw
        self._first = seq // self._block * self._block
        self._last = self._first - self._block - 1
        self._recent.clear()

    def _step(self, draw: Draw) -> None:
        """Advance by one number; `_after` is the recursion for the next block."""
        self._last += 1
        if self._last % self._block == 0:
            self._value, self._after = self._after, 0.0
        drawn = quantile(draw(self.purpose, self._last))
        self._value = self.correlation * self._value + drawn
        self._after = self.correlation * self._after + drawn
        if self._last >= self._first:
            self._recent[self._last] = self._scale * self._value
        self._recent.pop(self._last - RECENT, None)
