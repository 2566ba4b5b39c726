"""Share of seeds that break a limit over the value of a key, and bisection of it.

The bisection uses the counts of all seeds, because single seeds need not be monotone: a follower
that receives too little stops in its lane and then keeps the limit again.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, inf

from scenarios.results.channel.estimates import CONFIDENCE
from scenarios.studies.many.statistics import wilson

FIRST_SEEDS = 8
"""Seeds simulated first: if all agree, the Wilson interval excludes one half."""
COARSE_PARTS = 4
"""Parts of the range of the first pass; the second pass has twice as many."""

Sample = tuple[int, int]
"""Index of a value, and a seed."""
RunSamples = Callable[[Sequence[Sample]], Mapping[Sample, bool]]
"""Returns for each sample whether its run breaks the limit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SharePoint:
    """Share of runs that broke the limit at a value, with its 95 % Wilson interval."""

    value: float
    runs: int
    broken: int
    share: float
    low: float
    high: float


class ShareCurve:
    """Outcomes at ascending values, by index, with the same seeds 1, 2, … at each value.

    A value reaches the `share` if at least that share of its seeds break the limit. A share of 0
    needs one seed.
    """

    def __init__(
        self, values: Sequence[float], share: float, seeds: int, run_samples: RunSamples
    ) -> None:
        self.values, self.share, self.seeds = values, share, range(1, seeds + 1)
        self._run_samples = run_samples
        self._broke: defaultdict[int, dict[int, bool]] = defaultdict(dict)

    def run_seeds(self, numbers: Sequence[int], seeds: int | None = None) -> None:
        """Simulate values with the first `seeds` seeds (default: all), each sample once."""
        samples = [
            (number, seed)
            for number in numbers
            for seed in self.seeds[:seeds]
            if seed not in self._broke[number]
        ]
        if samples:
            for (number, seed), broke in sorted(self._run_samples(samples).items()):
                self._broke[number][seed] = broke

    @property
    def evaluated(self) -> list[int]:
        """Indices of the simulated values, ascending."""
        return sorted(self._broke)

    @property
    def runs(self) -> int:
        return sum(map(len, self._broke.values()))

    def point(self, number: int) -> SharePoint:
        broke = self._broke[number]
        runs, broken = len(broke), sum(broke.values())
        low, high = wilson(broken, runs)
        return SharePoint(
            value=self.values[number],
            runs=runs,
            broken=broken,
            share=broken / runs,
            low=low,
            high=high,
        )

    def broken_seeds(self, number: int) -> list[int]:
        return sorted(seed for seed, broke in self._broke[number].items() if broke)

    def reaches_share(self, number: int) -> bool:
        point = self.point(number)
        return point.broken >= max(1, ceil(self.share * point.runs - 1e-9))

    def is_settled(self, number: int) -> bool:
        """Whether more seeds are unlikely to change `reaches_share`."""
        point = self.point(number)
        if self.is_complete(number):
            return True
        if self.share == 0.0:
            return point.broken > 0
        return point.high < self.share or point.low > self.share

    def is_complete(self, number: int) -> bool:
        return len(self._broke[number]) == len(self.seeds)

    def changes(self) -> Iterator[tuple[int, int]]:
        """Yield neighbouring values of which only one reaches the share."""
        for low, high in pairwise(self.evaluated):
            if self.reaches_share(low) != self.reaches_share(high):
                yield low, high

    def non_monotone_seeds(self) -> list[int]:
        """Seeds that switch more than once between broken and kept as the value grows."""
        turning = []
        for seed in self.seeds:
            broke = [
                self._broke[number][seed]
                for number in self.evaluated
                if seed in self._broke[number]
            ]
            if sum(before != after for before, after in pairwise(broke)) > 1:
                turning.append(seed)
        return turning


class NoBoundaryError(Exception):
    """No simulated value, or every one, reaches the share."""


@dataclass(frozen=True, slots=True)
class Bracket:
    """Indices of the neighbouring values between which the share is reached.

    `confident` are the values between which this happens with 95 % confidence; -inf or inf without
    such a value, or for a share of 0.
    """

    low: int
    high: int
    confident: tuple[float, float]


def bracket(curve: ShareCurve) -> Bracket:
    """Bracket the lowest crossing between two neighbours, each simulated with all seeds.

    Raises NoBoundaryError.
    """
    last = len(curve.values) - 1
    for parts in (COARSE_PARTS, 2 * COARSE_PARTS):
        curve.run_seeds(sorted({last * part // parts for part in range(parts + 1)}), FIRST_SEEDS)
        while (pair := next(curve.changes(), None)) is not None:
            low, high = pair
            adjacent = high - low == 1
            undecided = [
                number
                for number in pair
                if not (curve.is_complete(number) if adjacent else curve.is_settled(number))
            ]
            if undecided:
                curve.run_seeds(undecided)
            elif adjacent:
                return Bracket(low, high, _confident_values(curve, low, high))
            else:
                curve.run_seeds([(low + high) // 2], FIRST_SEEDS)
    curve.run_seeds([0, last])
    if next(curve.changes(), None) is not None:
        return bracket(curve)
    raise NoBoundaryError


def _confident_values(curve: ShareCurve, low: int, high: int) -> tuple[float, float]:
    """Nearest simulated values on either side whose interval excludes the share.

    The joint confidence of all intervals is 95 % (Bonferroni).
    """
    if curve.share == 0.0:
        return -inf, inf
    rising = curve.reaches_share(high)
    confidence = 1.0 - (1.0 - CONFIDENCE) / len(curve.evaluated)

    def excludes(number: int, *, reached: bool) -> bool:
        point = curve.point(number)
        lower, upper = wilson(point.broken, point.runs, confidence)
        return lower > curve.share if reached else upper < curve.share

    below = [k for k in curve.evaluated if k <= low and excludes(k, reached=not rising)]
    above = [k for k in curve.evaluated if k >= high and excludes(k, reached=rising)]
    return (
        curve.values[below[-1]] if below else -inf,
        curve.values[above[0]] if above else inf,
    )
