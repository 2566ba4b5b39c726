"""Sending at intervals drawn from a distribution."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Annotated, Literal

from numpy.random import Generator

from vehicles.car.gnss import Fix
from vehicles.car.sending.rule import SendingContext, SendingRule, SendingTrigger
from vehicles.schedule import MILLISECOND, SECOND
from vehicles.setting import Problem, Setting

CAM_INTERVALS = tuple(100 * MILLISECOND * k for k in range(1, 11))
CAM_SHARES = {
    "cam_vw_highway": (0.035, 0.333, 0.141, 0.389, 0.018, 0.060, 0.004, 0.004, 0.001, 0.016),
    "cam_renault_highway": (0.056, 0.184, 0.145, 0.194, 0.174, 0.098, 0.038, 0.020, 0.007, 0.083),
}
"""Shares of the intervals between cooperative awareness messages of two makers' cars on highways
(R. Molina-Masegosa, M. Sepulcre, J. Gozalvez, F. Berens, V. Martinez, "Empirical models for the
realistic generation of cooperative awareness messages in vehicular networks", IEEE TVT 69(5), 2020,
arXiv 2004.06919). Rounded there, so they add up to 1 but for a thousandth."""
JITTER_CUTOFF = 3.0
"""Standard deviations at which the normal jitter of intervals is cut off."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredIntervals(SendingRule):
    """At intervals drawn: of two makers' cars on highways (Molina-Masegosa et al., IEEE TVT 2020),
    or of one's own distribution.

    A message that is due is sent at the next tick of the vehicle's schedule.
    """  # noqa: D205 - one sentence

    table: Annotated[
        Literal["cam_vw_highway", "cam_renault_highway"] | None,
        Setting("measured distribution; or", example="cam_vw_highway"),
    ] = None
    intervals: Annotated[tuple[int, ...], Setting("intervals of one's own", "ms", 10, 60_000)] = ()
    shares: Annotated[tuple[float, ...], Setting("how often each comes", "ratio", 0, 1)] = ()
    jitter: Annotated[
        int, Setting("standard deviation about them, cut at three", "ms", 0, 1000)
    ] = 3 * MILLISECOND

    @property
    def distribution(self) -> "IntervalDistribution":
        """Intervals, how often each comes, and the jitter about them."""
        if self.table is not None:
            return IntervalDistribution(CAM_INTERVALS, CAM_SHARES[self.table], self.jitter)
        return IntervalDistribution(self.intervals, self.shares, self.jitter)

    def begin(self, context: SendingContext) -> SendingTrigger:
        return DrawnIntervalTrigger(
            self.distribution, context.start_at, context.streams("intervals")
        )

    def max_rate(self, fixes: float) -> float:
        return min(SECOND / self.distribution.shortest, fixes)

    def nominal_rate(self, fixes: float, speed: float) -> float:  # noqa: ARG002
        """Rate of the mean interval."""
        drawn = self.distribution
        whole = sum([i * s for i, s in zip(drawn.intervals, drawn.shares, strict=True)])
        return SECOND * sum(drawn.shares) / whole

    def problems(self) -> Iterator[Problem]:
        yield from SendingRule.problems(self)
        intervals, shares = len(self.intervals), len(self.shares)
        if self.table is None and not intervals:
            allowed = ", ".join(f'"{name}"' for name in CAM_SHARES)
            yield "table", f"missing, allowed {allowed}, or intervals_ms with shares_ratio"
        elif self.table is not None and (intervals or shares):
            yield "table", "given together with intervals_ms or shares_ratio, allowed one of them"
        elif intervals and intervals != shares:
            yield "shares_ratio", f"given {shares} numbers, allowed {intervals} as intervals_ms"
        elif intervals and sum(self.shares) <= 0.0:
            yield "shares_ratio", "given nothing but 0, allowed more than that for one of them"
        elif (least := min(self.distribution.intervals)) <= 4 * self.jitter:
            yield (
                "jitter_ms",
                f"given {self.jitter / MILLISECOND:g}, allowed less than a quarter of the shortest "
                f"interval, {least / MILLISECOND:g} ms",
            )

    def describe(self) -> str:
        table = self.table or f"{len(self.intervals)} intervals given"
        return f"intervals drawn: {table}, jitter {self.jitter / MILLISECOND:g} ms"


@dataclass(slots=True)
class IntervalDistribution:
    """Intervals (ns) and how often each of them comes, in any unit; jitter (ns) about them.

    Molina-Masegosa et al. (2020) measured such a distribution; shares are taken of their sum.
    """

    intervals: Sequence[int]
    shares: Sequence[float]
    jitter: int
    _sums: list[float] = field(init=False)

    def __post_init__(self) -> None:
        """Add the shares up."""
        self._sums = list(accumulate(self.shares))

    @property
    def shortest(self) -> float:
        """Least span (ns) between two instants drawn: the jitter is cut off."""
        return min(self.intervals) - JITTER_CUTOFF * self.jitter

    def draw(self, random: Generator) -> int:
        """Draw an interval (ns) by inversion of its distribution (Molina-Masegosa et al., 2020)."""
        place = bisect_right(self._sums, random.random() * self._sums[-1])
        off = min(max(float(random.standard_normal()), -JITTER_CUTOFF), JITTER_CUTOFF)
        return round(self.intervals[place] + off * self.jitter)


class DrawnIntervalTrigger:
    """Intervals drawn one by one; what is due goes at the next tick of the vehicle's schedule.

    The instants themselves are not rounded, so the mean interval stays the distribution's
    (Molina-Masegosa et al., 2020). The first lies within the first interval drawn. Where congestion
    control asks for more, the interval ends when it lets something through.
    """

    def __init__(self, shares: IntervalDistribution, start_at: int, random: Generator) -> None:
        """`random` is for these intervals alone."""
        self._shares, self._random = shares, random
        self._next = start_at + round(random.random() * shares.draw(random))

    def due(self, now: int, unsent: Fix | None, allowed_from: int) -> bool:  # noqa: ARG002
        """Whether an interval is over (Molina-Masegosa et al., 2020); then the next begins."""
        at = max(self._next, allowed_from)
        if now < at:
            return False
        while at <= now:
            at += self._shares.draw(self._random)
        self._next = at
        return True

    def sent(self, now: int, fix: Fix) -> None:
        """Nothing depends on what was sent (Molina-Masegosa et al., 2020)."""
