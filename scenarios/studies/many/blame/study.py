"""`convoy blame`: which losses of a recorded run were to blame for what became of it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from scenarios.runs.cores import cores
from scenarios.runs.pool import RunAll
from scenarios.studies.many.blame.imposed import LossFree, loss_free
from scenarios.studies.many.blame.losses import Burst, RecordedRun, bursts_of, read_run
from scenarios.studies.many.blame.ranking import Blamed, losses_of, ranked, try_alone
from scenarios.studies.many.blame.rerun import BlameAnswer, BlameQuestion, FigureName, answer_of
from scenarios.studies.many.blame.shrinking import SmallestSet, shrunk
from scenarios.studies.many.blame.trials import Trials
from scenarios.studies.many.limit import Limit
from transport.log.records import LogError
from vehicles.schedule import SECOND

AFTER_NS = SECOND
"""Fewer losses may break the limit a little later, so runs go on for so long after the worst."""
MOST_RUNS = 400


@dataclass(frozen=True, slots=True, kw_only=True)
class Blame:
    """What was found: of the recorded run, of one without any loss, of bursts and the smallest set.

    `mended` is the run with the costliest row given back. `smallest` is None where the limit was
    not broken or is broken without any loss, as `unshrunk` says.
    """

    run: RecordedRun
    question: BlameQuestion
    convoy: LossFree
    recorded: BlameAnswer
    clean: BlameAnswer
    bursts: tuple[Burst, ...]
    rows: tuple[Blamed, ...]
    mended: BlameAnswer
    smallest: SmallestSet | None = None
    smallest_answer: BlameAnswer | None = None
    unshrunk: str = ""
    runs: int = 0
    seconds: float = 0.0


def blame(
    log: Path,
    limit: Limit,
    figure: FigureName,
    say: Callable[[str], None],
    run_all: RunAll,
    *,
    most_runs: int = MOST_RUNS,
    abreast: int = 0,
) -> Blame:
    """Find what was to blame for the worst figure of a log, and for the breach of `limit`.

    Raises LogError, also if the losses of the log do not lead to what it says. Runs are driven by
    `run_all`: on one worker of it that shares their beginnings, so many `abreast`, or with 0 each
    from the start.
    """
    at_once = cores()
    search = _Search(limit, figure, say, run_all, at_once, most_runs, abreast)
    return search.blame(read_run(log))


@dataclass(frozen=True, slots=True)
class _Search:
    """How the search is to be done."""

    limit: Limit
    figure: FigureName
    say: Callable[[str], None]
    run_all: RunAll
    at_once: int
    most_runs: int
    abreast: int

    def blame(self, run: RecordedRun) -> Blame:
        """Compare the run with itself, rank, shrink."""
        asked = BlameQuestion(figure=self.figure, limit=self.limit)
        recorded = answer_of(run.scenario, asked, run.start_at, run.told)
        if not recorded.vehicle:
            raise LogError(f"{run.log}: holds no {self.figure} of a follower to blame losses for")
        trials = self._trials(loss_free(run), recorded)
        bursts = bursts_of(run.lost(trials.question.until))
        if not bursts:
            until_s = trials.question.until / SECOND
            raise LogError(
                f"{run.log}: no message was lost until {until_s:.2f} s, a second after "
                f"the worst; there is nothing to blame"
            )
        trials.doing = "the run as recorded, and without any loss"
        _check_same(trials, run)
        (clean,) = trials.answers([frozenset()], whole=True)
        trials.doing = "bursts given back"
        rows = ranked(trials, bursts, recorded, recorded.badness_m - clean.badness_m)
        trials.doing = "bursts alone"
        try_alone(trials, rows)
        unshrunk = _why_not_shrunk(recorded, clean, self.limit)
        smallest = None if unshrunk else shrunk(trials, bursts, rows)
        trials.doing = "for the picture"
        (mended,) = trials.answers([losses_of(bursts) - rows[0].losses], whole=True)
        again = trials.answers([frozenset(smallest.messages)], whole=True) if smallest else [None]
        return Blame(
            run=run,
            question=trials.question,
            convoy=trials.convoy,
            recorded=recorded,
            clean=clean,
            bursts=bursts,
            rows=tuple(rows),
            mended=mended,
            smallest=smallest,
            smallest_answer=again[0],
            unshrunk=unshrunk,
            runs=trials.runs,
            seconds=trials.seconds,
        )

    def _trials(self, convoy: LossFree, recorded: BlameAnswer) -> Trials:
        breach_at = recorded.broken_at or 0
        return Trials(
            convoy=convoy,
            question=BlameQuestion(
                figure=self.figure,
                limit=self.limit,
                until=max(recorded.worst_at, breach_at) + AFTER_NS,
            ),
            breaks_by=breach_at + AFTER_NS,
            run_all=self.run_all,
            at_once=self.at_once,
            most_runs=self.most_runs,
            say=self.say,
            abreast=self.abreast,
        )


def _check_same(trials: Trials, run: RecordedRun) -> None:
    """Lose what the log lost, and compare all true poses, bit for bit; raises LogError."""
    everything = frozenset(run.lost(max(at for _, at in run.truth) + SECOND * 3600))
    whole = trials.whole_run(everything)
    instants = sorted(run.truth, key=lambda one: (one[1], one[0]))
    off = next((key for key in instants if whole.truth.get(key) != run.truth[key]), None)
    if off is None:
        return
    vehicle, at = off
    late = f" ({run.late} messages came late)" if run.late else ""
    raise LogError(
        f"{run.log}: with the same losses {vehicle} is elsewhere {at / SECOND:.2f} s after the "
        f"start{late}; blame needs a run that virtual time repeats"
    )


def _why_not_shrunk(recorded: BlameAnswer, clean: BlameAnswer, limit: Limit) -> str:
    if recorded.broken_at is None:
        return f"the limit {limit} was not broken, so there is no set to shrink"
    if clean.broken_at is not None:
        return f"the limit {limit} is broken without any loss, so there is no set to shrink"
    return ""
