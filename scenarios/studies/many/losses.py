"""Losses of a recorded run: the fate of each message in its log, and bursts of each link."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenarios.definition.changes import LINK_CHANGES, links_of
from scenarios.definition.channel.recordings import run_lengths
from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.link_tables import LinkEntry, LinkTable
from scenarios.results.log_summary import tables_in
from scenarios.results.tables import TOPICS_OF_METRICS, RunTables
from scenarios.runs.replayed import session_of
from transport.columns import Columns, Flags
from transport.links.laws.recorded_losses import EarlierRun, Listed, NumberSet
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.topics import counts_as_loss
from vehicles.schedule import SECOND

LinkEnds = tuple[str, str]
"""Sender and receiver."""


@dataclass(frozen=True, slots=True, order=True)
class LostMessage:
    """A lost message with its sending time (ns after the start) and number."""

    sent_at: int
    link: LinkEnds
    number: int


Losses = frozenset[LostMessage]
NO_END = 2**63 - 1


@dataclass(frozen=True, slots=True)
class RecordedRun:
    """A run from its log; `late` counts late messages."""

    log: Path
    tables: RunTables
    late: int

    @property
    def scenario(self) -> Scenario:
        return self.tables.scenario

    def verdicts(self, link: LinkEnds) -> tuple[Columns, Flags]:
        """Verdicts of a link, and which of its messages are lost and can be restored.

        Messages dropped by the link's rate, or corrupted without a frame check, cannot.
        """
        verdicts = self.tables.table(link[1], "verdict")
        verdicts = verdicts.of(verdicts["sender"] == link[0])
        content = self.scenario.links[link].content
        kept = {"corrupted"} if content is not None and not content.frame_check else set()
        dropped = {one for one in verdicts["reason"] if one and counts_as_loss(one)} - kept
        lost = [one in dropped for one in verdicts["reason"]]
        return verdicts, np.array(lost, dtype=bool)

    def lost(self, until: int = NO_END) -> tuple[LostMessage, ...]:
        """Lost messages that would have arrived by an instant (ns after the start), in order."""
        lost, start_at = list[LostMessage](), self.tables.beginning
        for link in self.scenario.links:
            verdicts, is_lost = self.verdicts(link)
            chosen = verdicts.of(is_lost & (verdicts["visible_at_ns"] - start_at <= until))
            sent_at = (chosen["sent_at_ns"] - start_at).tolist()
            numbers = chosen["pose_seq"].tolist()
            lost += [LostMessage(at, link, k) for at, k in zip(sent_at, numbers, strict=True)]
        return tuple(sorted(lost))


def read_run(log: Path) -> RecordedRun:
    """Read poses and their fates from a log.

    Raises LogError if the log is incomplete, has no losses, or has replayed vehicles.
    """
    reader = LogReader(log)
    if reader.damage:
        raise LogError(reader.damage)
    reader.require_all("verdict", "tracking", "truth")
    if any(topic in TOPICS_OF_METRICS for _, topic in reader.missing):
        raise LogError(f"{reader.faults}; blame needs a log without holes")
    if reader.truncated:
        raise LogError(f"{log}: truncated; blame needs the log of a complete run")
    run = tables_in(reader, session_of(log))
    if run.scenario.replays:
        names = ", ".join(run.scenario.replays)
        raise LogError(f"{log}: {names} replayed a recorded drive; blame needs simulated vehicles")
    if run.start_at is None:
        raise LogError(f"{log}: has no start of the run")
    late = sum(int(run.table(name, "verdict")["late"].sum()) for name in run.names)
    recorded = RecordedRun(log, run, late)
    if not recorded.lost():
        raise LogError(f"{log}: no message was lost")
    return recorded


# ---- Bursts and overlaps


@dataclass(frozen=True, slots=True)
class Burst:
    """Consecutive messages that one link lost, in order."""

    messages: tuple[LostMessage, ...]

    @property
    def link(self) -> LinkEnds:
        return self.messages[0].link

    @property
    def numbers(self) -> tuple[int, int]:
        """First and last number."""
        return self.messages[0].number, self.messages[-1].number

    @property
    def span_s(self) -> tuple[float, float]:
        """Sending times of the first and the last message (s after the start)."""
        return self.messages[0].sent_at / SECOND, self.messages[-1].sent_at / SECOND

    @property
    def line(self) -> str:
        (sender, receiver), (first, last) = self.link, self.numbers
        return f"{sender} → {receiver} {first if first == last else f'{first}-{last}'}"


def bursts_of(lost: Iterable[LostMessage]) -> tuple[Burst, ...]:
    """Group lost messages into consecutive numbers of each link, in order of time."""
    by_link: defaultdict[LinkEnds, list[LostMessage]] = defaultdict(list)
    for message in sorted(lost):
        by_link[message.link].append(message)
    return tuple(
        sorted(
            (Burst(run) for messages in by_link.values() for run in _runs(messages)),
            key=lambda burst: burst.messages,
        )
    )


def _runs(messages: Sequence[LostMessage]) -> Iterator[tuple[LostMessage, ...]]:
    run: list[LostMessage] = []
    for message in sorted(messages, key=lambda message: message.number):
        if run and message.number != run[-1].number + 1:
            yield tuple(run)
            run = []
        run.append(message)
    yield tuple(run)


def overlaps_of(bursts: Sequence[Burst]) -> tuple[tuple[Burst, ...], ...]:
    """Group bursts that overlap in time, in order of time.

    A burst lasts from its first to its last message. A chain of overlapping bursts is one group.
    """
    overlaps: list[list[Burst]] = []
    until = -1
    for burst in sorted(bursts, key=lambda burst: burst.messages):
        if not overlaps or burst.messages[0].sent_at > until:
            overlaps.append([])
        overlaps[-1].append(burst)
        until = max(until, burst.messages[-1].sent_at)
    return tuple(map(tuple, overlaps))


def numbers_by_link(lost: Iterable[LostMessage]) -> Mapping[LinkEnds, NumberSet]:
    numbers: defaultdict[LinkEnds, list[int]] = defaultdict(list)
    for message in lost:
        numbers[message.link].append(message.number)
    return {link: NumberSet.of((k, k) for k in own) for link, own in numbers.items()}


# ---- A recorded run as a scenario that loses exactly the messages of a list
#
# Delays, order and content stay the same, because random numbers are keyed by message. For links
# with a queue or with changes during the run, the recorded delays replace the laws of the link.


LOSES = {"loss", "loss_ratio", "collisions", "outages", "radio", "preset", "preset_source"}
"""Keys of a link that cause losses."""
RECORDED_DELAY = {"queue"}
"""Keys to omit for links with recorded delays. The other delay keys stay: vehicles derive from them
what to expect of the link."""


@dataclass(frozen=True)
class LossFreeScenario:
    """A scenario without losses, to which listed losses can be added."""

    scenario: Scenario

    def with_losses(self, lost: Iterable[LostMessage]) -> Scenario:
        numbers = numbers_by_link(lost)
        entries = tuple(
            _with_loss(entry, numbers.get((entry.sender, entry.receiver)))
            for entry in self.scenario.tables.link
        )
        return Scenario(self.scenario.tables.model_copy(update={"link": entries}))

    def smallest(self, lost: Iterable[LostMessage], limit: Limit, description: str) -> Scenario:
        """Return the scenario with these losses and the only limit `limit`."""
        tables = self.with_losses(lost).tables
        changes = {
            "name": f"{tables.name[:20]}_blamed",
            "description": description,
            "limits": limit.table,
        }
        return Scenario(tables.model_copy(update=changes))


def _with_loss(entry: LinkEntry, numbers: NumberSet | None) -> LinkEntry:
    if numbers is None:
        return entry
    if isinstance(entry.loss, EarlierRun):
        dropped = {**entry.loss.dropped_numbers, "pattern": str(numbers)}
        return entry.model_copy(
            update={"loss": entry.loss.model_copy(update={"dropped_numbers": dropped})}
        )
    return entry.model_copy(update={"loss": Listed(kind="listed", lost_numbers=str(numbers))})


def loss_free(run: RecordedRun) -> LossFreeScenario:
    """Return the scenario of a recorded run without its losses."""
    scenario = run.scenario
    changes = [change for change in scenario.tables.change if isinstance(change, LINK_CHANGES)]
    changed = {
        pair
        for change in changes
        for pair in links_of(change, scenario.vehicle_names, scenario.links)
    }
    entries = []
    for pair, table in scenario.links.items():
        recorded = pair in changed or table.queue is not None or isinstance(table.loss, EarlierRun)
        if recorded:
            entries.append(_recorded(run, pair, table))
        else:  # delays are keyed by message number and stay the same
            listed = Listed(kind="listed", lost_numbers="")
            entries.append(_entry(pair, table, also_left_out=set(), loss=listed))
    tables = scenario.tables.model_copy(
        update={
            "overrides": None,
            "links": LinkTable(),
            "link": tuple(entries),
            "change": tuple(
                change for change in scenario.tables.change if not isinstance(change, LINK_CHANGES)
            ),
            "vehicle": {
                name: vehicle.model_copy(update={"transmitter_off": (), "receiver_off": ()})
                for name, vehicle in scenario.tables.vehicle.items()
            },
        }
    )
    return LossFreeScenario(Scenario(tables))


def _recorded(run: RecordedRun, pair: LinkEnds, table: LinkTable) -> LinkEntry:
    """Build the entry of a link with recorded delays.

    Messages still in transit at the end of the run become visible one second later.
    """
    verdicts, is_lost = run.verdicts(pair)
    ends_at = round(run.scenario.duration_s * SECOND)
    numbers = verdicts["pose_seq"].tolist()
    spans = (verdicts["visible_at_ns"] - verdicts["sent_at_ns"]).tolist()
    known = dict(zip(numbers, spans, strict=True))
    poses = run.tables.table(pair[0], "gps")
    sent_at = (poses.at_ns - run.tables.beginning).tolist()
    sent = dict(zip(poses["seq"].tolist(), sent_at, strict=True))
    delays = [
        known.get(number, max(ends_at + SECOND - sent.get(number, ends_at), 0))
        for number in range(max([*known, *sent, 0]) + 1)
    ]
    dropped = verdicts["pose_seq"][(verdicts["reason"] != "") & ~is_lost].tolist()
    by_rate = NumberSet.of((k, k) for k in dropped)
    loss = EarlierRun(
        kind="log",
        source=run.log.name,
        after_end="pass",
        delays_ns=run_lengths(delays),
        dropped_numbers={"rate": str(by_rate)} if by_rate.ranges else {},
    )
    return _entry(pair, table, also_left_out=RECORDED_DELAY, loss=loss)


def _entry(
    pair: LinkEnds, table: LinkTable, *, also_left_out: set[str], loss: Listed | EarlierRun
) -> LinkEntry:
    kept: Mapping[str, object] = {
        key: value
        for key, value in table
        if key not in LOSES | also_left_out and value != LinkTable.model_fields[key].default
    }
    content = table.content
    if content is not None:
        # A detected bit error is a loss.
        ratio = {"bit_error_ratio": 0.0} if content.frame_check else {}
        kept = {**kept, "content": content.model_copy(update=ratio)}
    return LinkEntry(sender=pair[0], receiver=pair[1], loss=loss, **kept)  # type: ignore[arg-type]
