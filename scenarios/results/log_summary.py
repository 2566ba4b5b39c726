"""The summary and the scenario of a run, from its log alone."""

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import itemgetter
from pathlib import Path

import numpy as np

from scenarios.definition.errors import ScenarioError
from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.definition.wording import did_you_mean
from scenarios.results.files import LOG_NAME, SUMMARY_NAME, write_whole
from scenarios.results.limits import deadline_figures, failure_reason, limit_figures
from scenarios.results.link_account import accounts, away_spans, contradictions
from scenarios.results.links import LinkSummary, channel_warnings, link_summaries
from scenarios.results.outcome import LATE_RATIO, incomplete, late_ratio, with_outcome_line
from scenarios.results.own_measures import own_measures
from scenarios.results.record import record_holes, unseen
from scenarios.results.run_event import run_events
from scenarios.results.summary import RunIdentity, RunSummary, from_json, run_changes, to_json
from scenarios.results.tables import TOPICS_OF_METRICS, RunTables
from scenarios.results.vehicle_figures import VehicleSummary, tyre_warnings, vehicle_summaries
from transport.log.errors import LogError, UnwritableError
from transport.log.mcap_file import REPAIRED
from transport.log.reader import LogReader
from transport.topics import RUN_SENDER
from vehicles.schedule import SECOND, nanoseconds

# ---- Summarises the figures of a run, and writes the summary


METADATA_NAME = "convoy"
"""Name of the log's metadata that identify the run."""
SLOW_RATIO = 0.05
"""Share of poses above the floor latency from which the real transport was too slow."""
STANDSTILL_NS = SECOND
"""Time without any recorded message from which all processes stood still."""
MOST_WARNINGS = 50
"""Warnings about impossible time stamps in the summary."""


def write_summary(folder: Path, summary: RunSummary) -> None:
    """Write `summary.json` whole or not at all; raises UnwritableError."""
    path = folder / SUMMARY_NAME
    try:
        write_whole(path, to_json(summary).encode())
    except OSError as error:
        raise UnwritableError(f"{path}: cannot write the summary: {error.strerror}") from error


def summarise(
    identity: RunIdentity, run: RunTables, *, reason: str, rejected: Mapping[str, int]
) -> RunSummary:
    """Summarise a run.

    `rejected` counts refused messages by reason. Broken limits follow the `reason` to end early.
    """
    own, counted = own_measures(run), accounts(run)
    vehicles, listed = vehicle_summaries(run, own.figures), run_events(run)
    limits = limit_figures(
        run.scenario.tables.limits,
        listed,
        vehicles,
        deadline_figures(run),
        unseen(run),
        late_s={row.name: row.lateness_ms_max / 1000.0 for row in vehicles},
    )
    broken = [limit.message for limit in limits if limit.broken]
    reason = failure_reason(reason, [*broken, *contradictions(counted)])
    lacking = incomplete(vehicles)
    is_failed = reason not in {"", lacking}
    links = link_summaries(run, counted)
    summary = RunSummary(
        identity=identity,
        outcome="failed" if is_failed else "incomplete" if lacking else "completed",
        reason=reason or lacking,
        duration_s=run.scenario.duration_s,
        ran_s=run.ran_ns / SECOND,
        recorder_rejected_messages=dict(sorted(rejected.items())),
        vehicles=vehicles,
        links=links,
        events=listed,
        holes=record_holes(run),
        limits=limits,
        warnings=(
            *late_lines(vehicles, partial(standstills, run)),
            *transport_lines(links, vehicles, away_spans(run)),
            *alerts(run),
            *own.faults,
            *(line for _, line in tyre_warnings(run).values()),
            *channel_warnings(run, counted),
        ),
        changes=run_changes(run),
    )
    return with_outcome_line(summary)


def alerts(run: RunTables) -> Sequence[str]:
    """Lines of the log that cast doubt on the metrics, in order of recording."""
    lines = [
        (order, f"{name}: {text}")
        for name in (RUN_SENDER, *run.names)
        for table in [run.table(name, "log")]
        for order, level, text in zip(
            table.logged_at_ns.tolist(), table["level"], table["text"], strict=True
        )
        if level == "alert"
    ]
    return [line for _, line in sorted(lines, key=itemgetter(0))[:MOST_WARNINGS]]


def standstills(run: RunTables) -> Sequence[str]:
    """Times in which no message of any vehicle was recorded, such as "7.10 to 12.10 s"."""
    none = np.zeros(0, np.int64)
    tables = [columns for (name, _), columns in run.tables.items() if name in run.names]
    at = np.unique(np.concatenate([none, *(columns.logged_at_ns for columns in tables)]))
    return [
        f"{run.seconds(at[row]):.2f} to {run.seconds(at[row + 1]):.2f} s"
        for row in np.flatnonzero(np.diff(at) > STANDSTILL_NS)
    ]


def late_lines(
    vehicles: Sequence[VehicleSummary], find_standstills: Callable[[], Sequence[str]] = list
) -> Iterator[str]:
    """Warn if the vehicles did not keep up with the wall clock.

    `find_standstills` returns the times in which nothing was recorded: all processes stood still.
    """
    late = late_ratio(vehicles)
    if late <= LATE_RATIO:
        return
    if stopped := find_standstills():
        yield f"nothing ran from {', '.join(stopped)}: {100.0 * late:.2g} % of the ticks began late"
        return
    worst = max(vehicles, key=lambda vehicle: vehicle.lateness_ms_max)
    yield (
        f"{100.0 * late:.2g} % of the ticks began late, by up to "
        f"{worst.lateness_ms_max:.0f} ms ({worst.name}), and so did messages and commands: "
        f"{'; '.join(_late_causes(vehicles))}. Use --clock virtual"
    )


def _late_causes(vehicles: Sequence[VehicleSummary]) -> Iterator[str]:
    """Yield the causes of late ticks with their shares, the most frequent first."""
    at_start = sum([vehicle.late_ticks_at_start for vehicle in vehicles])
    by_network = sum([vehicle.late_ticks_by_network for vehicle in vehicles])
    every = sum([vehicle.late_ticks for vehicle in vehicles])
    busy = f"the machine is too slow or too busy for {len(vehicles)} vehicles in real time"
    counts = {
        busy: every - at_start - by_network,
        "sending was blocked by the network": by_network,
        "vehicles started late": at_start,
    }
    causes = sorted([(count, text) for text, count in counts.items() if count], reverse=True)
    for count, text in causes:
        yield text if len(causes) == 1 else f"{100.0 * count / every:.0f} %: {text}"


def transport_lines(
    links: Sequence[LinkSummary], vehicles: Sequence[VehicleSummary], away: Container[str] = ()
) -> Iterator[str]:
    """Warn of vehicles whose poses the network delayed beyond the floor latency of a link.

    Those that were `away`, out of reach for a while, have a line of their own.
    """
    late = {vehicle.name: late_ratio([vehicle]) for vehicle in vehicles}
    for sender in dict.fromkeys(row.sender for row in links if row.sender not in away):
        own = [row for row in links if row.sender == sender]
        row = max(own, key=lambda row: row.transport_above_floor_ratio or 0.0)
        above = row.transport_above_floor_ratio or 0.0
        # Otherwise late ticks delayed them.
        if above > SLOW_RATIO and late[sender] + late[row.receiver] < 0.5 * above:
            yield (
                f"the network was slow: {100.0 * above:.0f} % of the poses of {sender} took longer "
                f"than the floor latency of {row.requested.latency_ms:g} ms, "
                f"{row.transport_ms_mean or 0.0:.0f} ms on average and up to "
                f"{row.transport_ms_max or 0.0:.0f} ms. Raise links.latency_ms"
            )


# ---- Log summary


PARTIAL = "use the rest of it by --partial"
"""Remedy for a refused log that is damaged or incomplete."""
SHOWN_RUNS = 3
"""Number of runs, the last by name, that the error of a folder of runs lists."""


def log_in(path: Path) -> Path:
    """Return the log of a run's folder; raises LogError for a folder of runs and a missing one."""
    if not path.exists() and path.parent.is_dir():
        similar = did_you_mean(path.name, (one.name for one in path.parent.iterdir()))
        raise LogError(f"{path}: cannot read the log: No such file or directory{similar}")
    log = path / LOG_NAME if path.is_dir() else path
    if path.is_dir() and not log.exists():
        runs = sorted(str(run.parent) for run in path.glob(f"*/{LOG_NAME}"))
        if runs:
            count = "1 run" if len(runs) == 1 else f"{len(runs)} runs"
            others = "…, " if len(runs) > SHOWN_RUNS else ""
            names = ", ".join(runs[-SHOWN_RUNS:])
            raise LogError(f"{path}: holds {count}, give one of them: {others}{names}")
    return log


def summary_of(
    log: Path, warn: Callable[[str], None] = lambda _: None, *, running: bool = False
) -> RunSummary:
    """The summary inside `log`; for an incomplete or repaired log, computed from its messages.

    `warn` gets a line about damage and holes, which the summary holds too. The log of a `running`
    run is still being written.
    """
    reader = LogReader(log)
    attachments = reader.attachments()
    if reader.damage and not {SUMMARY_NAME, ATTACHED_AS} & attachments.keys():
        raise LogError(f"{reader.damage}; with it the scenario")
    faults = "" if running else reader.faults
    is_complete = not reader.truncated and REPAIRED not in reader.metadata()
    if SUMMARY_NAME in attachments and is_complete:
        try:
            written = from_json(attachments[SUMMARY_NAME].decode())
        except ValueError as error:
            raise LogError(f"{log} ({SUMMARY_NAME}): {error}") from error
        if faults:
            warn(faults)
        return with_outcome_line(replace(written, log_faults=faults))
    scenario = scenario_in(reader)
    if faults:
        warn(faults)
    thinned = reader.thinned
    if thinned:
        held = ", ".join(thinned)
        warn(f"{log}: holds only part of its {held}; the figures cover only that part")
    breaks_off = "" if running else "the log breaks off"
    summary = summarise(
        _identity_in(reader),
        tables_in(reader, scenario),
        reason="the log is damaged" if reader.damage else breaks_off,
        rejected={},
    )
    holes = summary.holes
    if "truth" in thinned:  # thinned true poses are no holes
        holes = tuple(hole for hole in holes if hole.kind == "pose")
    outcome = "running" if running else summary.outcome
    return with_outcome_line(
        replace(summary, outcome=outcome, outcome_line="", holes=holes, log_faults=faults)
    )


def tables_in(reader: LogReader, scenario: Scenario, ran_ns: int | None = None) -> RunTables:
    """Tables of a log, up to its end or for a run of `ran_ns`."""
    run = RunTables(scenario, reader.columns(TOPICS_OF_METRICS))
    if ran_ns is None:
        start_at = run.start_at
        ran_ns = max(reader.last_at - start_at, 0) if start_at is not None else 0
    return replace(run, ran_ns=min(ran_ns, nanoseconds(scenario.duration_s)), results={})


def tables_of(log: Path) -> RunTables:
    """Tables of a log; raises LogError."""
    reader = LogReader(log)
    return tables_in(reader, scenario_in(reader))


def _identity_in(reader: LogReader) -> RunIdentity:
    try:
        return RunIdentity.of_values(reader.metadata().get(METADATA_NAME, {}))
    except ValueError as error:
        raise LogError(f"{reader.path} (metadata {METADATA_NAME}): {error}") from error


def scenario_of(log: Path) -> Scenario:
    return scenario_in(LogReader(log))


def scenario_in(reader: LogReader) -> Scenario:
    """The scenario inside a log with the lead's path or trace, ready to run again."""
    log, attached = reader.path, reader.attachments().get(ATTACHED_AS)
    if attached is None:
        raise LogError(f"{log}: holds no scenario; was it written by `convoy`?")
    try:
        text = attached.decode()
    except UnicodeDecodeError as error:
        raise LogError(f"{log} ({ATTACHED_AS}): is not text") from error
    try:
        return scenario_from_text(text, label=f"{log} ({ATTACHED_AS})", recorded=True)
    except ScenarioError as error:
        first, *_ = str(error).splitlines()
        raise LogError(f"{first}; this version cannot read the scenario of the log") from error
