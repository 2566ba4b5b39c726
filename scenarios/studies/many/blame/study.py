"""`convoy blame`: all its steps, in order."""

import hashlib
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from scenarios.definition.run_limits import Limit
from scenarios.studies.engine.engine import Engine
from scenarios.studies.engine.stamp import current_stamp
from scenarios.studies.engine.workers import cores
from scenarios.studies.many.blame.listed_losses import LossFreeScenario, loss_free
from scenarios.studies.many.blame.losses import Burst, LostMessage, RecordedRun, bursts_of, read_run
from scenarios.studies.many.blame.ranking import Attribution, losses_of, rank_losses, run_alone
from scenarios.studies.many.blame.rerun import FigureName, RerunCriteria, RerunResult, result_of
from scenarios.studies.many.blame.shrinking import SmallestSet, smallest_set
from scenarios.studies.many.blame.trials import Trials
from transport.log.records import LogError
from vehicles.schedule import SECOND

AFTER_NS = SECOND
"""Fewer losses may break the limit a little later, so runs go on this long after the worst."""
MAX_RUNS = 400


@dataclass(frozen=True, slots=True, kw_only=True)
class BlameResult:
    """The result: the recorded run, one without any loss, the bursts, and the smallest set.

    `mended` is the run with the costliest row restored. `smallest` is None if the limit was not
    broken or is broken without any loss; then `not_reduced_reason` is the reason.
    """

    run: RecordedRun
    criteria: RerunCriteria
    convoy: LossFreeScenario
    recorded: RerunResult
    clean: RerunResult
    bursts: tuple[Burst, ...]
    rows: tuple[Attribution, ...]
    best_restored: RerunResult
    smallest: SmallestSet[LostMessage] | None = None
    smallest_result: RerunResult | None = None
    not_reduced_reason: str = ""
    runs: int = 0
    seconds: float = 0.0


def blame(
    log: Path, limit: Limit, figure: FigureName, engine: Engine, *, max_runs: int = MAX_RUNS
) -> BlameResult:
    """Find the losses that caused the worst figure of a log and the breach of `limit`.

    Repeats the run, ranks its losses, and shrinks them. Raises LogError, also if the losses of the
    log do not reproduce it.
    """
    run = read_run(log)
    criteria = RerunCriteria(figure=figure, limit=limit)
    recorded = result_of(run.scenario, criteria, run.start_at, run.messages)
    if not recorded.vehicle:
        raise LogError(f"{log}: holds no {figure} of a follower to blame losses for")
    breach_at = recorded.broken_at or 0
    trials = Trials(
        convoy=loss_free(run),
        criteria=replace(criteria, until=max(recorded.worst_at, breach_at) + AFTER_NS),
        breaks_by=breach_at + AFTER_NS,
        engine=engine,
        parallel=cores(),
        max_runs=max_runs,
    )
    bursts = bursts_of(run.lost(trials.criteria.until))
    if not bursts:
        until_s = trials.criteria.until / SECOND
        raise LogError(
            f"{log}: no message was lost until {until_s:.2f} s, a second after "
            f"the worst; there is nothing to blame"
        )
    trials.set_stage("the run as recorded, and without any loss")
    _check_same(trials, run)
    (clean,) = trials.results([frozenset()], whole=True)
    trials.set_stage("bursts given back")
    rows = rank_losses(trials, bursts, recorded, recorded.badness_m - clean.badness_m)
    trials.set_stage("bursts alone")
    run_alone(trials, rows)
    not_reduced_reason = _reason_not_reduced(recorded, clean, limit)
    smallest = None if not_reduced_reason else smallest_set(trials, bursts, rows)
    trials.set_stage("for the picture")
    (best_restored,) = trials.results([losses_of(bursts) - rows[0].losses], whole=True)
    again = trials.results([frozenset(smallest.items)], whole=True) if smallest else [None]
    return BlameResult(
        run=run,
        criteria=trials.criteria,
        convoy=trials.convoy,
        recorded=recorded,
        clean=clean,
        bursts=bursts,
        rows=tuple(rows),
        best_restored=best_restored,
        smallest=smallest,
        smallest_result=again[0],
        not_reduced_reason=not_reduced_reason,
        runs=trials.runs,
        seconds=trials.seconds,
    )


def _check_same(trials: Trials, run: RecordedRun) -> None:
    """Repeat the run with its losses and compare all true poses bit for bit; raises LogError."""
    everything = frozenset(run.lost(max(at for _, at in run.truth) + SECOND * 3600))
    off = trials.first_difference(everything, run.truth)
    if off is None:
        return
    vehicle, at = off
    late = f" ({run.late} messages came late)" if run.late else ""
    raise LogError(
        f"{run.log}: with the same losses {vehicle} is elsewhere {at / SECOND:.2f} s after the "
        f"start{late}; blame needs a run that virtual time repeats"
    )


def identity_of_blame(log: Path, limit: Limit, figure: FigureName, max_runs: int) -> dict[str, Any]:
    """All that the result depends on, by the words of the command line; raises LogError."""
    try:
        with log.open("rb") as file:
            content = hashlib.file_digest(file, "sha256").hexdigest()[:12]
    except OSError as error:
        raise LogError(f"{log}: cannot read the log: {error.strerror}") from error
    return {
        "LOG": str(log),
        "its content": content,
        "--limit": str(limit),
        "--figure": figure,
        "--runs": max_runs,
        **asdict(current_stamp()),
    }


def _reason_not_reduced(recorded: RerunResult, clean: RerunResult, limit: Limit) -> str:
    if recorded.broken_at is None:
        return f"the limit {limit} was not broken, so there is no set to shrink"
    if clean.broken_at is not None:
        return f"the limit {limit} is broken without any loss, so there is no set to shrink"
    return ""
