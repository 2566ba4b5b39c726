"""The losses of a recorded run: bursts of each link, and the fates of all messages in its log."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from scenarios.definition.scenario import Scenario
from scenarios.results.log_queries.session import session_of
from transport.links.laws.loss.number_sets import NumberSet
from transport.log.reader import LogReader
from transport.log.records import LogError
from transport.reasons import counts_as_loss
from vehicles.messages import GpsPose, LinkVerdict, Message, RunStart, Tracking, TruePose
from vehicles.schedule import SECOND

LinkEnds = tuple[str, str]
"""Sender and receiver."""


@dataclass(frozen=True, slots=True, order=True)
class LostMessage:
    """A message that a link lost, by its sending time (ns after the start) and number."""

    sent_at: int
    link: LinkEnds
    number: int


Losses = frozenset[LostMessage]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fate:
    """The fate of a message: its sending time and delay (ns).

    `reason` is that of a drop, empty without one. A dropped message has the delay that it would
    have had. `is_lost`: it can be restored. The link's own rate and content errors without a frame
    check cannot.
    """

    sent_at: int
    delay: int
    reason: str
    is_lost: bool


@dataclass(slots=True)
class RecordedRun:
    """A run from its log, with instants in ns after its start.

    `fates` are the verdicts of each link by the message's number, `sent` the sending times of each
    sender by number. `truth` are the true poses (east, north, m) by vehicle and instant; `messages`
    are those that its figures are made of, in the order of the log.
    """

    log: Path
    scenario: Scenario
    start_at: int = 0
    late: int = 0
    fates: dict[LinkEnds, dict[int, Fate]] = field(default_factory=lambda: defaultdict(dict))
    sent: dict[str, dict[int, int]] = field(default_factory=lambda: defaultdict(dict))
    truth: dict[tuple[str, int], tuple[float, float]] = field(default_factory=dict)
    messages: list[Message] = field(default_factory=list)

    def lost(self, until: int) -> tuple[LostMessage, ...]:
        """Return lost messages that would have arrived by an instant, in order of time."""
        return tuple(
            sorted(
                LostMessage(fate.sent_at, link, number)
                for link, fates in self.fates.items()
                for number, fate in fates.items()
                if fate.is_lost and fate.sent_at + fate.delay <= until
            )
        )

    def _can_be_restored(self, link: LinkEnds, reason: str) -> bool:
        content = self.scenario.links[link].content
        if reason == "corrupted" and content is not None and not content.frame_check:
            return False
        return bool(reason) and counts_as_loss(reason)

    def take(self, message: Message) -> None:
        match message:
            case RunStart():
                self.start_at = message.start_at_ns
            case LinkVerdict():
                link = message.sender, message.vehicle
                self.late += message.late
                self.fates[link][message.pose_seq] = Fate(
                    sent_at=message.sent_at_ns - self.start_at,
                    delay=message.visible_at_ns - message.sent_at_ns,
                    reason=message.reason,
                    is_lost=self._can_be_restored(link, message.reason),
                )
            case GpsPose():
                self.sent[message.vehicle][message.seq] = message.sent_at_ns - self.start_at
            case TruePose():
                at = message.true_at_ns - self.start_at
                self.truth[message.vehicle, at] = message.east_m, message.north_m
                self.messages.append(message)
            case Tracking():
                self.messages.append(message)


def read_run(log: Path) -> RecordedRun:
    """Read poses and their fates from a log; raises LogError if it is incomplete.

    Also if there are no losses, or vehicles that move as they were recorded.
    """
    reader = LogReader(log)
    if reader.damage:
        raise LogError(reader.damage)
    reader.require_all("verdict", "tracking", "truth")
    if reader.truncated:
        raise LogError(f"{log}: breaks off; blame needs the log of a run that was ended")
    run = RecordedRun(log, session_of(log))
    if run.scenario.replays:
        names = ", ".join(run.scenario.replays)
        raise LogError(f"{log}: {names} moved as recorded; blame needs vehicles that drive")
    for _, _, message in reader.messages(("start", "gps", "verdict", "truth", "tracking")):
        run.take(message)
    if not run.start_at:
        raise LogError(f"{log}: does not say when the run started")
    if not any(fate.is_lost for fates in run.fates.values() for fate in fates.values()):
        raise LogError(f"{log}: no message was lost; there is nothing to blame")
    return run


# ---- Bursts, and those that act together


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
        """When the first and the last message were sent (s after the start)."""
        return self.messages[0].sent_at / SECOND, self.messages[-1].sent_at / SECOND

    @property
    def line(self) -> str:
        (sender, receiver), (first, last) = self.link, self.numbers
        return f"{sender} → {receiver} {first if first == last else f'{first}-{last}'}"


def bursts_of(lost: Iterable[LostMessage]) -> tuple[Burst, ...]:
    """Group lost messages into runs of consecutive numbers on each link, in order of time."""
    by_link: defaultdict[LinkEnds, list[LostMessage]] = defaultdict(list)
    for one in sorted(lost):
        by_link[one.link].append(one)
    return tuple(
        sorted(
            (Burst(run) for messages in by_link.values() for run in _runs(messages)),
            key=lambda burst: burst.messages,
        )
    )


def _runs(messages: Sequence[LostMessage]) -> Iterator[tuple[LostMessage, ...]]:
    run: list[LostMessage] = []
    for one in sorted(messages, key=lambda one: one.number):
        if run and one.number != run[-1].number + 1:
            yield tuple(run)
            run = []
        run.append(one)
    yield tuple(run)


def overlaps_of(bursts: Sequence[Burst]) -> tuple[tuple[Burst, ...], ...]:
    """Group bursts of several links that overlap in time; in order of time.

    A burst lasts from its first to its last message; chains of overlaps are one moment.
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
    found: defaultdict[LinkEnds, list[int]] = defaultdict(list)
    for one in lost:
        found[one.link].append(one.number)
    return {link: NumberSet.of((k, k) for k in numbers) for link, numbers in found.items()}
