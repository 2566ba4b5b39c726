"""`convoy blame`: all steps in order."""

import hashlib
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from scenarios.definition.run_limits import Limit
from scenarios.results.log_summary import scenario_of
from scenarios.results.versions import current_stamp, plug_in_digests
from scenarios.studies.engine.engine import Engine
from scenarios.studies.engine.workers import cores
from scenarios.studies.many.blame.listed_losses import LossFreeScenario, loss_free
from scenarios.studies.many.blame.losses import Burst, LostMessage, RecordedRun, bursts_of, read_run
from scenarios.studies.many.blame.ranking import Attribution, losses_of, rank_losses, run_alone
from scenarios.studies.many.blame.rerun import FigureName, RerunCriteria, RerunResult, result_of
from scenarios.studies.many.blame.shrinking import SmallestSet, smallest_set
from scenarios.studies.many.blame.trials import Trials
from transport.log.errors import LogError
from vehicles.schedule import SECOND

AFTER_NS = SECOND
"""Reruns continue this long after the worst instant: fewer losses may break the limit later."""
MAX_RUNS = 400


@dataclass(frozen=True, slots=True, kw_only=True)
class BlameResult:
    """Results of the recorded run, of a run without losses, and of reruns.

    `best_restored` is the run with the first of the `rows` restored. `smallest` is None if the
    limit is kept or is broken without losses; `not_reduced_reason` is then the reason.
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

    Raises LogError if the log is unusable, or if its losses do not reproduce the run.
    """
    run = read_run(log)
    criteria = RerunCriteria(figure=figure, limit=limit)
    recorded = result_of(run.scenario, criteria, run.start_at, run.messages)
    if not recorded.vehicle:
        raise LogError(f"{log}: has no true {figure} of a follower")
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
            f"{log}: no message was lost until {until_s:.2f} s, one second after the worst {figure}"
        )
    trials.set_stage("repeating the run, with and without its losses")
    _check_same(trials, run)
    (clean,) = trials.results([frozenset()], whole=True)
    trials.set_stage("restoring bursts")
    rows = rank_losses(trials, bursts, recorded, recorded.badness_m - clean.badness_m)
    trials.set_stage("losing single bursts only")
    run_alone(trials, rows)
    not_reduced_reason = _reason_not_reduced(recorded, clean, limit)
    smallest = None if not_reduced_reason else smallest_set(trials, bursts, rows)
    trials.set_stage("simulating the plotted runs")
    (best_restored,) = trials.results([losses_of(bursts) - rows[0].losses], whole=True)
    smallest_results = (
        trials.results([frozenset(smallest.items)], whole=True) if smallest else [None]
    )
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
        smallest_result=smallest_results[0],
        not_reduced_reason=not_reduced_reason,
        runs=trials.runs,
        seconds=trials.seconds,
    )


def _check_same(trials: Trials, run: RecordedRun) -> None:
    """Raise LogError unless a rerun with the same losses has identical true poses."""
    everything = frozenset(run.lost(max(at for _, at in run.truth) + SECOND * 3600))
    difference = trials.first_difference(everything, run.truth)
    if difference is None:
        return
    vehicle, at = difference
    late = f" ({run.late} messages were late)" if run.late else ""
    raise LogError(
        f"{run.log}: not reproducible: in a rerun, {vehicle} differs from {at / SECOND:.2f} s "
        f"on{late}; use the log of a run with `--clock virtual`"
    )


def identity_of_blame(log: Path, limit: Limit, figure: FigureName, max_runs: int) -> dict[str, Any]:
    """Everything that the result depends on, named as on the command line; raises LogError."""
    try:
        with log.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()[:12]
    except OSError as error:
        raise LogError(f"{log}: cannot read the log: {error.strerror}") from error
    return {
        "LOG": str(log),
        "log digest": digest,
        "--limit": str(limit),
        "--figure": figure,
        "--runs": max_runs,
        **asdict(current_stamp()),
        "plug_ins": dict(plug_in_digests(scenario_of(log).plug_ins)),
    }


def _reason_not_reduced(recorded: RerunResult, clean: RerunResult, limit: Limit) -> str:
    if recorded.broken_at is None:
        return f"the limit {limit} was not broken: no set of losses to reduce"
    if clean.broken_at is not None:
        return f"the limit {limit} is broken without any loss: no set of losses to reduce"
    return ""
