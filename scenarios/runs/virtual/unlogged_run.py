"""Virtual runs without a log: the summary that a logged run would have, or the drives."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from scenarios.definition.scenario import Scenario
from scenarios.results.drives import DriveRecorder, Trial
from scenarios.results.metrics import Metrics
from scenarios.results.stream import FigureStream
from scenarios.results.summarise import silent_links, summarise
from scenarios.results.summary import RunIdentity, RunSummary
from scenarios.runs.limit_watch import LimitWatch
from scenarios.runs.observer import Observer
from scenarios.runs.virtual.drive import drive

if TYPE_CHECKING:  # only runs with replayed vehicles read logs
    from scenarios.runs.node.recorded_vehicle import Replay


def run_unlogged(scenario: Scenario, observers: Sequence[Observer] = ()) -> RunSummary:
    """Run `scenario` in virtual time; returns the summary that a logged run would have."""
    metrics = Metrics.of(scenario)
    limits = LimitWatch(scenario.tables.limits, metrics)
    outcome = drive(scenario, [metrics, limits, *observers], until=lambda: bool(limits.reason))
    return summarise(
        RunIdentity.here(scenario, "virtual", scenario.virtual_run_id),
        scenario,
        metrics,
        ran_ns=outcome.at - scenario.start_at_ns,
        reason=str(outcome.fault or "")
        or limits.reason
        or silent_links(metrics, off=scenario.off_links),
        rejected={},
    )


def drive_trial(scenario: Scenario, replays: "Sequence[Replay]" = ()) -> Trial:
    """Run `scenario` in virtual time and keep its drives; raises VehicleFaultError."""
    stream = FigureStream.of(scenario)
    drives = DriveRecorder(scenario, stream)
    drive(scenario, [stream, drives], replays=replays).raise_fault()
    return drives.trial()
