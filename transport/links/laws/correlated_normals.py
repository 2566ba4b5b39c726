"""Standard normal numbers that belong to the numbers of messages, correlated from one to the next.

A first-order autoregression has autocorrelation ρ^m at lag m, but its value at a number follows
from the one before, and so from all. Here it is cut into blocks of B numbers, with ρ^B no more than
FORGOTTEN: within a block it is the same recursion, begun at zero with the block before. What the
start leaves out is ρ^(2B) of the variance and of each correlation, 10^-18, less than a double shows
of 1. So the number k has one value, by the same operations in the same order, whether it is drawn
alone, at the price of up to 2 B draws, or one after another, at the price of one.
"""

from collections.abc import Callable
from math import ceil, log, sqrt
from statistics import NormalDist

from transport.links.laws.effect import Draw

RESIDUAL_WEIGHT = 1e-9
"""What is left after a block of the weight of a number's own draw."""
MAX_CORRELATION = 0.99
"""Largest correlation from one number to the next; its blocks have 2062 numbers."""
RECENT = 64
"""Up to this many numbers back, a message that comes after later ones costs no draw."""

quantile: Callable[[float], float] = NormalDist().inv_cdf
"""Of the standard normal law (Wichura, Algorithm AS 241, 1988; relative error 1e-16)."""


class CorrelatedNormals:
    """Keyed standard normal numbers with autocorrelation `correlation` ** lag, from 0 to 0.99.

    What it remembers changes no answer: the state of the recursion, and the last few numbers.
    """

    __slots__ = (
        "_after", "_block", "_draw", "_first", "_last", "_recent", "_scale", "_value",
        "correlation", "purpose",
    )  # fmt: skip

    def __init__(self, purpose: str, correlation: float = 0.0) -> None:
        """`purpose` is the word under which they are drawn. Raises ValueError."""
        if not 0.0 <= correlation <= MAX_CORRELATION:
            raise ValueError(f"correlation {correlation} is not within 0 to {MAX_CORRELATION}")
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
        """Restart with the block before that of `seq`, whose own numbers are not reached."""
        self._draw = draw
        self._first = seq // self._block * self._block
        self._last = self._first - self._block - 1
        self._recent.clear()

    def _step(self, draw: Draw) -> None:
        """Take the next number: `_after` is what the recursion will be in the next block."""
        self._last += 1
        if self._last % self._block == 0:
            self._value, self._after = self._after, 0.0
        drawn = quantile(draw(self.purpose, self._last))
        self._value = self.correlation * self._value + drawn
        self._after = self.correlation * self._after + drawn
        if self._last >= self._first:
            self._recent[self._last] = self._scale * self._value
        self._recent.pop(self._last - RECENT, None)
