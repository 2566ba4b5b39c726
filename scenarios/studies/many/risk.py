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
from scenarios.studies.many.splitting import RiskEstimate, Splitting, repeated
from scenarios.studies.many.statistics import clopper_pearson, mean_of
from scenarios.studies.many.variant import Variant, identity_of
from scenarios.studies.many.watched import Measure

Method = Literal["counting", "splitting", "auto"]
SCHEMA = "convoy.risk/1"
TWIN = "risk.json"
NO_COMMAND = (
    "a branched run is no scenario, so no command repeats it: risk.json has its seed and branches"
)
FIRST_RUNS, FEW = 200, 5
"""Where fewer of the first runs break the limit, counting would take longer."""
ROUND = 10
"""Repetitions between two looks at how certain the mean is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskQuestion:
    """The risk that a run of `variant` breaks `limit`, and the wanted precision.

    `to` is half of the interval's width over the estimate; no more than `most_runs` start, but for
    what a repetition needs to end. Repetitions follow `paths` runs at a time.
    """

    variant: Variant
    limit: Limit
    method: Method = "auto"
    measure: Measure = "limit"
    to: float = 0.5
    most_runs: int = 2000
    paths: int = 50

    def identity(self) -> dict[str, Any]:
        """All that the answer depends on, by the words of the command line."""
        return identity_of(
            self.variant,
            limit=str(self.limit),
            method=self.method,
            measure=self.measure,
            to=self.to,
            runs=self.most_runs,
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


def risk_of(question: RiskQuestion, engine: Engine) -> Risk:
    if question.method == "splitting":
        return _split(question, 0, engine)
    most = question.most_runs
    begun = min(FIRST_RUNS, most) if question.method == "auto" else most
    found = _count(question, begun, engine)
    if question.method == "counting" or begun == most:
        return found
    if len(found.broken) >= FEW:
        return _count(question, most, engine, found)
    engine.report(f"{len(found.broken)} of {begun} runs broke the limit: splitting from here on")
    return _split(question, begun, engine)


def _count(question: RiskQuestion, most: int, engine: Engine, before: Risk | None = None) -> Risk:
    """Count from the seed after those `before` on: twice as many runs each time, up to `most`."""
    done, broken = (before.runs, list(before.broken)) if before else (0, [])
    while True:
        until = min(max(2 * done, FIRST_RUNS), most)
        variants = [replace(question.variant, seed=seed) for seed in range(done + 1, until + 1)]
        jobs = [
            Job(
                key=f"seed {one.seed}",
                work=partial(one.breaks, question.limit),
                command=one.command,
            )
            for one in variants
        ]
        broke = engine.results(jobs)
        broken += [one.seed for one, is_broken in zip(variants, broke, strict=True) if is_broken]
        done = until
        risk = _by_counting(broken, done)
        engine.report(f"{len(broken)} of {done} runs broke the limit")
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


def _split(question: RiskQuestion, begun: int, engine: Engine) -> Risk:
    """Repeat the splitting in rounds, until the mean is precise enough or the runs are used up."""
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
        jobs = [
            Job(key=f"repetition {number}", work=partial(repeated, work, number))
            for number in range(first, first + ROUND)
        ]
        found += [RiskEstimate(**fields) for fields in engine.results(jobs)]
        risk = _by_splitting(found, begun)
        engine.report(f"{len(found)} repetitions, {risk.runs} runs: {risk.probability:.3g}")
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


def command_of(question: RiskQuestion, risk: Risk) -> str:
    """The command that repeats a run that broke the limit; empty if there is none."""
    if not risk.broken:
        return ""
    return replace(question.variant, seed=risk.broken[0]).command


def write_risk(question: RiskQuestion, risk: Risk, out: Path) -> list[Path]:
    figures = asdict(risk) | {"broken": len(risk.broken), "broken_seeds": list(risk.broken)}
    whole = {
        "schema": SCHEMA,
        "scenario": question.variant.name,
        "overrides": list(question.variant.overrides),
        "limit": str(question.limit),
        "measure": question.measure,
        "paths": question.paths if risk.repetitions else None,
        "command": command_of(question, risk) or None,
        **figures,
    }
    return write_files(out, {TWIN: whole})
