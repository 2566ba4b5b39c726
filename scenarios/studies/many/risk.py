"""Probability that a run breaks a limit, by counting runs or by splitting."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from scenarios.definition.errors import ScenarioError
from scenarios.definition.run_limits import Limit
from scenarios.studies.engine.engine import Engine, study_engine
from scenarios.studies.engine.job import Job
from scenarios.studies.engine.results import write_files
from scenarios.studies.engine.workers import OpenWorkers
from scenarios.studies.many.limit_history import Measure
from scenarios.studies.many.splitting import RiskEstimate, Splitting, run_repetition
from scenarios.studies.many.statistics import clopper_pearson, mean_of
from scenarios.studies.many.variant import Variant, identity_of

Method = Literal["counting", "splitting", "auto"]
SCHEMA = "convoy.risk/1"
JSON_FILE = "risk.json"
NO_COMMAND = "no command repeats a branched run; its seed and branches are in risk.json"
FIRST_RUNS, ENOUGH_BROKEN = 200, 5
"""Splitting needs fewer runs if fewer than 5 of the first 200 break the limit."""
REPETITIONS_PER_ROUND = 10
"""Repetitions between two checks of the precision."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskQuery:
    """Estimation of the probability that a run of `variant` breaks `limit`.

    It stops at the relative half-width `precision` of the interval, or after `max_runs` runs and
    the end of the current repetition. A repetition has `paths` runs at a time.
    """

    variant: Variant
    limit: Limit
    method: Method = "auto"
    measure: Measure = "limit"
    precision: float = 0.5
    max_runs: int = 2000
    paths: int = 50

    def identity(self) -> dict[str, Any]:
        """Everything that the result depends on, named as on the command line."""
        return identity_of(
            self.variant,
            limit=str(self.limit),
            method=self.method,
            measure=self.measure,
            precision=self.precision,
            runs=self.max_runs,
            paths=self.paths,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Risk:
    """The probability with its 95 % confidence interval.

    `broken` are the seeds that broke the limit (counting), `repetitions` the independent estimates
    of which it is the mean (splitting).
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
        """Half the width of the interval over the estimate; inf if the estimate is 0."""
        return 0.5 * (self.high - self.low) / self.probability if self.probability else float("inf")


def run_risk(
    query: RiskQuery, out: Path | None, open_workers: OpenWorkers, report: Callable[[str], None]
) -> Risk:
    """Estimate a probability; an interrupted estimation resumes in the folder `out`.

    Without a folder, nothing is written. Raises ScenarioError for too few runs.
    """
    with study_engine(
        open_workers, report, out=out, files=(JSON_FILE,), identity=query.identity()
    ) as engine:
        risk = estimate_risk(query, engine)
        if out is not None:
            write_files(out, {JSON_FILE: machine_readable(query, risk)})
        return risk


def estimate_risk(query: RiskQuery, engine: Engine) -> Risk:
    live = query.limit.row.live
    can_split = live != "end" and (bool(live) or query.measure == "silence")
    if query.method == "splitting":
        if not can_split:
            wrong = f"given splitting, but no figure approaches the limit {query.limit}"
            instead = "counting" if live == "end" else "counting or --measure silence"
            raise ScenarioError([f"--method: {wrong}; use {instead}"])
        return _split(query, 0, engine)
    most = query.max_runs
    counts_only = query.method == "counting" or not can_split
    counted_runs = most if counts_only else min(FIRST_RUNS, most)
    risk = _count(query, counted_runs, engine)
    if counted_runs == most:
        return risk
    if len(risk.broken) >= ENOUGH_BROKEN:
        return _count(query, most, engine, risk)
    engine.report(
        f"{len(risk.broken)} of {counted_runs} runs broke the limit; continuing by splitting"
    )
    return _split(query, counted_runs, engine)


def _count(query: RiskQuery, most: int, engine: Engine, before: Risk | None = None) -> Risk:
    """Count broken limits, doubling the number of runs until precise enough, up to `most`.

    Continues after the seeds of `before`.
    """
    done, broken = (before.runs, list(before.broken)) if before else (0, [])
    while True:
        until = min(max(2 * done, FIRST_RUNS), most)
        variants = [replace(query.variant, seed=seed) for seed in range(done + 1, until + 1)]
        jobs = [
            Job(
                key=f"seed {variant.seed}",
                work=partial(variant.breaks, query.limit),
                command=variant.command,
            )
            for variant in variants
        ]
        results = engine.results(jobs)
        broken += [run.seed for run, is_broken in zip(variants, results, strict=True) if is_broken]
        done = until
        risk = _by_counting(broken, done)
        engine.report(f"{len(broken)} of {done} runs broke the limit")
        if done == most or risk.relative_half_width <= query.precision:
            return risk


def _by_counting(broken: Sequence[int], runs: int) -> Risk:
    share = len(broken) / runs
    low, high = clopper_pearson(len(broken), runs)
    return Risk(
        method="counting",
        interval="Clopper-Pearson, exact",
        probability=share,
        low=low,
        high=high,
        standard_error=(share * (1.0 - share) / runs) ** 0.5,
        runs=runs,
        broken=tuple(broken),
    )


def _split(query: RiskQuery, counted_runs: int, engine: Engine) -> Risk:
    """Repeat the splitting in rounds until the mean is precise enough or `max_runs` are used."""
    most = query.max_runs - counted_runs
    if most < REPETITIONS_PER_ROUND * query.paths:
        raise ScenarioError(
            [
                f"--runs: given {query.max_runs}, allowed at least {counted_runs} + "
                f"{REPETITIONS_PER_ROUND} repetitions of {query.paths} paths"
            ]
        )
    splitting = Splitting(
        variant=query.variant,
        limit=query.limit,
        measure=query.measure,
        paths=query.paths,
        max_runs=most // REPETITIONS_PER_ROUND,
    )
    estimates: list[RiskEstimate] = []
    while True:
        first = len(estimates)
        jobs = [
            Job(key=f"repetition {number}", work=partial(run_repetition, splitting, number))
            for number in range(first, first + REPETITIONS_PER_ROUND)
        ]
        estimates += [RiskEstimate(**fields) for fields in engine.results(jobs)]
        risk = _by_splitting(estimates, counted_runs)
        engine.report(
            f"{len(estimates)} repetitions, {risk.runs} runs: probability {risk.probability:.3g}"
        )
        used = risk.runs - counted_runs
        if (
            risk.relative_half_width <= query.precision
            or used * (1 + REPETITIONS_PER_ROUND / len(estimates)) > most
        ):
            return risk


def _by_splitting(estimates: Sequence[RiskEstimate], counted_runs: int) -> Risk:
    mean = mean_of([estimate.probability for estimate in estimates])
    return Risk(
        method="splitting",
        interval=f"Student's t of {len(estimates)} independent repetitions",
        probability=mean.value,
        low=max(mean.low, 0.0),
        high=min(mean.high, 1.0),
        standard_error=mean.standard_error,
        runs=counted_runs + sum(estimate.runs for estimate in estimates),
        repetitions=tuple(estimates),
    )


def command_of(query: RiskQuery, risk: Risk) -> str:
    """Command that repeats a run that broke the limit, or an empty text."""
    if not risk.broken:
        return ""
    return replace(query.variant, seed=risk.broken[0]).command


def machine_readable(query: RiskQuery, risk: Risk) -> dict[str, Any]:
    figures = asdict(risk) | {"broken": len(risk.broken), "broken_seeds": list(risk.broken)}
    return {
        "schema": SCHEMA,
        "scenario": query.variant.name,
        "overrides": list(query.variant.overrides),
        "limit": str(query.limit),
        "measure": query.measure,
        "paths": query.paths if risk.repetitions else None,
        "command": command_of(query, risk) or None,
        **figures,
    }
