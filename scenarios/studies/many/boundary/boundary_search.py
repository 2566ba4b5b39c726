"""`convoy bisect`: the query, its jobs, and the result."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil, isfinite
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.definition.run_limits import Limit
from scenarios.studies.engine.engine import Engine
from scenarios.studies.engine.job import Job
from scenarios.studies.many.boundary.curve import (
    Bracket,
    NoBoundaryError,
    Sample,
    ShareCurve,
    SharePoint,
    bracket,
)
from scenarios.studies.many.variant import Variant, identity_of

MAX_VALUES = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryQuery:
    """Search for the value of `key` from which on a `share` of the runs breaks `limit`.

    The search covers `low` to `high` with the half-width `precision`. Each value is simulated with
    the seeds 1 to `seeds`. `variant` is the run without key and seed.
    """

    variant: Variant
    key: str
    limit: Limit
    low: float = 0.0
    high: float = 1.0
    precision: float = 0.01
    seeds: int = 20
    share: float = 0.5

    @property
    def values(self) -> list[float]:
        """Possible values, evenly spaced by at most twice `precision`."""
        parts = ceil((self.high - self.low) / (2.0 * self.precision) - 1e-9)
        step = (self.high - self.low) / parts
        return [float(f"{self.low + step * number:.12g}") for number in range(parts + 1)]

    def at(self, value: float, seed: int) -> Variant:
        overrides = (*self.variant.overrides, f"{self.key}={value:.12g}")
        return replace(self.variant, overrides=overrides, seed=seed)

    def identity(self) -> dict[str, Any]:
        """Everything that the result depends on, named as on the command line."""
        span = [self.low, self.high]
        options = {
            "key": self.key,
            "limit": str(self.limit),
            "range": span,
            "precision": self.precision,
        }
        return identity_of(self.variant, **options, seeds=self.seeds, share=self.share)

    def check(self) -> None:
        """Raise ScenarioError for an invalid range, precision, key or end value."""
        if not (isfinite(self.low) and isfinite(self.high) and self.low < self.high):
            wrong = (
                f"--range: given {self.low:g}:{self.high:g}, allowed LOW:HIGH with LOW below HIGH"
            )
            raise ScenarioError([wrong])
        width = self.high - self.low
        if not width / MAX_VALUES <= self.precision <= 0.25 * width:
            allowed = f"allowed up to a quarter of the range, {0.25 * width:g}"
            raise ScenarioError([f"--precision: given {self.precision:g}, {allowed}"])
        now = _value_at(self.variant.scenario.text, self.key)
        if self.key == "seed" or isinstance(now, bool | str | list | dict):
            raise ScenarioError([f"{self.key}: given {now!r}, allowed a key with a number"])
        if isinstance(now, int):
            raise ScenarioError(
                [f"{self.key}: takes whole numbers; use `convoy sweep --vary {self.key}=…`"]
            )
        for value in (self.low, self.high):
            _ = self.at(value, 1).scenario


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryResult:
    """The share of runs that break the limit reaches `share` between `low` and `high`.

    `confidence_low` and `confidence_high` bound the boundary with 95 % confidence; None without
    a bound. `points` are all simulated values. `non_monotone_seeds` switch more than once between
    broken and kept as the value grows. `commands` repeat a run on either side of the boundary.
    """

    boundary: float
    low: float
    high: float
    confidence_low: float | None
    confidence_high: float | None
    crossings: int
    points: tuple[SharePoint, ...]
    non_monotone_seeds: tuple[int, ...]
    runs: int
    commands: Mapping[str, str]


def find_boundary(query: BoundaryQuery, engine: Engine) -> BoundaryResult:
    """Run the search; raises ScenarioError if the query is invalid or there is no boundary."""
    query.check()
    curve = ShareCurve(query.values, query.share, query.seeds, partial(_run_samples, query, engine))
    try:
        bracketed = bracket(curve)
    except NoBoundaryError:
        raise ScenarioError([_no_boundary(query, curve)]) from None
    return _result(query, curve, bracketed)


def _run_samples(
    query: BoundaryQuery, engine: Engine, samples: Sequence[Sample]
) -> dict[Sample, bool]:
    values, jobs = query.values, list[Job]()
    for number, seed in samples:
        variant = query.at(values[number], seed)
        key, work = f"{values[number]:.12g}/{seed}", partial(variant.breaks, query.limit)
        jobs.append(Job(key=key, work=work, command=variant.command))
    outcomes = dict(zip(samples, engine.results(jobs), strict=True))
    for number in sorted({number for number, _ in samples}):
        broken = [broke for (at, _), broke in outcomes.items() if at == number]
        of_value = f"{query.key}={values[number]:g}"
        counts = f"{sum(broken)} of {len(broken)} runs break the limit"
        engine.progress.note(f"{engine.progress.done:3d} runs  {of_value}: {counts}")
    return outcomes


def _result(query: BoundaryQuery, curve: ShareCurve, bracketed: Bracket) -> BoundaryResult:
    values = curve.values
    low, high = values[bracketed.low], values[bracketed.high]
    commands = {}
    for end, number in (("low", bracketed.low), ("high", bracketed.high)):
        broken = curve.broken_seeds(number)
        seed = broken[0] if broken else 1
        verdict = "breaks" if broken else "keeps"
        commands[f"{end} end, {verdict} {query.limit}"] = query.at(values[number], seed).command
    return BoundaryResult(
        boundary=float(f"{0.5 * (low + high):.12g}"),
        low=low,
        high=high,
        confidence_low=bracketed.confident[0] if isfinite(bracketed.confident[0]) else None,
        confidence_high=bracketed.confident[1] if isfinite(bracketed.confident[1]) else None,
        crossings=len(list(curve.changes())),
        points=tuple(curve.point(number) for number in curve.evaluated),
        non_monotone_seeds=tuple(curve.non_monotone_seeds()),
        runs=curve.runs,
        commands=commands,
    )


def _no_boundary(query: BoundaryQuery, curve: ShareCurve) -> str:
    points = [curve.point(number) for number in curve.evaluated]
    counts = ", ".join(f"{point.broken} of {point.runs} at {point.value:g}" for point in points)
    side = "broken" if curve.reaches_share(0) else "kept"
    return (
        f"{query.key}: {query.limit} is {side} at both ends of --range "
        f"{query.low:g}:{query.high:g} and between, so there is no boundary; {counts} break it"
    )


def _value_at(text: str, key: str) -> object:
    """Value of a dotted key in a scenario, or None."""
    value: Any = tomllib.loads(text)
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return value
