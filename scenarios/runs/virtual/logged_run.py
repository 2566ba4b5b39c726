"""`--clock virtual`: a virtual run that writes a log and a summary."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.definition.scenario import Scenario
from scenarios.results.drives import DriveRecorder, Trial
from scenarios.results.metrics import Metrics
from scenarios.results.summary import RunSummary
from scenarios.runs.observer import ALL_KINDS, Observer, OnMessage
from scenarios.runs.run_log import RunLog
from scenarios.runs.stop import EXIT_FAILED, Stop
from scenarios.runs.virtual.drive import drive
from transport.log.errors import LogError
from vehicles.messages import Message, RunStart
from vehicles.schedule import SECOND

if TYPE_CHECKING:  # only runs with replayed vehicles read logs
    from scenarios.runs.node.recorded_vehicle import Replay


def run_virtual(
    scenario: Scenario,
    folder: Path,
    stop: Stop,
    *,
    metrics: Metrics | None = None,
    observers: Sequence[Observer] = (),
    replays: "Sequence[Replay]" = (),
) -> RunSummary:
    """Run `scenario` in virtual time and write log and summary into `folder`.

    The log is equal byte for byte for equal arguments, seeds and versions.

    Args:
        scenario: What to simulate.
        folder: Where the files go.
        stop: Ends the run early; a failed run requests a stop with its reason.
        metrics: Figures that the `observers` show; made here otherwise.
        observers: Called for every recorded message, after log and figures.
        replays: Vehicles that send what was recorded, while the others are live.

    """
    run = RunLog(
        scenario,
        folder,
        clock="virtual",
        run_id=scenario.virtual_run_id,
        metrics=metrics,
        observers=observers,
        replayed=frozenset(replay.vehicle for replay in replays),
    )

    def begin(at: int, start: Message) -> None:
        if isinstance(start, RunStart):
            run.start(at, start.start_at_ns)

    def log_departure(at: int, vehicle: str) -> None:
        after_s = (at - scenario.start_at_ns) / SECOND
        line = f"{vehicle} left {after_s:.1f} s after the start; the convoy continues without it"
        run.recorder.log(at, line)

    log = (
        OnMessage(begin, frozenset({RunStart})),
        OnMessage(run.recorder.record, ALL_KINDS - {RunStart}),
    )
    at = scenario.start_at_ns
    try:
        outcome = drive(
            scenario,
            log,
            until=lambda: stop.requested or bool(run.early_end_reason),
            replays=replays,
            on_left=log_departure,
        )
        at = outcome.at
        if outcome.fault is not None:
            stop.request(str(outcome.fault), EXIT_FAILED)
    except LogError as error:  # the disk is full, or the log was removed
        at = run.recorder.last_at
        stop.request(str(error), EXIT_FAILED)
    run.end(at, stop.reason)
    summary = run.close(at)
    if summary.reason:  # also of a run that broke a limit and went on to its end
        stop.request(summary.reason, EXIT_FAILED)
    return summary


def record_trial(
    scenario: Scenario,
    folder: Path,
    replays: "Sequence[Replay]" = (),
    observers: Sequence[Observer] = (),
) -> Trial:
    """Run `scenario` as `run_virtual` does and keep its drives; raises LogError if it fails."""
    metrics = Metrics.of(scenario)
    drives = DriveRecorder(scenario, metrics.stream)
    summary = run_virtual(
        scenario,
        folder,
        Stop(),
        metrics=metrics,
        observers=(drives, *observers),
        replays=replays,
    )
    if summary.reason:
        raise LogError(summary.reason)
    return drives.trial()
