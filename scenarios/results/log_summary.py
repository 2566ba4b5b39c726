"""The summary and the scenario of a run, from its log alone."""

from collections.abc import Mapping
from pathlib import Path

from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.limits import broken_limits, why_failed
from scenarios.results.metrics import Metrics
from scenarios.results.summary import RunIdentity, RunSummary, from_json
from transport.log.reader import LogReader
from transport.log.records import LogError
from vehicles.messages import RunStart
from vehicles.schedule import SECOND, nanoseconds

LOG_NAME = "run.mcap"
SUMMARY_NAME = "summary.json"
"""The two files of a run's folder; the summary is also attached to the log."""
METADATA_NAME = "convoy"
"""The log's record of metadata that says which run it is."""


def summarise(
    identity: RunIdentity,
    scenario: Scenario,
    metrics: Metrics,
    *,
    ran_ns: int,
    reason: str,
    rejected: Mapping[str, int],
) -> RunSummary:
    """Put the figures of a run together; `ran_ns` is how long it ran, `rejected` by reason.

    A `reason` to end early stays the first; the limits that were broken follow it.
    """
    metrics.events.finish()
    ran_ns = min(ran_ns, nanoseconds(scenario.duration_s))
    vehicles, events = metrics.vehicle_summaries(ran_ns), metrics.events.events()
    reason = why_failed(reason, broken_limits(scenario.tables.limits, events, vehicles))
    return RunSummary(
        identity=identity,
        outcome="failed" if reason else "completed",
        reason=reason,
        duration_s=scenario.duration_s,
        ran_s=ran_ns / SECOND,
        recorder_rejected_messages=dict(sorted(rejected.items())),
        vehicles=vehicles,
        links=metrics.link_summaries(),
        events=events,
        holes=metrics.holes(ran_ns),
    )


def summary_of(log: Path) -> RunSummary:
    """The summary inside `log`; for a log that breaks off, worked out from its messages."""
    reader = LogReader(log)
    attachments = reader.attachments()
    if SUMMARY_NAME in attachments:
        try:
            return from_json(attachments[SUMMARY_NAME].decode())
        except ValueError as error:
            raise LogError(f"{log} ({SUMMARY_NAME}): {error}") from error
    scenario = scenario_in(log, attachments)
    metrics = Metrics.of(scenario)
    start_at = last_at = 0
    for at, _, message in reader.messages():
        metrics.add(message)
        last_at = at
        if isinstance(message, RunStart):
            start_at = message.start_at_ns
    return summarise(
        RunIdentity.of_values(reader.metadata().get(METADATA_NAME, {})),
        scenario,
        metrics,
        ran_ns=max(last_at - start_at, 0) if start_at else 0,
        reason="the log breaks off",
        rejected={},
    )


def scenario_in(log: Path, attachments: Mapping[str, bytes]) -> Scenario:
    """The scenario inside a log, with the lead's path or trace, so that it can be run again."""
    if ATTACHED_AS not in attachments:
        raise LogError(f"{log}: holds no scenario; was it written by `convoy`?")
    return scenario_from_text(attachments[ATTACHED_AS].decode(), label=f"{log} ({ATTACHED_AS})")
