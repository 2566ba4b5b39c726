"""What a log holds: duration, topics with rates and gaps, bytes, damage, identity."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenarios.definition.changes import LINK_CHANGES, change_from_json, links_of
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.definition.schema.change_tables import AnyChange, VehicleChangeTable
from scenarios.definition.schema.limit_tables import DEADLINES
from scenarios.definition.schema.scenario_tables import ReplayTable
from scenarios.results.log_summary import METADATA_NAME, PARTIAL, scenario_in
from scenarios.results.summary import MadeChange, made_changes
from scenarios.results.tables import RunTables
from transport.log.errors import LogError, UnwritableError
from transport.log.mcap_file import write_again
from transport.log.reader import LogReader
from transport.topics import RUN_SENDER
from vehicles.schedule import SECOND

# ---- `convoy recover`: the readable messages of a truncated or damaged log as a new log


def recover_log(log: Path, output: Path) -> int:
    """Write every readable message of a truncated or damaged log; returns their number."""
    if output.exists():
        raise LogError(f"{output}: exists; a log is never overwritten")
    reader = LogReader(log)  # refuse other files
    try:
        write_again(reader.file, output)
    except OSError as error:
        raise UnwritableError(f"{output}: cannot write the log: {error.strerror}") from error
    return sum(reader.counts.values())


# ---- Log info


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelInfo:
    """Messages of a channel; `rate_hz` and `gap_s_max` are by the instants of recording.

    `missing` counts the numbers that the log lacks, None for standard messages.
    """

    channel: str
    messages: int
    rate_hz: float | None
    gap_s_max: float | None
    bytes: int
    missing: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LogInfo:
    """A log as a file; `first_at_ns` and `last_at_ns` are the instants of recording."""

    log: str
    bytes: int
    first_at_ns: int
    last_at_ns: int
    duration_s: float
    messages: int
    vehicles: tuple[str, ...]
    is_complete: bool
    faults: str
    thinned: Mapping[str, str]
    identity: Mapping[str, str]
    attachments: Mapping[str, int]
    channels: tuple[ChannelInfo, ...]


def info_of(log: Path) -> LogInfo:
    """Describe a log; raises LogError."""
    reader = LogReader(log)
    channels = tuple(_channels(reader))
    return LogInfo(
        log=str(log),
        bytes=log.stat().st_size,
        first_at_ns=reader.first_at,
        last_at_ns=reader.last_at,
        duration_s=(reader.last_at - reader.first_at) / SECOND,
        messages=sum(channel.messages for channel in channels),
        vehicles=tuple(name for name in reader.vehicles if name != RUN_SENDER),
        is_complete=not reader.faults,
        faults=reader.faults,
        thinned=reader.thinned,
        identity=reader.metadata().get(METADATA_NAME, {}),
        attachments={name: len(data) for name, data in reader.attachments().items()},
        channels=channels,
    )


def _channels(reader: LogReader) -> list[ChannelInfo]:
    messages = reader.file.without_content
    rows = []
    for number, channel in sorted(reader.file.channels.items(), key=lambda row: row[1].topic):
        chosen = messages.of(messages.channels == number)
        steps = np.diff(chosen.logged_at)
        span_s = float(steps.sum()) / SECOND
        _, _, *key = channel.topic.split("/")
        known = tuple(key) in reader.counts
        missing = reader.missing.get((key[0], key[-1]), (0, 0))[0] if known else None
        rows.append(
            ChannelInfo(
                channel=channel.topic,
                messages=len(chosen.order),
                rate_hz=len(steps) / span_s if span_s else None,
                gap_s_max=float(steps.max()) / SECOND if len(steps) else None,
                bytes=int((chosen.ends - chosen.starts).sum()),
                missing=missing,
            )
        )
    return rows


# ---- The scenario that repeats a recorded run, including the changes made by hand


USED = ("start", "change")
"""Topics that repeat a run."""


def session_of(
    log: Path, warn: Callable[[str], None] = lambda _: None, *, partial: bool = False
) -> Scenario:
    """The scenario in `log` with the changes made by hand; raises LogError.

    Equal changes of several receivers at one instant are one change. A log from which changes may
    be missing, because it is damaged or incomplete, is refused unless `partial`; `warn`
    gets a line about it.
    """
    reader = LogReader(log)
    if not partial:
        reader.refuse_faults(*USED, remedy=PARTIAL)
    if faults := reader.faults_in(USED) or reader.faults:
        warn(faults)
    scenario = scenario_in(reader)
    run = RunTables(scenario, reader.columns(USED))
    made = [change for change in made_changes(run) if change.by_hand]
    if made and run.start_at is None:
        raise LogError(f"{log}: a change before the start of the run")
    added = [one for change in made for one in _as_carried_out(change, run, scenario)]
    update = {"change": (*scenario.tables.change, *added)} if added else {}
    changed = scenario.tables.model_copy(update=update)
    # Parsed again, which checks it.
    return scenario_from_text(Scenario(changed).text, label=f"{log} (with its changes)")


def replayed_session(
    log: Path,
    vehicles: Sequence[str],
    overrides: Sequence[str] = (),
    seed: int | None = None,
    *,
    warn: Callable[[str], None] = lambda _: None,
    partial: bool = False,
) -> Scenario:
    """The session of `log` in which `vehicles` send their recorded messages again.

    Their changes and limits are left out: the messages contain the changes, and replayed vehicles
    decide nothing. Raises LogError, or ScenarioError for an invalid vehicle or override.
    """
    tables = session_of(log, warn, partial=partial).tables
    replay = ReplayTable.model_construct(  # checked below, as the other tables
        log=str(log.resolve()), vehicles=tuple(vehicles), partial=partial
    )
    update: dict[str, object] = {"replay": replay}
    if tables.change:
        update["change"] = tuple(
            change
            for change in tables.change
            if not isinstance(change, VehicleChangeTable) or change.vehicle not in vehicles
        )
    limits = {
        name: tuple(one for one in given if one.vehicle not in vehicles)
        for name in DEADLINES
        if (given := getattr(tables.limits, name))
    }
    if limits:
        update["limits"] = tables.limits.model_copy(update=limits)
    text = Scenario(tables.model_copy(update=update)).text
    return scenario_from_text(text, label=str(log), overrides=overrides, seed=seed)


def _as_carried_out(made: MadeChange, run: RunTables, scenario: Scenario) -> Sequence[AnyChange]:
    """One change, or one per receiver if not all of them carried it out."""
    change = change_from_json(made.table)
    exact = change.model_copy(update={"at_s": run.seconds(made.at_ns)})
    if not isinstance(change, LINK_CHANGES):
        return [exact]
    about = {to for _, to in links_of(change, scenario.vehicle_names, scenario.links)}
    if about == set(made.vehicles):
        return [exact]
    return [exact.model_copy(update={"receiver": receiver}) for receiver in made.vehicles]
