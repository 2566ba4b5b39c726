"""The probability that one run breaks a limit: by counting runs, or by splitting them."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from scenarios.definition.errors import ScenarioError
from scenarios.definition.run_limits import Limit
from scenarios.studies.engine.engine import Engine
from scenarios.studies.engine.job import Job
from scenarios.studies.engine.results import write_files
from scenarios.studies.many.limit_history import Measure
from scenarios.studies.many.splitting import RiskEstimate, Splitting, run_repetition
from scenarios.studies.many.statistics import clopper_pearson, mean_of
from scenarios.studies.many.variant import Variant, identity_of

Method = Literal["counting", "splitting", "auto"]
SCHEMA = "convoy.risk/1"
JSON_FILE = "risk.json"
NO_COMMAND = (
    "a branched run is no scenario, so no command repeats it: risk.json has its seed and branches"
)
FIRST_RUNS, ENOUGH_BROKEN = 200, 5
"""Where fewer of the first runs break the limit, counting would take longer."""
REPETITIONS_PER_ROUND = 10
"""Repetitions between two looks at how certain the mean is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskQuery:
    """The risk that a run of `variant` breaks `limit`, and the wanted precision.

    `to` is half of the interval's width over the estimate; no more than `max_runs` start, but for
    what a repetition needs to end. Repetitions follow `paths` runs at a time.
    """

    variant: Variant
    limit: Limit
    method: Method = "auto"
    measure: Measure = "limit"
    precision: float = 0.5
    max_runs: int = 2000
    paths: int = 50

    def identity(self) -> dict[str, Any]:
        """All that the answer depends on, by the words of the command line."""
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
    """The probability with its interval of 95 %, and the runs behind it.

    `broken` are the seeds that broke the limit, by counting; `repetitions` are the independent
    estimates, by splitting, whose mean it is.
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


def estimate_risk(query: RiskQuery, engine: Engine) -> Risk:
    if query.method == "splitting":
        return _split(query, 0, engine)
    most = query.max_runs
    counted_runs = min(FIRST_RUNS, most) if query.method == "auto" else most
    found = _count(query, counted_runs, engine)
    if query.method == "counting" or counted_runs == most:
        return found
    if len(found.broken) >= ENOUGH_BROKEN:
        return _count(query, most, engine, found)
    engine.report(
        f"{len(found.broken)} of {counted_runs} runs broke the limit: splitting from here on"
    )
    return _split(query, counted_runs, engine)


def _count(query: RiskQuery, most: int, engine: Engine, before: Risk | None = None) -> Risk:
    """Count from the seed after those `before` on: twice as many runs each time, up to `most`."""
    done, broken = (before.runs, list(before.broken)) if before else (0, [])
    while True:
        until = min(max(2 * done, FIRST_RUNS), most)
        variants = [replace(query.variant, seed=seed) for seed in range(done + 1, until + 1)]
        jobs = [
            Job(
                key=f"seed {one.seed}",
                work=partial(one.breaks, query.limit),
                command=one.command,
            )
            for one in variants
        ]
        broke = engine.results(jobs)
        broken += [one.seed for one, is_broken in zip(variants, broke, strict=True) if is_broken]
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
        interval="Clopper and Pearson's, exact",
        probability=share,
        low=low,
        high=high,
        standard_error=(share * (1.0 - share) / runs) ** 0.5,
        runs=runs,
        broken=tuple(broken),
    )


def _split(query: RiskQuery, counted_runs: int, engine: Engine) -> Risk:
    """Repeat the splitting in rounds, until the mean is precise enough or the runs are used up."""
    most = query.max_runs - counted_runs
    if most < REPETITIONS_PER_ROUND * query.paths:
        raise ScenarioError(
            [
                f"--runs: given {query.max_runs}, allowed at least {counted_runs} + "
                f"{REPETITIONS_PER_ROUND} repetitions of {query.paths} paths"
            ]
        )
    work = Splitting(
        variant=query.variant,
        limit=query.limit,
        measure=query.measure,
        paths=query.paths,
        max_runs=most // REPETITIONS_PER_ROUND,
    )
    found: list[RiskEstimate] = []
    while True:
        first = len(found)
        jobs = [
            Job(key=f"repetition {number}", work=partial(run_repetition, work, number))
            for number in range(first, first + REPETITIONS_PER_ROUND)
        ]
        found += [RiskEstimate(**fields) for fields in engine.results(jobs)]
        risk = _by_splitting(found, counted_runs)
        engine.report(f"{len(found)} repetitions, {risk.runs} runs: {risk.probability:.3g}")
        used = risk.runs - counted_runs
        if (
            risk.relative_half_width <= query.precision
            or used * (1 + REPETITIONS_PER_ROUND / len(found)) > most
        ):
            return risk


def _by_splitting(found: Sequence[RiskEstimate], counted_runs: int) -> Risk:
    mean = mean_of([one.probability for one in found])
    return Risk(
        method="splitting",
        interval=f"Student's, of {len(found)} independent repetitions",
        probability=mean.value,
        low=mean.low,
        high=mean.high,
        standard_error=mean.standard_error,
        runs=counted_runs + sum(one.runs for one in found),
        repetitions=tuple(found),
    )


def command_of(query: RiskQuery, risk: Risk) -> str:
    """The command that repeats a run that broke the limit; empty if there is none."""
    if not risk.broken:
        return ""
    return replace(query.variant, seed=risk.broken[0]).command


def write_risk(query: RiskQuery, risk: Risk, out: Path) -> list[Path]:
    figures = asdict(risk) | {"broken": len(risk.broken), "broken_seeds": list(risk.broken)}
    whole = {
        "schema": SCHEMA,
        "scenario": query.variant.name,
        "overrides": list(query.variant.overrides),
        "limit": str(query.limit),
        "measure": query.measure,
        "paths": query.paths if risk.repetitions else None,
        "command": command_of(query, risk) or None,
        **figures,
    }
    return write_files(out, {JSON_FILE: whole})
