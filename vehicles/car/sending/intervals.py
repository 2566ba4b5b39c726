"""Sending at random intervals."""

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
arXiv 2004.06919). Due to rounding they add up to 1 within 0.001."""
JITTER_CUTOFF = 3.0  # Cutoff of the normal jitter, in standard deviations


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredIntervals(SendingRule):
    """At random intervals: measured (Molina-Masegosa et al., IEEE TVT 2020) or configured.

    A due message is sent at the next tick of the vehicle's schedule.
    """

    table: Annotated[
        Literal["cam_vw_highway", "cam_renault_highway"] | None,
        Setting(
            "measured distribution. Alternative: intervals_ms and shares_ratio",
            example="cam_vw_highway",
        ),
    ] = None
    intervals: Annotated[tuple[int, ...], Setting("configured intervals", "ms", 10, 60_000)] = ()
    shares: Annotated[tuple[float, ...], Setting("share of each interval", "ratio", 0, 1)] = ()
    jitter: Annotated[
        int,
        Setting("standard deviation of the normal jitter, cut off at 3 deviations", "ms", 0, 1000),
    ] = 3 * MILLISECOND

    @property
    def distribution(self) -> "IntervalDistribution":
        if self.table is not None:
            return IntervalDistribution(CAM_INTERVALS, CAM_SHARES[self.table], self.jitter)
        return IntervalDistribution(self.intervals, self.shares, self.jitter)

    def begin(self, context: SendingContext) -> SendingTrigger:
        return DrawnIntervalTrigger(
            self.distribution, context.start_at, context.streams("intervals")
        )

    def max_rate(self, fixes: float) -> float:
        return min(SECOND / self.distribution.shortest, fixes)

    def nominal_rate(self, fixes: float, speed: float) -> float:
        intervals, shares = self.distribution.intervals, self.distribution.shares
        weighted = sum([i * s for i, s in zip(intervals, shares, strict=True)])
        return SECOND * sum(shares) / weighted

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
            yield "shares_ratio", "given only 0, allowed at least one share above 0"
        elif (least := min(self.distribution.intervals)) <= 4 * self.jitter:
            yield (
                "jitter_ms",
                f"given {self.jitter / MILLISECOND:g}, allowed less than a quarter of the shortest "
                f"interval, {least / MILLISECOND:g} ms",
            )

    def describe(self) -> str:
        table = self.table or f"{len(self.intervals)} configured"
        return f"random intervals: {table}, jitter {self.jitter / MILLISECOND:g} ms"


@dataclass(slots=True)
class IntervalDistribution:
    """Intervals (ns) with their shares (in any unit) and jitter (ns).

    Molina-Masegosa et al. (2020) measured such a distribution.
    """

    intervals: Sequence[int]
    shares: Sequence[float]
    jitter: int
    _sums: list[float] = field(init=False)

    def __post_init__(self) -> None:
        self._sums = list(accumulate(self.shares))

    @property
    def shortest(self) -> float:
        return min(self.intervals) - JITTER_CUTOFF * self.jitter  # ns

    def draw(self, random: Generator) -> int:
        """Draw an interval (ns) by inversion of its distribution (Molina-Masegosa et al., 2020)."""
        index = bisect_right(self._sums, random.random() * self._sums[-1])
        jitter = min(max(float(random.standard_normal()), -JITTER_CUTOFF), JITTER_CUTOFF)
        return round(self.intervals[index] + jitter * self.jitter)


class DrawnIntervalTrigger:
    """Random intervals; a due message is sent at the next tick of the vehicle's schedule.

    The due instants are not rounded to ticks, so the mean interval is that of the distribution
    (Molina-Masegosa et al., 2020). The first one is uniform within the first interval. An interval
    is extended to the minimum of congestion control.
    """

    def __init__(self, shares: IntervalDistribution, start_at: int, random: Generator) -> None:
        self._shares, self._random = shares, random
        self._next = start_at + round(random.random() * shares.draw(random))

    def due(self, now: int, unsent: Fix | None, allowed_from: int) -> bool:
        """Whether an interval ended (Molina-Masegosa et al., 2020); if so, the next one begins."""
        at = max(self._next, allowed_from)
        if now < at:
            return False
        while at <= now:
            at += self._shares.draw(self._random)
        self._next = at
        return True

    def sent(self, now: int, fix: Fix) -> None:
        """Do nothing: intervals do not depend on messages (Molina-Masegosa et al., 2020)."""
