"""Runs as paths that can be branched: up to an instant bit for bit as before, then other draws.

A copy is a run from the start with the same seed, whose draws come from other seeds after the
instants of its branches. What these are of, see VehicleBuilder.redraw: what is drawn once for a run
is drawn anew only with the run. That costs certainty where it decides, and biases nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from scenarios.definition.scenario import Scenario
from scenarios.runs.virtual.convoy import Branch
from scenarios.studies.many.limit import Limit
from scenarios.studies.many.risk.splitting import Repetition, split
from scenarios.studies.many.variant import Variant
from scenarios.studies.many.watched import (
    Measure,
    Watched,
    after_start_s,
    watched,
    with_seed,
)


@dataclass(frozen=True, slots=True)
class BranchedRun:
    """One run: its seed, its branches in order of time, and what was seen of it."""

    seed: int
    branches: tuple[Branch, ...]
    watched: Watched

    @property
    def severity(self) -> float:
        """How near it came to the limit, inf if it broke it."""
        return self.watched.severity


Run = Callable[[int, tuple[Branch, ...]], BranchedRun]
"""Drives with a seed and branches."""


@dataclass(frozen=True)
class Splitting:
    """What one repetition needs: a run and its limit, how many paths, how many runs at most."""

    variant: Variant
    limit: Limit
    measure: Measure
    paths: int
    most_runs: int

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario of all its runs, but for the seed."""
        return self.variant.scenario

    def run(self, seed: int, branches: tuple[Branch, ...] = ()) -> BranchedRun:
        """Drive with a seed and branches."""
        scenario = with_seed(self.scenario, seed)
        found = watched(scenario, self.limit, branches=branches, measure=self.measure)
        return BranchedRun(seed, branches, found)


def gone_on(run: Run, parent: BranchedRun, level: float, seed: int) -> BranchedRun:
    """Drive as `parent` until it came nearer to the limit than `level`, then otherwise."""
    at = next(one.at for one in parent.watched.records if one.value > level)
    before = tuple(branch for branch in parent.branches if branch.at < at)
    return run(parent.seed, (*before, Branch(at, seed)))


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskEstimate:
    """What is kept of a repetition; `worst` is the seed and the branches of its worst run."""

    probability: float
    runs: int
    levels: int
    extinct: bool
    worst: dict[str, Any]


def repeated(work: Splitting, number: int) -> RiskEstimate:
    """Carry out repetition `number`: its draws depend on the scenario's seed and on that."""
    random = np.random.Generator(np.random.PCG64([work.scenario.seed, number]))
    found: Repetition[BranchedRun] = split(
        work.paths, work.run, partial(gone_on, work.run), random, most_runs=work.most_runs
    )
    worst = max(found.paths, key=lambda one: one.severity)
    branches = [
        {"after_s": after_start_s(work.scenario, branch.at), "seed": branch.seed}
        for branch in worst.branches
    ]
    return RiskEstimate(
        probability=found.estimate,
        runs=found.runs,
        levels=len(found.levels),
        extinct=found.extinct,
        worst={"broken": worst.watched.broken, "seed": worst.seed, "branches": branches},
    )
