"""Runs with other losses, several at once, none repeated."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from hashlib import blake2b
from typing import Any

from scenarios.definition.scenario import scenario_from_text
from scenarios.studies.engine.engine import Engine
from scenarios.studies.engine.job import Job
from scenarios.studies.many.blame.listed_losses import LossFreeScenario
from scenarios.studies.many.blame.losses import Losses
from scenarios.studies.many.blame.rerun import (
    RerunCriteria,
    RerunResult,
    Truth,
    first_difference,
    rerun,
)


@dataclass(slots=True)
class Trials:
    """Runs of one convoy, each with other losses.

    `runs` counts them, up to `max_runs`; `at_once` runs start together. A set of losses breaks the
    limit if it does so until `breaks_by` (ns after the start).
    """

    convoy: LossFreeScenario
    criteria: RerunCriteria
    breaks_by: int
    engine: Engine
    parallel: int
    max_runs: int
    runs: int = 0
    _results: dict[Losses, RerunResult] = field(default_factory=dict)
    _broken: dict[Losses, bool] = field(default_factory=dict)

    @property
    def is_exhausted(self) -> bool:
        return self.runs >= self.max_runs

    @property
    def seconds(self) -> float:
        return self.engine.progress.seconds

    def set_stage(self, stage: str) -> None:
        self.engine.progress.stage = stage

    def results(self, of: Iterable[Losses], *, whole: bool = False) -> list[RerunResult]:
        """Return the results of runs with exactly these losses; `whole`: with series."""
        wanted = list(of)
        new = [one for one in dict.fromkeys(wanted) if whole or one not in self._results]
        self._results |= self._simulate(new, self.criteria, whole=whole)
        return [self._results[losses] for losses in wanted]

    def first_difference(self, losses: Losses, truth: Truth) -> tuple[str, int] | None:
        """Repeat the whole run with these losses; return the first true pose that differs."""
        work = partial(_first_difference, self.convoy.with_losses(losses).text, truth)
        job = Job(key="as recorded", work=work)
        self.runs += 1
        (found,) = self.engine.results([job])
        return None if found is None else (found[0], found[1])

    def first_breaking(self, sets: Sequence[Losses]) -> int | None:
        """Return the index of the first set of losses that breaks the limit, None if none does.

        Some run at once; the result does not depend on how many. Once there may be no more runs the
        rest count as not breaking it.
        """
        for begin in range(0, len(sets), self.parallel):
            some = sets[begin : begin + self.parallel]
            if not self.is_exhausted:
                self._test(some)
            for place, losses in enumerate(some, begin):
                if self._broken.get(losses):
                    return place
        return None

    def _test(self, sets: Sequence[Losses]) -> None:
        known = self._broken.keys() | self._results.keys()
        new = [losses for losses in dict.fromkeys(sets) if losses not in known]
        criteria = replace(self.criteria, until=self.breaks_by)
        found = self._simulate(new, criteria, ends_when_broken=True)
        found |= {one: self._results[one] for one in sets if one in self._results}
        self._broken |= {losses: self.is_breach(result) for losses, result in found.items()}

    def is_breach(self, result: RerunResult) -> bool:
        """Whether the limit was broken until `breaks_by`."""
        return result.broken_at is not None and result.broken_at <= self.breaks_by

    def _simulate(
        self, sets: Sequence[Losses], criteria: RerunCriteria, **how: bool
    ) -> dict[Losses, RerunResult]:
        words = " ".join(word for word, is_wanted in how.items() if is_wanted)
        jobs = [
            Job(
                key=f"{criteria.until} {words} {_digest(losses)}",
                work=partial(_fields, self.convoy.with_losses(losses).text, criteria, **how),
            )
            for losses in sets
        ]
        self.runs += len(jobs)
        results = [RerunResult(**fields) for fields in self.engine.results(jobs)]
        return dict(zip(sets, results, strict=True))


def _fields(text: str, criteria: RerunCriteria, **how: bool) -> dict[str, Any]:
    return asdict(rerun(scenario_from_text(text), criteria, **how))


def _first_difference(text: str, truth: Truth) -> tuple[str, int] | None:
    return first_difference(scenario_from_text(text), truth)


def _digest(losses: Losses) -> str:
    names = sorted((*one.link, one.number) for one in losses)
    return blake2b(repr(names).encode(), digest_size=12).hexdigest()
