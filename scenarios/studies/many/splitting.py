"""Adaptive multilevel splitting: the probability of something rare, from paths that are branched.

Cérou and Guyader, Stochastic Analysis and Applications 25, 2007: of many paths those that came
least near are dropped, and replaced by copies of others that go on differently from where they came
nearer than those. Unbiased also where many paths came equally near, as where messages are lost or
are not: all of these are dropped at once (Bréhier, Gazeau, Goudenège, Lelièvre and Rousset, Annals
of Applied Probability 26, 2016, Section 3).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from math import inf
from typing import Any, Generic, Protocol, TypeVar

from numpy.random import PCG64, Generator

from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import Scenario
from scenarios.runs.virtual.virtual_convoy import Branch
from scenarios.studies.many.limit_history import LimitHistory, Measure, watch_limit, with_seed
from scenarios.studies.many.variant import Variant
from vehicles.schedule import SECOND


class BranchablePath(Protocol):
    """A path whose `severity` is the largest it ever had: inf if it broke the limit."""

    @property
    def severity(self) -> float: ...


AnyPath = TypeVar("AnyPath", bound=BranchablePath)
StartPath = Callable[[int], AnyPath]
"""Makes a path from a seed."""
ContinuePath = Callable[[AnyPath, float, int], AnyPath]
"""Copies a path up to the first instant at which its severity is above a level; what is random
after that instant comes from a seed."""


@dataclass(frozen=True, slots=True)
class Repetition(Generic[AnyPath]):
    """One estimate: `paths` are those left at the end, `runs` the number of all.

    `levels` are the severities at which paths were dropped, in order. It is `extinct` if all paths
    had the same severity at one of them: then the estimate is 0.
    """

    estimate: float
    paths: tuple[AnyPath, ...]
    runs: int
    levels: tuple[float, ...]
    extinct: bool


def split(
    count: int,
    start_path: StartPath[AnyPath],
    continue_path: ContinuePath[AnyPath],
    random: Generator,
    *,
    max_runs: float = inf,
) -> Repetition[AnyPath]:
    """Estimate the probability that a path breaks the limit, with `count` paths at a time.

    Ends when all of them break it, or none is left to be copied. It also ends after `max_runs`
    runs: the share of paths that break the limit by then, times the probability of the level, is
    unbiased too, only less certain. Raises ValueError for fewer than two paths.
    """
    if count < 2:
        raise ValueError(f"{count} paths cannot be branched")
    paths = [start_path(_seed(random)) for _ in range(count)]
    chance, runs, levels = 1.0, count, list[float]()
    while (level := min(one.severity for one in paths)) < inf and runs < max_runs:
        survivors = [one for one in paths if one.severity > level]
        levels.append(level)
        if not survivors:
            return Repetition(0.0, tuple(paths), runs, tuple(levels), extinct=True)
        chance *= len(survivors) / count
        for place, one in enumerate(paths):
            if one.severity <= level:
                parent = survivors[int(random.integers(len(survivors)))]
                paths[place] = continue_path(parent, level, _seed(random))
                runs += 1
    broken = sum(one.severity == inf for one in paths)
    return Repetition(chance * broken / count, tuple(paths), runs, tuple(levels), extinct=False)


def _seed(random: Generator) -> int:
    """Draw a seed that hardly any other path has."""
    return int(random.integers(2**63))


# ---- Runs as such paths
#
# A path is a run up to an instant, bit for bit as before, and then other draws. A copy is a run
# from the start with the same seed, whose draws come from other seeds after the instants of its
# branches. For what is drawn again see VehicleBuilder.redraw: what is drawn once for a run stays.
# That costs certainty where it decides, and biases nothing.


@dataclass(frozen=True, slots=True)
class BranchedRun:
    """One run: its seed, its branches in order of time, and its records."""

    seed: int
    branches: tuple[Branch, ...]
    history: LimitHistory

    @property
    def severity(self) -> float:
        return self.history.severity


Run = Callable[[int, tuple[Branch, ...]], BranchedRun]
"""Drives with a seed and branches."""


@dataclass(frozen=True)
class Splitting:
    """The parameters of a repetition: a run and its limit, numbers of paths and of runs."""

    variant: Variant
    limit: Limit
    measure: Measure
    paths: int
    max_runs: int

    @cached_property
    def scenario(self) -> Scenario:
        return self.variant.scenario

    def run(self, seed: int, branches: tuple[Branch, ...] = ()) -> BranchedRun:
        scenario = with_seed(self.scenario, seed)
        found = watch_limit(scenario, self.limit, branches=branches, measure=self.measure)
        return BranchedRun(seed, branches, found)


def continue_run(run: Run, parent: BranchedRun, level: float, seed: int) -> BranchedRun:
    """Repeat `parent` until its severity exceeds `level`, then continue with another seed."""
    at = next(one.at for one in parent.history.records if one.value > level)
    before = tuple(branch for branch in parent.branches if branch.at < at)
    return run(parent.seed, (*before, Branch(at, seed)))


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskEstimate:
    """The result of a repetition; `worst` holds seed and branches of its worst run."""

    probability: float
    runs: int
    levels: int
    extinct: bool
    worst: dict[str, Any]


def run_repetition(work: Splitting, number: int) -> dict[str, Any]:
    """Carry out repetition `number`: its draws depend on the scenario's seed and on that.

    Returns the fields of a `RiskEstimate`.
    """
    random = Generator(PCG64([work.scenario.seed, number]))
    found: Repetition[BranchedRun] = split(
        work.paths, work.run, partial(continue_run, work.run), random, max_runs=work.max_runs
    )
    worst = max(found.paths, key=lambda one: one.severity)
    branches = [
        {"after_s": (branch.at - work.scenario.start_at_ns) / SECOND, "seed": branch.seed}
        for branch in worst.branches
    ]
    return {
        "probability": found.estimate,
        "runs": found.runs,
        "levels": len(found.levels),
        "extinct": found.extinct,
        "worst": {"broken": worst.history.broken, "seed": worst.seed, "branches": branches},
    }
