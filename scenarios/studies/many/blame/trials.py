"""Runs with other losses, several at once, none repeated."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from hashlib import blake2b
from typing import Any

from scenarios.definition.scenario import scenario_from_text
from scenarios.studies.engine.engine import Engine
from scenarios.studies.engine.job import Job
from scenarios.studies.many.blame.imposed import LossFree
from scenarios.studies.many.blame.losses import Losses
from scenarios.studies.many.blame.rerun import (
    BlameAnswer,
    BlameQuestion,
    Truth,
    first_difference,
    rerun,
)


@dataclass(slots=True)
class Trials:
    """Runs of one convoy, each with other losses.

    `runs` counts them, up to `most_runs`; `at_once` runs start together. A set of losses breaks the
    limit if it does so until `breaks_by` (ns after the start).
    """

    convoy: LossFree
    question: BlameQuestion
    breaks_by: int
    engine: Engine
    at_once: int
    most_runs: int
    runs: int = 0
    _answers: dict[Losses, BlameAnswer] = field(default_factory=dict)
    _broken: dict[Losses, bool] = field(default_factory=dict)

    @property
    def are_enough(self) -> bool:
        return self.runs >= self.most_runs

    @property
    def seconds(self) -> float:
        return self.engine.progress.seconds

    def begin(self, doing: str) -> None:
        self.engine.progress.doing = doing

    def answers(self, of: Iterable[Losses], *, whole: bool = False) -> list[BlameAnswer]:
        """Return the answers of runs with exactly these losses; `whole`: with series."""
        wanted = list(of)
        new = [one for one in dict.fromkeys(wanted) if whole or one not in self._answers]
        self._answers |= self._driven(new, self.question, whole=whole)
        return [self._answers[losses] for losses in wanted]

    def first_difference(self, losses: Losses, truth: Truth) -> tuple[str, int] | None:
        """Repeat the whole run with these losses; return the first true pose that differs."""
        work = partial(_first_difference, self.convoy.losing(losses).text, truth)
        job = Job(key="as recorded", work=work)
        self.runs += 1
        (found,) = self.engine.results([job])
        return None if found is None else (found[0], found[1])

    def first_that_breaks(self, sets: Sequence[Losses]) -> int | None:
        """Return the index of the first set of losses that breaks the limit, None if none does.

        Some run at once; the result does not depend on how many. Once there may be no more runs the
        rest count as not breaking it.
        """
        for begin in range(0, len(sets), self.at_once):
            some = sets[begin : begin + self.at_once]
            if not self.are_enough:
                self._try(some)
            for place, losses in enumerate(some, begin):
                if self._broken.get(losses):
                    return place
        return None

    def _try(self, sets: Sequence[Losses]) -> None:
        known = self._broken.keys() | self._answers.keys()
        new = [losses for losses in dict.fromkeys(sets) if losses not in known]
        question = replace(self.question, until=self.breaks_by)
        found = self._driven(new, question, ends_when_broken=True)
        found |= {one: self._answers[one] for one in sets if one in self._answers}
        self._broken |= {losses: self.is_breach(answer) for losses, answer in found.items()}

    def is_breach(self, answer: BlameAnswer) -> bool:
        """Whether the limit was broken until `breaks_by`."""
        return answer.broken_at is not None and answer.broken_at <= self.breaks_by

    def _driven(
        self, sets: Sequence[Losses], question: BlameQuestion, **how: bool
    ) -> dict[Losses, BlameAnswer]:
        words = " ".join(word for word, is_wanted in how.items() if is_wanted)
        jobs = [
            Job(
                key=f"{question.until} {words} {_digest(losses)}",
                work=partial(_fields, self.convoy.losing(losses).text, question, **how),
            )
            for losses in sets
        ]
        self.runs += len(jobs)
        answers = [BlameAnswer(**fields) for fields in self.engine.results(jobs)]
        return dict(zip(sets, answers, strict=True))


def _fields(text: str, question: BlameQuestion, **how: bool) -> dict[str, Any]:
    return asdict(rerun(scenario_from_text(text), question, **how))


def _first_difference(text: str, truth: Truth) -> tuple[str, int] | None:
    return first_difference(scenario_from_text(text), truth)


def _digest(losses: Losses) -> str:
    names = sorted((*one.link, one.number) for one in losses)
    return blake2b(repr(names).encode(), digest_size=12).hexdigest()
