"""How many seeds break a limit at each value tried, and where their share crosses the wanted one.

The crossing is found by bisection of the counts, not of each seed's own boundary: a seed that
breaks the limit at a value may hold it at a larger one, as where a follower that receives too
little stops in its lane.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, inf

from scenarios.results.channel.estimates import CONFIDENCE
from scenarios.studies.many.statistics import wilson

FIRST_SEEDS = 8
"""Seeds with which a value is tried first: if all of them agree, the interval of Wilson is below
or above one half."""
COARSE_PARTS = 4
"""Parts of the range whose ends are tried first; then those of twice as many parts."""

Sample = tuple[int, int]
"""Number of a value, and a seed."""
RunSamples = Callable[[Sequence[Sample]], Mapping[Sample, bool]]
"""Returns for each place whether the run with that value and that seed breaks the limit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SharePoint:
    """The share of runs that broke the limit at a value, with its Wilson interval."""

    value: float
    runs: int
    broken: int
    share: float
    low: float
    high: float


class ShareCurve:
    """Outcomes at numbered values in ascending order; the same seeds 1, 2, … at each of them.

    A value is `beyond` if at least the wanted share of its seeds break the limit; with a share of
    0 if one does.
    """

    def __init__(
        self, values: Sequence[float], share: float, seeds: int, run_samples: RunSamples
    ) -> None:
        self.values, self.share, self.seeds = values, share, range(1, seeds + 1)
        self._run_samples = run_samples
        self._broke: defaultdict[int, dict[int, bool]] = defaultdict(dict)

    def run_seeds(self, numbers: Sequence[int], seeds: int | None = None) -> None:
        """Try these values with the first `seeds` seeds, or all, unless that was done."""
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
        """Numbers of the tried values, ascending."""
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
        """Whether the share there is at least the wanted one."""
        point = self.point(number)
        return point.broken >= max(1, ceil(self.share * point.runs - 1e-9))

    def is_settled(self, number: int) -> bool:
        """Whether more seeds could hardly change that, by the interval or as all were tried."""
        point = self.point(number)
        if self.is_complete(number):
            return True
        if self.share == 0.0:
            return point.broken > 0
        return point.high < self.share or point.low > self.share

    def is_complete(self, number: int) -> bool:
        return len(self._broke[number]) == len(self.seeds)

    def changes(self) -> Iterator[tuple[int, int]]:
        """Yield neighbouring tried values of which one is beyond and the other not."""
        for low, high in pairwise(self.evaluated):
            if self.reaches_share(low) != self.reaches_share(high):
                yield low, high

    def non_monotone_seeds(self) -> list[int]:
        """Seeds that change more than once between broken and held as the value grows."""
        found = []
        for seed in self.seeds:
            broke = [
                self._broke[number][seed]
                for number in self.evaluated
                if seed in self._broke[number]
            ]
            if sum(before != after for before, after in pairwise(broke)) > 1:
                found.append(seed)
        return found


class NoBoundaryError(Exception):
    """The share is on the same side at all values tried."""


@dataclass(frozen=True, slots=True)
class Bracket:
    """Numbers of the neighbouring values between which the share crosses the wanted one.

    `sure` are values (not numbers) between which it does so with confidence, -inf or inf if no
    tried value is surely on that side, or with a share of 0.
    """

    low: int
    high: int
    confident: tuple[float, float]


def bracket(curve: ShareCurve) -> Bracket:
    """Bracket the first crossing from the low end, between two neighbours.

    On both sides of it all seeds run in the end. Raises NoBoundaryError.
    """
    last = len(curve.values) - 1
    for parts in (COARSE_PARTS, 2 * COARSE_PARTS):
        curve.run_seeds(sorted({last * part // parts for part in range(parts + 1)}), FIRST_SEEDS)
        while (pair := next(curve.changes(), None)) is not None:
            low, high = pair
            near = high - low == 1
            unsure = [
                number
                for number in pair
                if not (curve.is_complete(number) if near else curve.is_settled(number))
            ]
            if unsure:
                curve.run_seeds(unsure)
            elif near:
                return Bracket(low, high, _confident_values(curve, low, high))
            else:
                curve.run_seeds([(low + high) // 2], FIRST_SEEDS)
    curve.run_seeds([0, last])
    if next(curve.changes(), None) is not None:
        return bracket(curve)
    raise NoBoundaryError


def _confident_values(curve: ShareCurve, low: int, high: int) -> tuple[float, float]:
    """The nearest tried values, down from `low` and up from `high`, whose interval excludes it.

    Together all intervals have a confidence of 95 % (Bonferroni).
    """
    if curve.share == 0.0:
        return -inf, inf
    rising = curve.reaches_share(high)

    confidence = 1.0 - (1.0 - CONFIDENCE) / len(curve.evaluated)

    def surely(number: int, *, beyond: bool) -> bool:
        point = curve.point(number)
        least, most = wilson(point.broken, point.runs, confidence)
        return least > curve.share if beyond else most < curve.share

    below = [one for one in curve.evaluated if one <= low and surely(one, beyond=not rising)]
    above = [one for one in curve.evaluated if one >= high and surely(one, beyond=rising)]
    return (
        curve.values[below[-1]] if below else -inf,
        curve.values[above[0]] if above else inf,
    )
