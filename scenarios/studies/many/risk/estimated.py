"""The probability that one run breaks a limit: by counting runs, or by splitting them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Literal

from scenarios.definition.errors import ScenarioError
from scenarios.runs.pool import RunAll
from scenarios.studies.many.intervals import clopper_pearson
from scenarios.studies.many.limit import Limit
from scenarios.studies.many.risk.branched import RiskEstimate, Splitting, repeated
from scenarios.studies.many.risk.splitting import mean_of
from scenarios.studies.many.variant import Variant
from scenarios.studies.many.watched import Measure, watched, with_seed

Method = Literal["counting", "splitting", "auto"]
BATCH = 20
"""Runs that one job counts."""
FIRST_RUNS, FEW = 200, 5
"""Where fewer of the first runs break the limit, counting on is the longer way."""
ROUND = 10
"""Repetitions between two looks at how certain the mean is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskQuestion:
    """What is asked: `limit` of one run of `variant`, until the interval is narrow enough.

    `to` is half of the interval's width over the estimate; no more than `most_runs` are begun, but
    for what a repetition needs to end. Repetitions follow `paths` runs at a time.
    """

    variant: Variant
    limit: Limit
    method: Method = "auto"
    measure: Measure = "limit"
    to: float = 0.5
    most_runs: int = 2000
    paths: int = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class Risk:
    """The probability with its interval of 95 %, and what it was worked out from.

    By counting, `broken` are the seeds that broke the limit; by splitting, `repetitions` are the
    independent estimates whose mean it is.
    """

    method: Literal["counting", "splitting"]
    interval: str
    probability: float
    low: float
    high: float
    standard_error: float
    runs: int
    broken: tuple[int, ...] = ()
    repetitions: tuple[RiskEstimate, ...] = ()

    @property
    def relative_half_width(self) -> float:
        """Half of the interval over the estimate; inf if that is 0."""
        return 0.5 * (self.high - self.low) / self.probability if self.probability else float("inf")


def risk_of(question: RiskQuestion, run_all: RunAll, progress: Callable[[str], None]) -> Risk:
    """Answer it; raises ScenarioError if the scenario is refused."""
    if question.method == "splitting":
        return _split(question, 0, run_all, progress)
    most = question.most_runs
    begun = min(FIRST_RUNS, most) if question.method == "auto" else most
    found = _count(question, begun, run_all, progress)
    if question.method == "counting" or begun == most:
        return found
    if len(found.broken) >= FEW:
        return _count(question, most, run_all, progress, found)
    progress(f"{len(found.broken)} of {begun} runs broke the limit: splitting from here on")
    return _split(question, begun, run_all, progress)


def counted(variant: Variant, limit: Limit, seeds: Sequence[int]) -> list[int]:
    """Drive with each of the seeds; those that broke the limit."""
    scenario = variant.scenario
    return [seed for seed in seeds if watched(with_seed(scenario, seed), limit).broken]


def _count(
    question: RiskQuestion,
    most: int,
    run_all: RunAll,
    progress: Callable[[str], None],
    before: Risk | None = None,
) -> Risk:
    """Count from the seed after those `before` on: twice as many runs each time, up to `most`."""
    done, broken = (before.runs, list(before.broken)) if before else (0, [])
    while True:
        until = min(max(2 * done, FIRST_RUNS), most)
        seeds = range(done + 1, until + 1)
        jobs = {
            at: partial(counted, question.variant, question.limit, seeds[at : at + BATCH])
            for at in range(0, len(seeds), BATCH)
        }
        broken += sorted(chain.from_iterable(seeds for _, seeds in run_all(jobs)))
        done = until
        risk = _by_counting(broken, done)
        progress(f"{len(broken)} of {done} runs broke the limit")
        if done == most or risk.relative_half_width <= question.to:
            return risk


def _by_counting(broken: Sequence[int], runs: int) -> Risk:
    share = len(broken) / runs
    low, high = clopper_pearson(len(broken), runs)
    return Risk(
        method="counting",
        interval="Clopper and Pearson's, exact",
        probability=share,
        low=low,
        high=high,
        standard_error=(share * (1.0 - share) / runs) ** 0.5,
        runs=runs,
        broken=tuple(broken),
    )


def _split(
    question: RiskQuestion, begun: int, run_all: RunAll, progress: Callable[[str], None]
) -> Risk:
    """Repeat the splitting in rounds, until the mean is certain enough or the runs are used up."""
    most = question.most_runs - begun
    if most < ROUND * question.paths:
        raise ScenarioError(
            [f"--runs: given {question.most_runs}, allowed at least {begun} + {ROUND} repetitions "
             f"of {question.paths} paths"]
        )  # fmt: skip
    work = Splitting(
        variant=question.variant,
        limit=question.limit,
        measure=question.measure,
        paths=question.paths,
        most_runs=most // ROUND,
    )
    found: list[RiskEstimate] = []
    while True:
        first = len(found)
        jobs = {number: partial(repeated, work, number) for number in range(first, first + ROUND)}
        found += [one for _, one in sorted(run_all(jobs), key=lambda pair: pair[0])]
        risk = _by_splitting(found, begun)
        progress(f"{len(found)} repetitions, {risk.runs} runs: {risk.probability:.3g}")
        used = risk.runs - begun
        if risk.relative_half_width <= question.to or used * (1 + ROUND / len(found)) > most:
            return risk


def _by_splitting(found: Sequence[RiskEstimate], begun: int) -> Risk:
    mean = mean_of([one.probability for one in found])
    return Risk(
        method="splitting",
        interval=f"Student's, of {len(found)} independent repetitions",
        probability=mean.value,
        low=mean.low,
        high=mean.high,
        standard_error=mean.standard_error,
        runs=begun + sum(one.runs for one in found),
        repetitions=tuple(found),
    )
