"""Drills: scenarios with limits, simulated with one or more seeds, and the row of each limit."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario
from scenarios.results.summary import LimitFigure, RunSummary
from scenarios.studies.engine import Engine
from scenarios.studies.job import Job, write_files
from scenarios.studies.many.variant import Variant, variant_of

RUN = "run"
"""Limit of the row of a run that failed for another reason."""
UNMEASURED = "was not measured: no vehicle has the figure, or the run ended too early"


@dataclass(frozen=True, slots=True, kw_only=True)
class DrillResult:
    """Result of a drill with one seed; `other_reason` is a failure other than its limits.

    `drill` is the name entered by the user, `command` repeats the run.
    """

    drill: str
    seed: int
    limits: tuple[LimitFigure, ...]
    other_reason: str
    command: str
    duration_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DrillRow:
    """A limit of a drill with the worst value over all seeds, and its vehicle.

    `margin_ratio` is the margin over the bound, negative if the limit was broken, None for a bound
    of 0. `message` describes a breach.
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
        if self.bound is None:
            return self.limit
        if self.action:
            return f"{self.vehicle} {self.action}, within {self.bound:g} s"
        return f"{self.limit} = {self.bound:g}"


def drill_variants(
    name: str, overrides: Sequence[str] = (), seeds: Sequence[int] = ()
) -> list[Variant]:
    """Return the runs of a drill, a scenario or a file, by default with its own seed.

    Raises ScenarioError if it is invalid or has no limits.
    """
    whole = load_scenario(name, overrides)
    limits = whole.tables.limits
    if not limits.model_fields_set - {"after_collision"}:
        raise ScenarioError(
            [f"{name}: limits: missing, a drill needs at least one, such as collisions_max = 0"]
        )
    base = variant_of(name, overrides)
    return [replace(base, seed=seed) for seed in seeds or (whole.seed,)]


def run_drill(variant: Variant) -> DrillResult:
    began = time.perf_counter()
    summary = variant.run()
    return DrillResult(
        drill=variant.name,
        seed=variant.seed,
        limits=summary.limits,
        other_reason=_other_reason(summary),
        command=variant.command,
        duration_s=time.perf_counter() - began,
    )


def run_drills(variants: Sequence[Variant], engine: Engine) -> list[DrillResult]:
    jobs = [
        Job(
            key=f"{variant.name} {variant.seed}",
            work=partial(run_drill, variant),
            command=variant.command,
        )
        for variant in variants
    ]
    engine.progress.total = len(jobs)
    return engine.results(jobs)


def _other_reason(summary: RunSummary) -> str:
    """Reason of a failure, without the limits that were broken."""
    reason = summary.reason
    for limit in summary.limits:
        if limit.message:
            reason = reason.replace(limit.message, "")
    return "; ".join(part for part in reason.split("; ") if part.strip())


def drill_rows(runs: Sequence[DrillResult]) -> list[DrillRow]:
    names = dict.fromkeys(run.drill for run in runs)
    return [
        row for name in names for row in rows_of_drill([run for run in runs if run.drill == name])
    ]


def rows_of_drill(runs: Sequence[DrillResult]) -> Iterator[DrillRow]:
    """Yield a row for each limit of a drill, from its runs with all seeds.

    The first row is a run that failed for another reason, if any.
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
    for name in dict.fromkeys(limit.limit for run in runs for limit in run.limits):
        of_name = [(run, limit) for run in runs for limit in run.limits if limit.limit == name]
        yield _row(*max(of_name, key=lambda pair: excess(pair[1])))


def _row(run: DrillResult, limit: LimitFigure) -> DrillRow:
    unmeasured = limit.value is None and not limit.broken
    return DrillRow(
        drill=run.drill,
        limit=limit.limit,
        action=limit.action,
        bound=limit.bound,
        value=limit.value,
        vehicle=limit.vehicle,
        seed=run.seed,
        margin_ratio=None
        if limit.value is None or not limit.bound
        else -excess(limit) / limit.bound,
        passed=not limit.broken and not unmeasured,
        message=f"limits.{limit.limit} {UNMEASURED}" if unmeasured else limit.message,
        command=run.command,
    )


def excess(limit: LimitFigure) -> float:
    """Excess over the bound in the unit of the limit; negative if the limit was kept."""
    if limit.value is None:
        return inf
    return limit.bound - limit.value if limit.limit.endswith("_min") else limit.value - limit.bound


# ---- Files of drills: JSON, and JUnit XML for test servers


SCHEMA = "convoy.drills/1"
JSON_FILE = "drills.json"


def machine_readable(rows: Sequence[DrillRow], runs: Sequence[DrillResult]) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "passed": all(row.passed for row in rows),
        "rows": [asdict(row) for row in rows],
        "runs": [
            {key: value for key, value in asdict(run).items() if key != "duration_s"}
            for run in runs
        ],
    }


def write_junit(rows: Sequence[DrillRow], runs: Sequence[DrillResult], file: Path) -> None:
    """Write all rows as JUnit XML: a test suite per drill, a test case per limit."""
    root = as_xml(rows, runs)
    Xml.indent(root)
    text = Xml.tostring(root, encoding="unicode")
    write_files(file.parent, {file.name: f"<?xml version='1.0' encoding='utf-8'?>\n{text}"})


def as_xml(rows: Sequence[DrillRow], runs: Sequence[DrillResult]) -> Xml.Element:
    """Return all rows as an XML tree.

    The time of a suite is the sum over its runs, that of a case is its run's. Unknown times of
    cases are omitted.
    """
    failed = sum(not row.passed for row in rows)
    took = sum(run.duration_s for run in runs)
    root = Xml.Element("testsuites", _counts("convoy drill", len(rows), failed, took))
    for name in dict.fromkeys(row.drill for row in rows):
        own = [row for row in rows if row.drill == name]
        took = sum(run.duration_s for run in runs if run.drill == name)
        failed = sum(not row.passed for row in own)
        suite = Xml.SubElement(root, "testsuite", _counts(name, len(own), failed, took))
        for row in own:
            its_runs = (run for run in runs if (run.drill, run.seed) == (name, row.seed))
            _case(suite, row, next((run.duration_s for run in its_runs), 0.0))
    return root


def _counts(name: str, tests: int, failures: int, duration_s: float) -> dict[str, str]:
    return {
        "name": name,
        "tests": str(tests),
        "failures": str(failures),
        "errors": "0",
        "time": f"{duration_s:.3f}",
    }


def _case(suite: Xml.Element, row: DrillRow, duration_s: float) -> None:
    case = Xml.SubElement(suite, "testcase", {"classname": row.drill, "name": row.label})
    if duration_s > 0.0:
        case.set("time", f"{duration_s:.3f}")
    if not row.passed:
        failure = Xml.SubElement(case, "failure", {"type": "limit", "message": row.message})
        failure.text = f"{row.message}\nrepeat: {row.command}"
    facts = [] if row.value is None else [f"value {row.value:.6g}"]
    if row.margin_ratio is not None:
        facts.append(f"margin {row.margin_ratio:.3f} of the bound")
    Xml.SubElement(case, "system-out").text = ", ".join((*facts, f"seed {row.seed}"))
