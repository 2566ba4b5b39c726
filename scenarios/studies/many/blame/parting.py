"""Runs that lose the same until they part: each is driven from shortly before that, by forks."""

import atexit
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

from scenarios.runs.forked import ForkedRuns, Journey
from scenarios.studies.many.blame.imposed import LossFree
from scenarios.studies.many.blame.losses import Losses, LostMessage
from scenarios.studies.many.blame.rerun import EVER, Asked, BlameAnswer, Rerun
from vehicles.schedule import SECOND

STAY_EVERY = 3 * SECOND
"""A run leaves copies of itself at so many ns from one another, until the limit is broken.

Each costs as much as a third of a second of a run or so.
"""

LOOK_EVERY = SECOND // 4
"""So often it looks if anybody waits for it."""


@dataclass(frozen=True, slots=True)
class LossyWay:
    """A run of a convoy: what is lost in it, and what is asked."""

    losses: Losses
    asked: Asked

    def same_until(self, other: "LossyWay") -> int:
        """When the first message is sent that only one loses, or the other is to end before.

        Its verdict is the first that differs, and it is not judged before it is sent.
        """
        return min(_parting_at(self.losses, other.losses), other.asked.question.until)


@lru_cache(1024)
def _parting_at(some: Losses, others: Losses) -> int:
    return min((one.sent_at for one in some ^ others), default=EVER)


class _PartingRun:
    """A run that leaves copies of itself on its way."""

    def __init__(self, convoy: LossFree, way: LossyWay, journey: Journey[LossyWay]) -> None:
        self._convoy, self._way, self._journey = convoy, way, journey
        scenario = convoy.losing(way.losses)
        self._run = Rerun(scenario, way.asked)
        for at in range(LOOK_EVERY, round(scenario.duration_s * SECOND), LOOK_EVERY):
            before = scenario.start_at_ns + at - 1  # what is sent at that instant is judged after
            self._run.convoy.call(before, partial(self._look, at))

    def _look(self, at: int) -> None:
        self._journey.look()
        # Where the limit is broken another run may have to end.
        if at % STAY_EVERY == 0 and self._run.watch.broken_at is None:
            self._leave_copy(at)

    def _leave_copy(self, at: int) -> None:
        way = self._journey.stay(at)
        if way is not self._way:
            self._way = way
            self._run.turn(self._convoy.losing(way.losses), way.asked)

    def run(self) -> BlameAnswer:
        return self._run.run()


@dataclass(slots=True)
class _Parting:
    """The runs of this process, all of one convoy; `known` are equal messages made the same.

    So two sets of them are compared quickly.
    """

    convoy: LossFree
    abreast: int
    runs: ForkedRuns[LossyWay]
    known: dict[LostMessage, LostMessage]

    def way(self, losses: Losses, asked: Asked) -> LossyWay:
        return LossyWay(frozenset(self.known.setdefault(one, one) for one in losses), asked)


_here: _Parting | None = None
"""What goes on from one call to the next: copies of runs stay as long as this process."""


def drive_parting(
    convoy: LossFree, asked: Sequence[tuple[Losses, Asked]], abreast: int
) -> list[BlameAnswer]:
    """Drive a convoy with each of the losses, so many runs at once, each in a process of its own.

    What is found is what `drive` finds. The next call for the same convoy is the quicker for it.
    """
    global _here  # noqa: PLW0603 - processes are this process's
    if _here is None or (_here.convoy, _here.abreast) != (convoy, abreast):
        end_parting()
        runs = ForkedRuns(partial(_driven, convoy), abreast)
        _here = _Parting(convoy, abreast, runs, {})
    try:
        return _here.runs.results([_here.way(losses, one) for losses, one in asked])
    except BaseException:
        _here = None
        raise


@atexit.register
def end_parting() -> None:
    """End the processes of earlier calls."""
    global _here  # noqa: PLW0603
    if _here is not None:
        _here.runs.close()
        _here = None


def _driven(convoy: LossFree, way: LossyWay, journey: Journey[LossyWay]) -> BlameAnswer:
    return _PartingRun(convoy, way, journey).run()
