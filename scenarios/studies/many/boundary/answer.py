"""`convoy bisect`: the question, its jobs, and the answer."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
    Place,
    ShareCurve,
    SharePoint,
    bracket,
)
from scenarios.studies.many.variant import Variant, identity_of

MOST_VALUES = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryQuestion:
    """At which value of `key` a `share` of the runs breaks `limit`.

    `variant` is the run without key and seed; the value is sought from `low` to `high`, to within
    `to` on either side, with the seeds from 1 to `seeds`.
    """

    variant: Variant
    key: str
    limit: Limit
    low: float = 0.0
    high: float = 1.0
    to: float = 0.01
    seeds: int = 20
    share: float = 0.5

    @property
    def values(self) -> list[float]:
        """Values that may be tried, evenly spaced by at most twice `to`."""
        parts = ceil((self.high - self.low) / (2.0 * self.to) - 1e-9)
        step = (self.high - self.low) / parts
        return [float(f"{self.low + step * number:.12g}") for number in range(parts + 1)]

    def at(self, value: float, seed: int) -> Variant:
        variant = self.variant
        return Variant(
            text=variant.text,
            name=variant.name,
            overrides=(*variant.overrides, f"{self.key}={value:.12g}"),
            seed=seed,
        )

    def identity(self) -> dict[str, Any]:
        """All that the answer depends on, by the words of the command line."""
        span = [self.low, self.high]
        options = {"key": self.key, "limit": str(self.limit), "range": span, "to": self.to}
        return identity_of(self.variant, **options, seeds=self.seeds, share=self.share)

    def check(self) -> None:
        """Raise ScenarioError for a wrong question, or a scenario refused at one of the ends."""
        if not (isfinite(self.low) and isfinite(self.high) and self.low < self.high):
            wrong = (
                f"--range: given {self.low:g}:{self.high:g}, allowed LOW:HIGH with LOW below HIGH"
            )
            raise ScenarioError([wrong])
        width = self.high - self.low
        if not width / MOST_VALUES <= self.to <= 0.25 * width:
            allowed = f"allowed up to a quarter of the range, {0.25 * width:g}"
            raise ScenarioError([f"--precision: given {self.to:g}, {allowed}"])
        now = _value_at(self.variant.scenario.text, self.key)
        if self.key == "seed" or isinstance(now, bool | str | list | dict):
            raise ScenarioError([f"{self.key}: is no number that a limit depends on, but {now!r}"])
        if isinstance(now, int):
            raise ScenarioError(
                [f"{self.key}: takes whole numbers, which `convoy sweep --vary` can try one by one"]
            )
        for value in (self.low, self.high):
            _ = self.at(value, 1).scenario


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryAnswer:
    """The share crosses the wanted one between `low` and `high`.

    `sure_low` and `sure_high` are the nearest tried values that are on either side with certainty
    (95 % intervals), None without one. `points` are all tried values. `turning_seeds` change more
    than once between broken and held as the value grows. `commands` repeat a run next to the
    boundary that breaks the limit, and one that holds it.
    """

    boundary: float
    low: float
    high: float
    sure_low: float | None
    sure_high: float | None
    crossings: int
    points: tuple[SharePoint, ...]
    turning_seeds: tuple[int, ...]
    runs: int
    commands: Mapping[str, str]


def boundary_of(question: BoundaryQuestion, engine: Engine) -> BoundaryAnswer:
    """Raises ScenarioError if the question is wrong, or the share crosses it nowhere."""
    question.check()
    curve = ShareCurve(
        question.values, question.share, question.seeds, partial(_tried, question, engine)
    )
    try:
        found = bracket(curve)
    except NoBoundaryError:
        raise ScenarioError([_no_boundary(question, curve)]) from None
    return _answer(question, curve, found)


def _tried(
    question: BoundaryQuestion, engine: Engine, places: Sequence[Place]
) -> dict[Place, bool]:
    values, jobs = question.values, list[Job]()
    for number, seed in places:
        variant = question.at(values[number], seed)
        key, work = f"{values[number]:.12g}/{seed}", partial(variant.breaks, question.limit)
        jobs.append(Job(key=key, work=work, command=variant.command))
    found = dict(zip(places, engine.results(jobs), strict=True))
    for number in sorted({number for number, _ in places}):
        here = [broke for (at, _), broke in found.items() if at == number]
        of_value = f"{question.key}={values[number]:g}"
        counts = f"{sum(here)} of {len(here)} runs break it"
        engine.progress.note(f"{engine.progress.done:3d} runs  {of_value}: {counts}")
    return found


def _answer(question: BoundaryQuestion, curve: ShareCurve, found: Bracket) -> BoundaryAnswer:
    values = curve.values
    low, high = values[found.low], values[found.high]
    commands = {}
    for word, number in (("low", found.low), ("high", found.high)):
        broken = curve.broken_seeds(number)
        seed = broken[0] if broken else 1
        what = "breaks" if broken else "holds"
        commands[f"{word}, {what} {question.limit}"] = question.at(values[number], seed).command
    return BoundaryAnswer(
        boundary=float(f"{0.5 * (low + high):.12g}"),
        low=low,
        high=high,
        sure_low=found.sure[0] if isfinite(found.sure[0]) else None,
        sure_high=found.sure[1] if isfinite(found.sure[1]) else None,
        crossings=len(list(curve.changes())),
        points=tuple(curve.point(number) for number in curve.visited),
        turning_seeds=tuple(curve.turning_seeds()),
        runs=curve.runs,
        commands=commands,
    )


def _no_boundary(question: BoundaryQuestion, curve: ShareCurve) -> str:
    points = [curve.point(number) for number in curve.visited]
    found = ", ".join(f"{one.broken} of {one.runs} at {one.value:g}" for one in points)
    side = "broken" if curve.is_beyond(0) else "held"
    return (
        f"{question.key}: {question.limit} is {side} at both ends of --range "
        f"{question.low:g}:{question.high:g} and between, so there is no boundary: {found} break it"
    )


def _value_at(text: str, key: str) -> object:
    """Value of a scenario under a dotted key; None if it has none."""
    here: Any = tomllib.loads(text)
    for part in key.split("."):
        here = here.get(part) if isinstance(here, dict) else None
    return here
