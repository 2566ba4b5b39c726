"""Parallel reruns with other losses; none is repeated."""

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
    """Reruns of one recorded run, each with other losses.

    There are up to `max_runs` runs, `parallel` at a time. A set of losses breaks the limit if that
    happens by `breaks_by` (ns after the start).
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

    def results(self, sets: Iterable[Losses], *, whole: bool = False) -> list[RerunResult]:
        """Return the results of runs with exactly these losses; `whole`: with series."""
        wanted = list(sets)
        new = [losses for losses in dict.fromkeys(wanted) if whole or losses not in self._results]
        self._results |= self._simulate(new, self.criteria, whole=whole)
        return [self._results[losses] for losses in wanted]

    def first_difference(self, losses: Losses, truth: Truth) -> tuple[str, int] | None:
        """Return vehicle and instant of the first true pose unlike `truth`, or None."""
        work = partial(_first_difference, self.convoy.with_losses(losses).text, truth)
        job = Job(key="as recorded", work=work)
        self.runs += 1
        (difference,) = self.engine.results([job])
        return None if difference is None else (difference[0], difference[1])

    def first_breaking(self, sets: Sequence[Losses]) -> int | None:
        """Return the index of the first set of losses that breaks the limit, or None.

        The result does not depend on `parallel`. Sets that `max_runs` leaves unsimulated count as
        not breaking it.
        """
        for start in range(0, len(sets), self.parallel):
            chunk = sets[start : start + self.parallel]
            if not self.is_exhausted:
                self._test(chunk)
            for index, losses in enumerate(chunk, start):
                if self._broken.get(losses):
                    return index
        return None

    def _test(self, sets: Sequence[Losses]) -> None:
        known = self._broken.keys() | self._results.keys()
        new = [losses for losses in dict.fromkeys(sets) if losses not in known]
        criteria = replace(self.criteria, until=self.breaks_by)
        results = self._simulate(new, criteria, ends_when_broken=True)
        results |= {losses: self._results[losses] for losses in sets if losses in self._results}
        self._broken |= {losses: self.is_breach(result) for losses, result in results.items()}

    def is_breach(self, result: RerunResult) -> bool:
        return result.broken_at is not None and result.broken_at <= self.breaks_by

    def _simulate(
        self, sets: Sequence[Losses], criteria: RerunCriteria, **options: bool
    ) -> dict[Losses, RerunResult]:
        flags = " ".join(name for name, is_set in options.items() if is_set)
        jobs = [
            Job(
                key=f"{criteria.until} {flags} {_digest(losses)}",
                work=partial(_fields, self.convoy.with_losses(losses).text, criteria, **options),
            )
            for losses in sets
        ]
        self.runs += len(jobs)
        results = [RerunResult(**fields) for fields in self.engine.results(jobs)]
        return dict(zip(sets, results, strict=True))


def _fields(text: str, criteria: RerunCriteria, **options: bool) -> dict[str, Any]:
    return asdict(rerun(scenario_from_text(text), criteria, **options))


def _first_difference(text: str, truth: Truth) -> tuple[str, int] | None:
    return first_difference(scenario_from_text(text), truth)


def _digest(losses: Losses) -> str:
    names = sorted((*message.link, message.number) for message in losses)
    return blake2b(repr(names).encode(), digest_size=12).hexdigest()
