"""Runs with other losses, several at once, none of them twice."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from scenarios.runs.pool import RunAll
from scenarios.studies.many.blame.imposed import LossFree
from scenarios.studies.many.blame.losses import Losses
from scenarios.studies.many.blame.parting import drive_parting
from scenarios.studies.many.blame.rerun import EVER, Asked, BlameAnswer, BlameQuestion, run_anew

SAY_EVERY_S = 3.0


@dataclass(slots=True)
class Trials:
    """Runs of one convoy, each with the losses that are asked for.

    `runs` counts those driven; `most_runs` is how many there may be. `at_once` runs are begun
    together: so many `abreast` on one worker that shares their beginnings, or with 0 on several
    from the start. A set of losses breaks the limit if it does so until `breaks_by` (ns after the
    start).
    """

    convoy: LossFree
    question: BlameQuestion
    breaks_by: int
    run_all: RunAll
    at_once: int
    most_runs: int
    say: Callable[[str], None]
    abreast: int = 0
    runs: int = 0
    doing: str = ""
    _answers: dict[Losses, BlameAnswer] = field(default_factory=dict)
    _broken: dict[Losses, bool] = field(default_factory=dict)
    _began: float = field(default_factory=time.monotonic)
    _said: float = field(default_factory=time.monotonic)

    @property
    def are_enough(self) -> bool:
        """Whether there may be no more runs."""
        return self.runs >= self.most_runs

    @property
    def seconds(self) -> float:
        """How long they have taken so far."""
        return time.monotonic() - self._began

    def answers(self, of: Iterable[Losses], *, whole: bool = False) -> list[BlameAnswer]:
        """What runs with these losses, and no others, come to."""
        wanted = list(of)
        new = [one for one in dict.fromkeys(wanted) if whole or one not in self._answers]
        self._answers |= self._driven(new, Asked(question=self.question, whole=whole))
        return [self._answers[losses] for losses in wanted]

    def whole_run(self, losses: Losses) -> BlameAnswer:
        """What a run with these losses comes to, to its very end."""
        asked = Asked(question=replace(self.question, until=EVER), whole=True)
        return self._driven([losses], asked)[losses]

    def first_that_breaks(self, sets: Sequence[Losses]) -> int | None:
        """The place of the first set of losses that breaks the limit, None if none does.

        They are tried in turn, some at once; which is found does not depend on how many. When there
        may be no more runs the rest count as not breaking it.
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
        question = replace(self.question, until=self.breaks_by)
        known = self._broken.keys() | self._answers.keys()
        new = [losses for losses in dict.fromkeys(sets) if losses not in known]
        driven = self._driven(new, Asked(question=question, ends_when_broken=True))
        found = driven | {one: self._answers[one] for one in sets if one in self._answers}
        self._broken |= {losses: self.is_breach(answer) for losses, answer in found.items()}

    def is_breach(self, answer: BlameAnswer) -> bool:
        """Whether the limit was broken in time."""
        return answer.broken_at is not None and answer.broken_at <= self.breaks_by

    def _driven(self, sets: Sequence[Losses], asked: Asked) -> dict[Losses, BlameAnswer]:
        found: dict[Losses, BlameAnswer] = {}
        for losses, answer in self._results(sets, asked):
            found[losses] = answer
            self.runs += 1
            if time.monotonic() - self._said > SAY_EVERY_S:
                self._said = time.monotonic()
                self.say(f"{self.seconds:5.1f} s  {self.runs} runs: {self.doing}")
        return found

    def _results(
        self, sets: Sequence[Losses], asked: Asked
    ) -> Iterable[tuple[Losses, BlameAnswer]]:
        if not self.abreast:
            jobs = {one: partial(run_anew, self.convoy.losing(one), asked) for one in sets}
            yield from self.run_all(jobs)
        elif sets:
            # One job, so that it is always the same worker that has it, where copies stay.
            some = [(one, asked) for one in sets]
            together = {"": partial(drive_parting, self.convoy, some, self.abreast)}
            for _, answers in self.run_all(together):
                yield from zip(sets, answers, strict=True)
