"""One drill: a scenario with limits, driven with one or more seeds, and how each limit was kept."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from math import inf
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario
from scenarios.results.summary import LimitFigure, RunSummary
from scenarios.studies.engine.engine import Engine
from scenarios.studies.engine.job import Job
from scenarios.studies.many.variant import Variant, identity_of

RUN = "run"
"""In place of a limit: the run itself, which failed for another reason."""
UNMEASURED = "was not measured: nobody had such a figure, or the run ended before"


@dataclass(frozen=True, slots=True, kw_only=True)
class DrillResult:
    """The result of a drill with one seed; `other_reason` is a failure other than its limits.

    `drill` is the name given by the user, `command` repeats the run; it took `took_s`.
    """

    drill: str
    seed: int
    limits: tuple[LimitFigure, ...]
    other_reason: str
    command: str
    duration_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DrillRow:
    """How a limit of a drill was kept over all seeds: the worst figure, and its vehicle.

    `margin_ratio` is the share of the bound that was left, negative if it was broken, None for a
    bound of 0. `line` describes a breach.
    """

    drill: str
    limit: str
    action: str
    bound: float | None
    value: float | None
    vehicle: str
    seed: int
    margin_ratio: float | None
    passed: bool
    message: str
    command: str

    @property
    def label(self) -> str:
        """The limit for a table: its key and bound, or the required reaction and its time."""
        if self.bound is None:
            return self.limit
        if self.action:
            return f"{self.vehicle} {self.action}, within {self.bound:g} s"
        return f"{self.limit} = {self.bound:g}"


def drill_variants(
    name: str, overrides: Sequence[str] = (), seeds: Sequence[int] = ()
) -> list[Variant]:
    """Return the runs of a drill, by default one with its own seed; raises ScenarioError.

    `name` is that of a shipped drill or scenario, or a file.
    """
    whole = load_scenario(name, overrides)
    limits = whole.tables.limits
    if not limits.model_fields_set - {"after_collision"}:
        raise ScenarioError(
            [f"{name}: limits: missing, a drill says what must hold, such as collisions_max = 0"]
        )
    text = load_scenario(name).text
    return [
        Variant(text=text, name=name, overrides=tuple(overrides), seed=seed)
        for seed in seeds or (whole.seed,)
    ]


def identity_of_drills(variants: Sequence[Variant]) -> dict[str, Any]:
    """All that the results depend on, by the words of the command line."""
    first = identity_of(variants[0])
    return first | {
        "SCENARIO": list(dict.fromkeys(one.name for one in variants)),
        "its content": list(dict.fromkeys(identity_of(one)["its content"] for one in variants)),
        "--seeds": [one.seed for one in variants],
    }


def run_drill(variant: Variant) -> DrillResult:
    began = time.perf_counter()
    summary = variant.run()
    return drill_result(variant, summary, time.perf_counter() - began)


def run_drills(variants: Sequence[Variant], engine: Engine) -> list[DrillResult]:
    jobs = [
        Job(key=f"{one.name} {one.seed}", work=partial(_fields, one), command=one.command)
        for one in variants
    ]
    engine.progress.total = len(jobs)
    return [
        DrillResult(**fields | {"limits": tuple(LimitFigure(**one) for one in fields["limits"])})
        for fields in engine.results(jobs)
    ]


def _fields(variant: Variant) -> dict[str, Any]:
    return asdict(run_drill(variant))


def drill_result(variant: Variant, summary: RunSummary, duration_s: float) -> DrillResult:
    return DrillResult(
        drill=variant.name,
        seed=variant.seed,
        limits=summary.limits,
        other_reason=_other_reason(summary),
        command=variant.command,
        duration_s=duration_s,
    )


def _other_reason(summary: RunSummary) -> str:
    """Why a run failed, without the limits that it broke."""
    reason = summary.reason
    for one in summary.limits:
        if one.message:
            reason = reason.replace(one.message, "")
    return "; ".join(part for part in reason.split("; ") if part.strip())


def drill_rows(runs: Sequence[DrillResult]) -> list[DrillRow]:
    """Return a row for each limit of each drill, the worst of all seeds."""
    names = dict.fromkeys(run.drill for run in runs)
    return [
        row for name in names for row in rows_of_drill([run for run in runs if run.drill == name])
    ]


def rows_of_drill(runs: Sequence[DrillResult]) -> Iterator[DrillRow]:
    """Yield a row for each limit of a drill, from its runs with all seeds.

    If a run failed for another reason, that is the first row.
    """
    for run in (run for run in runs if run.other_reason):
        yield DrillRow(
            drill=run.drill,
            limit=RUN,
            action="",
            bound=None,
            value=None,
            vehicle="",
            seed=run.seed,
            margin_ratio=None,
            passed=False,
            message=run.other_reason,
            command=run.command,
        )
        break
    for limit in dict.fromkeys(one.limit for run in runs for one in run.limits):
        found = [(run, one) for run in runs for one in run.limits if one.limit == limit]
        yield _row(*max(found, key=lambda pair: excess(pair[1])))


def _row(run: DrillResult, one: LimitFigure) -> DrillRow:
    unmeasured = one.value is None and not one.broken
    return DrillRow(
        drill=run.drill,
        limit=one.limit,
        action=one.action,
        bound=one.bound,
        value=one.value,
        vehicle=one.vehicle,
        seed=run.seed,
        margin_ratio=None if one.value is None or not one.bound else -excess(one) / one.bound,
        passed=not one.broken and not unmeasured,
        message=f"limits.{one.limit} {UNMEASURED}" if unmeasured else one.message,
        command=run.command,
    )


def excess(one: LimitFigure) -> float:
    """Excess of a figure over its bound, in the limit's unit; negative while it is kept."""
    if one.value is None:
        return inf
    return one.bound - one.value if one.limit.endswith("_min") else one.value - one.bound
