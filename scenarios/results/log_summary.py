"""The summary and the scenario of a run, from its log alone."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.results.limits import limit_figures, why_failed
from scenarios.results.metrics import Metrics
from scenarios.results.summary import (
    RunIdentity,
    RunSummary,
    VehicleSummary,
    from_json,
    to_json,
)
from transport.log.reader import LogReader
from transport.log.records import LogError
from transport.log.repair import REPAIRED
from vehicles.messages import RunStart
from vehicles.schedule import SECOND, nanoseconds

METADATA_NAME = "convoy"
"""The log's record of metadata that says which run it is."""
SILENT_S = 1.0
"""A link without loss that delivered nothing for so long did not work."""
LATE_SHARE = 0.01
"""A run of which a larger share of the ticks began late was not one in real time."""


def write_summary(folder: Path, summary: RunSummary) -> None:
    """Write `summary.json` whole or not at all; raises LogError."""
    path = folder / SUMMARY_NAME
    beside = path.with_name(path.name + ".part")
    try:
        beside.write_text(to_json(summary), encoding="utf-8")
        beside.replace(path)
    except OSError as error:
        with suppress(OSError):
            beside.unlink()
        raise LogError(f"{path}: cannot write the summary: {error.strerror}") from error


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
    deadlines = metrics.deadlines.figures(ran_ns)
    limits = limit_figures(scenario.tables.limits, events, vehicles, deadlines)
    reason = why_failed(reason, [one.line for one in limits if one.broken])
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
        limits=limits,
        warnings=(
            *late_lines(vehicles),
            *metrics.warnings,
            *metrics.out_of_linear.values(),
            *metrics.link_misses(),
        ),
    )


def late_lines(vehicles: Sequence[VehicleSummary]) -> Iterator[str]:
    """Say that the vehicles did not keep up with the wall clock, if they did not."""
    ticks, late = sum([one.ticks for one in vehicles]), sum([one.late_ticks for one in vehicles])
    if late <= LATE_SHARE * ticks:
        return
    worst = max(vehicles, key=lambda one: one.lateness_ms_max)
    yield (
        f"{100.0 * late / ticks:.2g} % of the ticks began late, by up to "
        f"{worst.lateness_ms_max:.0f} ms ({worst.name}), and with them messages and commands: the "
        f"machine is too slow or too busy to drive {len(vehicles)} vehicles in real time; "
        "--clock virtual takes the time that it needs"
    )


def silent_links(
    metrics: Metrics,
    replayed: frozenset[str] = frozenset(),
    off: frozenset[tuple[str, str]] = frozenset(),
) -> str:
    """Say which links that should lose nothing delivered nothing; nothing if there is none.

    Only what sender and receiver both lived for counts, beyond the delay that was asked for; a
    receiver that is `replayed` listens to nobody. Of links that are `off` the sender or the
    receiver has no radio for a time.
    """
    said = []
    for link in metrics.link_summaries():
        asked = link.requested
        common_s = min(
            metrics.lived_s(link.sender, as_sender=True),
            metrics.lived_s(link.receiver, as_sender=False),
        )
        expected_s = common_s - (asked.latency_ms + asked.jitter_ms) / 1000.0
        listens = link.receiver not in replayed
        is_on = (link.sender, link.receiver) not in off
        is_sure = asked.is_sure and not metrics.links[link.sender, link.receiver].changed
        if listens and is_on and is_sure and not link.heard and expected_s >= SILENT_S:
            said.append(f"{link.sender} → {link.receiver} delivered none of {link.sent} poses")
    refused = [
        f"{name} refused {figures.health.rejected_messages} messages"
        for name, figures in metrics.vehicles.items()
        if said and figures.health and figures.health.rejected_messages
    ]
    return "; ".join((*said, *refused))


def log_in(path: Path) -> Path:
    """The log that `path` names: itself, or the one in the folder of a run."""
    return path / LOG_NAME if path.is_dir() else path


def summary_of(log: Path, warn: Callable[[str], None] = lambda _: None) -> RunSummary:
    """The summary inside `log`; for a log that breaks off, worked out from its messages.

    So it is for one that had to be repaired: what was attached last did not know of that yet.

    `warn` is called with a line about damage.
    """
    reader = LogReader(log)
    attachments = reader.attachments()
    if reader.damage and not {SUMMARY_NAME, ATTACHED_AS} & attachments.keys():
        raise LogError(f"{reader.damage}; with it the scenario")
    if reader.damage:
        warn(reader.damage)
    if SUMMARY_NAME in attachments and REPAIRED not in reader.metadata():
        try:
            return from_json(attachments[SUMMARY_NAME].decode())
        except ValueError as error:
            raise LogError(f"{log} ({SUMMARY_NAME}): {error}") from error
    scenario = scenario_in(log, attachments)
    metrics = Metrics.of(scenario)
    start_at = 0
    for _, _, message in reader.messages(metrics.topics):
        metrics.add(message)
        if isinstance(message, RunStart):
            start_at = message.start_at_ns
    thinned = reader.thinned
    if thinned:
        held = ", ".join(thinned)
        warn(f"{log}: holds but some of its {held}, and these figures are of what it holds")
    try:
        identity = RunIdentity.of_values(reader.metadata().get(METADATA_NAME, {}))
    except ValueError as error:
        raise LogError(f"{log} (metadata {METADATA_NAME}): {error}") from error
    summary = summarise(
        identity,
        scenario,
        metrics,
        ran_ns=max(reader.last_at - start_at, 0) if start_at else 0,
        reason="the log is damaged" if reader.damage else "the log breaks off",
        rejected={},
    )
    if "truth" in thinned:  # what was not to be logged is no hole
        return replace(summary, holes=tuple(one for one in summary.holes if one.kind == "pose"))
    return summary


def scenario_in(log: Path, attachments: Mapping[str, bytes]) -> Scenario:
    """The scenario inside a log, with the lead's path or trace, so that it can be run again."""
    if ATTACHED_AS not in attachments:
        raise LogError(f"{log}: holds no scenario; was it written by `convoy`?")
    try:
        text = attachments[ATTACHED_AS].decode()
    except UnicodeDecodeError as error:
        raise LogError(f"{log} ({ATTACHED_AS}): is no text") from error
    return scenario_from_text(text, label=f"{log} ({ATTACHED_AS})")
