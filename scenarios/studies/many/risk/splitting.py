"""Adaptive multilevel splitting: the probability of something rare, from paths that are branched.

Cérou and Guyader, Stochastic Analysis and Applications 25, 2007: of many paths those that came
least near are dropped, and replaced by copies of others that go on differently from where they came
nearer than those. Unbiased also where many paths came equally near, as where messages are lost or
are not: all of these are dropped at once (Bréhier, Gazeau, Goudenège, Lelièvre and Rousset, Annals
of Applied Probability 26, 2016, Section 3).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, sqrt
from statistics import fmean, stdev
from typing import Generic, Protocol, TypeVar

from numpy.random import Generator

from scenarios.results.channel.estimates import CONFIDENCE


class BranchablePath(Protocol):
    """A path whose `severity` is the largest it ever had: inf if it broke the limit."""

    @property
    def severity(self) -> float:
        """How near it came."""
        ...


AnyPath = TypeVar("AnyPath", bound=BranchablePath)
Begin = Callable[[int], AnyPath]
"""Makes a path from a seed."""
Continue = Callable[[AnyPath, float, int], AnyPath]
"""Copies a path up to the first instant at which its severity is above a level; what is random
after that instant comes from a seed."""


@dataclass(frozen=True, slots=True)
class Repetition(Generic[AnyPath]):
    """One estimate: `paths` are those left at the end, `runs` how many were run in all.

    `levels` are the severities at which paths were dropped, in order. It is `extinct` if all paths
    came equally near at one of them: then the estimate is 0.
    """

    estimate: float
    paths: tuple[AnyPath, ...]
    runs: int
    levels: tuple[float, ...]
    extinct: bool


def split(
    count: int,
    begin: Begin[AnyPath],
    go_on: Continue[AnyPath],
    random: Generator,
    *,
    most_runs: float = inf,
) -> Repetition[AnyPath]:
    """Estimate the chance that a path breaks the limit, with `count` paths at a time.

    Ends when all of them break it, or none is left to be copied. After `most_runs` runs it ends
    where it is: the share of paths that break the limit by then, times the chance of the level, is
    unbiased too, only less certain. Raises ValueError for fewer than two paths.
    """
    if count < 2:
        raise ValueError(f"{count} paths cannot be branched")
    paths = [begin(_seed(random)) for _ in range(count)]
    chance, runs, levels = 1.0, count, list[float]()
    while (level := min(one.severity for one in paths)) < inf and runs < most_runs:
        alive = [one for one in paths if one.severity > level]
        levels.append(level)
        if not alive:
            return Repetition(0.0, tuple(paths), runs, tuple(levels), extinct=True)
        chance *= len(alive) / count
        for place, one in enumerate(paths):
            if one.severity <= level:
                parent = alive[int(random.integers(len(alive)))]
                paths[place] = go_on(parent, level, _seed(random))
                runs += 1
    broken = sum(one.severity == inf for one in paths)
    return Repetition(chance * broken / count, tuple(paths), runs, tuple(levels), extinct=False)


def _seed(random: Generator) -> int:
    """A seed that hardly any other path has."""
    return int(random.integers(2**63))


@dataclass(frozen=True, slots=True)
class Mean:
    """The mean of independent estimates with its standard error and interval, none below 0."""

    value: float
    standard_error: float
    low: float
    high: float


def mean_of(estimates: Sequence[float], confidence: float = CONFIDENCE) -> Mean:
    """Mean of independent unbiased estimates, with Student's interval (1908).

    The estimates are skewed to the right, so that with few of them, or few paths each, the
    interval lies a little low. Raises ValueError for fewer than two.
    """
    from scipy.stats import t  # noqa: PLC0415 - an extra

    if len(estimates) < 2:
        raise ValueError(f"no interval of {len(estimates)} estimates")
    value = fmean(estimates)
    error = stdev(estimates) / sqrt(len(estimates))
    half = float(t.ppf(0.5 + 0.5 * confidence, len(estimates) - 1)) * error
    return Mean(value, error, max(0.0, value - half), min(1.0, value + half))
