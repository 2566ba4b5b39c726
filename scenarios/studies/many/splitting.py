"""Probabilities of rare events by adaptive multilevel splitting.

At each level the paths with the smallest severity are dropped. Copies of other paths replace them,
with new random numbers from the instant at which they exceeded that severity (Cérou and Guyader,
Stochastic Analysis and Applications 25, 2007). All paths of equal severity are dropped together,
which keeps the estimate unbiased (Bréhier, Gazeau, Goudenège, Lelièvre and Rousset, Annals of
Applied Probability 26, 2016, Section 3).
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
    """A path with its largest `severity`: inf if it broke the limit."""

    @property
    def severity(self) -> float: ...


AnyPath = TypeVar("AnyPath", bound=BranchablePath)
StartPath = Callable[[int], AnyPath]
ContinuePath = Callable[[AnyPath, float, int], AnyPath]
"""Copies a path up to the first instant at which its severity exceeds a level, then continues with
random numbers from a seed."""


@dataclass(frozen=True, slots=True)
class Repetition(Generic[AnyPath]):
    """One estimate, with the final `paths` and the number of all `runs`.

    `levels` are the severities at which paths were dropped, in ascending order. It is `extinct` if
    all paths had the same severity at a level; the estimate is then 0.
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

    Stops when all paths break it, when all have the same severity, or after `max_runs` runs. The
    estimate is then the probability of the level times the share of paths that break the limit,
    which is unbiased as well. Raises ValueError for fewer than two paths.
    """
    if count < 2:
        raise ValueError(f"{count} paths cannot be branched")
    paths = [start_path(_seed(random)) for _ in range(count)]
    probability, runs, levels = 1.0, count, list[float]()
    while (level := min(path.severity for path in paths)) < inf and runs < max_runs:
        survivors = [path for path in paths if path.severity > level]
        levels.append(level)
        if not survivors:
            return Repetition(0.0, tuple(paths), runs, tuple(levels), extinct=True)
        probability *= len(survivors) / count
        for index, path in enumerate(paths):
            if path.severity <= level:
                parent = survivors[int(random.integers(len(survivors)))]
                paths[index] = continue_path(parent, level, _seed(random))
                runs += 1
    broken = sum(path.severity == inf for path in paths)
    estimate = probability * broken / count
    return Repetition(estimate, tuple(paths), runs, tuple(levels), extinct=False)


def _seed(random: Generator) -> int:
    return int(random.integers(2**63))


# ---- Runs as paths
#
# A copy is simulated from the start with the seed of its parent. Random numbers change to another
# seed after the instant of each branch. Values that are drawn once per run stay, see
# VehicleBuilder.redraw: this can increase the variance, but adds no bias.


@dataclass(frozen=True, slots=True)
class BranchedRun:
    """A run with its branches in order of time."""

    seed: int
    branches: tuple[Branch, ...]
    history: LimitHistory

    @property
    def severity(self) -> float:
        return self.history.severity


Run = Callable[[int, tuple[Branch, ...]], BranchedRun]


@dataclass(frozen=True)
class Splitting:
    """Parameters of a repetition: a run, its limit, and the numbers of paths and runs."""

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
        history = watch_limit(scenario, self.limit, branches=branches, measure=self.measure)
        return BranchedRun(seed, branches, history)


def continue_run(run: Run, parent: BranchedRun, level: float, seed: int) -> BranchedRun:
    """Repeat `parent` until its severity exceeds `level`, then continue with another seed."""
    at = next(record.at for record in parent.history.records if record.value > level)
    before = tuple(branch for branch in parent.branches if branch.at < at)
    return run(parent.seed, (*before, Branch(at, seed)))


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskEstimate:
    """Result of a repetition; `worst` holds seed and branches of the most severe run."""

    probability: float
    runs: int
    levels: int
    extinct: bool
    worst: dict[str, Any]


def run_repetition(work: Splitting, number: int) -> dict[str, Any]:
    """Run repetition `number` and return the fields of a `RiskEstimate`.

    Random numbers depend on the seed of the scenario and on `number`.
    """
    random = Generator(PCG64([work.scenario.seed, number]))
    repetition: Repetition[BranchedRun] = split(
        work.paths, work.run, partial(continue_run, work.run), random, max_runs=work.max_runs
    )
    worst = max(repetition.paths, key=lambda run: run.severity)
    branches = [
        {"after_s": (branch.at - work.scenario.start_at_ns) / SECOND, "seed": branch.seed}
        for branch in worst.branches
    ]
    return {
        "probability": repetition.estimate,
        "runs": repetition.runs,
        "levels": len(repetition.levels),
        "extinct": repetition.extinct,
        "worst": {"broken": worst.history.broken, "seed": worst.seed, "branches": branches},
    }
