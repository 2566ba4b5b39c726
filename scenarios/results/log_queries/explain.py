"""Knowledge of a vehicle at an instant of a recorded run, and why messages were missing."""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import hypot, isfinite
from pathlib import Path

from scenarios.definition.channel.origins import origin
from scenarios.definition.scenario import Scenario
from scenarios.definition.topology import senders_to
from scenarios.results.channel.account import FATE_WORDS, Fate, MissingVerdict
from scenarios.results.log_summary import scenario_in
from scenarios.results.metrics import Metrics
from transport.log.reader import LogReader
from transport.log.records import LogError
from transport.reasons import counts_as_loss
from vehicles.geometry.geodesy import LocalPlane
from vehicles.messages import GpsPose, LinkVerdict, RunStart, Tracking, TruePose
from vehicles.schedule import SECOND

IN_TRANSIT, NOT_ARRIVED, NOT_RECORDED = "in transit", "not arrived", "not recorded"
"""Fates of messages without a drop: not due yet, without a verdict, or with one that the log
lacks."""
FATES: Mapping[Fate, str] = {"in_flight": IN_TRANSIT, "unrecorded": NOT_RECORDED}
"""Fates of the account of a link; the others are causes why a message did not arrive."""
MOST_OFF_PATH_M = 20.0
"""Largest distance of a vehicle from the path that it follows."""
SHOWN = 8
"""Missing messages listed individually."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingMessage:
    """A message sent after the newest received one of its sender, and why it is missing.

    `fate` is a drop reason, IN_TRANSIT, NOT_ARRIVED or NOT_RECORDED.
    """

    number: int
    sent_at_s: float
    fate: str
    cause: str
    due_at_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownSource:
    """What a vehicle knew of one sender; None before its first message.

    Instants are from the start. `path_left_m` is the distance from the vehicle's true position
    along the received positions of the sender to the newest of them, 0 if that lies behind.
    `received_ratio` is the delivered share of the messages due within the last second.
    """

    sender: str
    number: int | None
    measured_at_s: float | None
    received_at_s: float | None
    age_s: float | None
    path_left_m: float | None
    received_ratio: float | None
    missing: tuple[MissingMessage, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """What `vehicle` knew at its last decision until the requested instant.

    `log_faults` describes damage and holes of the log in one line.
    """

    vehicle: str
    decided_at_s: float
    mode: str
    reason: str
    sources: tuple[KnownSource, ...]
    log_faults: str = ""

    @property
    def sentence(self) -> str:
        """What the vehicle did, the known path per source, and the later messages per source."""
        sources = f"the path of {joined_words([source.sender for source in self._used])}"
        action = {
            "path": "drove its own path",
            "straight": "drove straight, as it had received nothing",
            "coast": "extrapolated its last trajectory",
            "creep": f"crossed a hole in {sources}",
            "stop": f"braked for lack of data, along {sources}",
        }.get(self.mode, f"followed {sources}")
        if self.mode == "composite" and len(self.sources) > 1:
            action = f"followed {sources.replace('path', 'composite trajectory', 1)}"
        parts = [f"At {self.decided_at_s:.2f} s {self.vehicle} {action}."]
        if self.sources:
            parts.append(f"Known path ahead: {', '.join(map(_known_path, self.sources))}.")
        parts += [
            f"Later messages of {source.sender}: {counts_of(source.missing)}."
            for source in self.sources
            if source.missing
        ]
        return " ".join(parts)

    @property
    def _used(self) -> Sequence[KnownSource]:
        lead, predecessor = self.sources[:1], self.sources[-1:]
        return {"lead": lead, "predecessor": predecessor}.get(self.mode, self.sources)


def _known_path(source: KnownSource) -> str:
    if source.age_s is None:
        return f"{source.sender} none (nothing received)"
    return f"{source.sender} {source.path_left_m or 0.0:.1f} m (pose {source.age_s:.2f} s old)"


def fate_of(message: MissingMessage) -> str:
    """Fate of a message in words, without the cause."""
    if message.fate in {IN_TRANSIT, NOT_ARRIVED, NOT_RECORDED}:
        return message.fate
    return "lost" if counts_as_loss(message.fate) else "skipped"


def cause_of(message: MissingMessage) -> str:
    """Text of the cause if a message was dropped or did not arrive, else empty."""
    return "link cut" if message.cause == "cut" else message.cause


def counts_of(messages: Sequence[MissingMessage]) -> str:
    """Count messages by fate; dropped ones with their causes."""
    causes: dict[str, dict[str, None]] = {}
    for message in messages:
        causes.setdefault(fate_of(message), {})[cause_of(message)] = None
    counts = Counter(map(fate_of, messages))
    parts = []
    for fate, count in counts.items():
        reasons = joined_words([cause for cause in causes[fate] if cause])
        parts.append(f"{count} {fate}{f' ({reasons})' if reasons else ''}")
    return ", ".join(parts)


def joined_words(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


@dataclass(slots=True)
class RecordedKnowledge:
    """Messages in a log about a vehicle and its senders; instants in ns."""

    log: Path
    scenario: Scenario
    vehicle: str
    last_at: int
    faults: str = ""
    start_at: int = 0
    decisions: list[Tracking] = field(default_factory=list)
    places: dict[int, tuple[float, float]] = field(default_factory=dict)
    poses: dict[str, dict[int, GpsPose]] = field(default_factory=dict)
    verdicts: dict[str, dict[int, LinkVerdict]] = field(default_factory=dict)
    without: dict[str, dict[int, MissingVerdict]] = field(default_factory=dict)

    @classmethod
    def of(cls, log: Path, vehicle: str) -> "RecordedKnowledge":
        """Read a log; raises LogError for a vehicle that is not in it."""
        reader = LogReader(log)
        scenario = scenario_in(reader)
        names = scenario.vehicle_names
        if vehicle not in names:
            raise LogError(f"{log}: no vehicle {vehicle!r}, allowed {', '.join(names)}")
        record = cls(log, scenario, vehicle, reader.last_at, reader.faults)
        _read(
            reader,
            record,
            senders_to(names, vehicle, lead_receives=scenario.tables.speed.lead_receives),
        )
        return record

    def at(self, at_s: float) -> Explanation:
        """Explain the instant `at_s` (s) after the start; raises LogError."""
        requested = self.start_at + round(at_s * SECOND) if isfinite(at_s) else -1
        made = bisect_right(self.decisions, requested, key=lambda decision: decision.decided_at_ns)
        if not made or requested > self.last_at:
            first, last = self.decisions[0], self.decisions[-1]
            raise LogError(
                f"{self.log}: {self.vehicle} has no decision at {at_s:g} s, allowed "
                f"{_seconds(self, first.decided_at_ns):g} to {_seconds(self, last.decided_at_ns):g}"
            )
        decision = self.decisions[made - 1]
        return Explanation(
            vehicle=self.vehicle,
            decided_at_s=_seconds(self, decision.decided_at_ns),
            mode=decision.mode,
            reason=decision.reason,
            log_faults=self.faults,
            sources=tuple(
                _known(self, (sender, self.vehicle), decision.decided_at_ns)
                for sender in self.poses
            ),
        )


def explain(log: Path, vehicle: str, at_s: float) -> Explanation:
    """List what `vehicle` knew `at_s` (s) after the start of the run in `log`.

    Raises LogError for an unknown vehicle or an instant outside of the run.
    """
    return RecordedKnowledge.of(log, vehicle).at(at_s)


def _read(reader: LogReader, record: RecordedKnowledge, senders: Sequence[str]) -> None:
    vehicle = record.vehicle
    for sender in senders:
        record.poses[sender], record.verdicts[sender] = {}, {}
    reader.require_all("verdict", "tracking", "truth")
    metrics = Metrics.of(record.scenario)
    topics = ("gps", "verdict", "tracking", "truth", "start", "health")
    for at, source, message in reader.messages(topics):
        metrics.listen(at, message)
        match message:
            case RunStart():
                record.start_at = message.start_at_ns
            case GpsPose() if source in record.poses:
                record.poses[source][message.seq] = message
            case LinkVerdict() if source == vehicle and message.sender in record.verdicts:
                record.verdicts[message.sender][message.pose_seq] = message
            case Tracking() if source == vehicle:
                record.decisions.append(message)
            case TruePose() if source == vehicle:
                record.places[message.true_at_ns] = message.east_m, message.north_m
    if not record.decisions:
        raise LogError(f"{reader.path}: no decisions of {vehicle}")
    accounts = metrics.accounts(reader.last_at - record.start_at)
    for sender in senders:
        missing = accounts[sender, vehicle].missing if (sender, vehicle) in accounts else ()
        record.without[sender] = {message.number: message for message in missing}


def _known(record: RecordedKnowledge, link: tuple[str, str], now: int) -> KnownSource:
    poses, verdicts = record.poses[link[0]], record.verdicts[link[0]]
    received = [
        verdict
        for verdict in verdicts.values()
        if verdict.outcome == "delivered" and verdict.received_at_ns <= now
    ]
    newest = max(received, key=lambda verdict: verdict.measured_at_ns, default=None)
    sent_by_now = sorted(seq for seq, pose in poses.items() if pose.sent_at_ns <= now)
    since = newest.pose_seq if newest else -1
    missing = [_missing(record, link, seq) for seq in sent_by_now if seq > since]
    return KnownSource(
        sender=link[0],
        number=newest.pose_seq if newest else None,
        measured_at_s=_seconds(record, newest.measured_at_ns) if newest else None,
        received_at_s=_seconds(record, newest.received_at_ns) if newest else None,
        age_s=_age(record, link[1], newest, now) if newest else None,
        path_left_m=_path_left(record, link[0], received, now),
        received_ratio=_received(verdicts.values(), record.without[link[0]].values(), now),
        missing=tuple(missing),
    )


def _seconds(record: RecordedKnowledge, at: int) -> float:
    return (at - record.start_at) / SECOND


def _age(record: RecordedKnowledge, vehicle: str, newest: LinkVerdict, now: int) -> float:
    """Age (s) of a message by the clock of the vehicle that received it."""
    clock = record.scenario.clock(vehicle, record.start_at)
    return (clock.reading(now) - newest.measured_at_ns) / SECOND


def _missing(record: RecordedKnowledge, link: tuple[str, str], number: int) -> MissingMessage:
    sent_at_s = _seconds(record, record.poses[link[0]][number].sent_at_ns)
    verdict = record.verdicts[link[0]].get(number)
    if verdict is None:
        message = record.without[link[0]].get(number)
        fate = FATES.get(message.fate, NOT_ARRIVED) if message else NOT_ARRIVED
        cause = FATE_WORDS[message.fate] if message and fate == NOT_ARRIVED else ""
        return MissingMessage(number=number, sent_at_s=sent_at_s, fate=fate, cause=cause)
    dropped = verdict.outcome == "dropped"
    return MissingMessage(
        number=number,
        sent_at_s=sent_at_s,
        fate=verdict.reason if dropped else IN_TRANSIT,
        cause=origin(record.scenario.tables, link, verdict.reason) if dropped else "",
        due_at_s=_seconds(record, verdict.received_at_ns),
    )


def _received(
    verdicts: Iterable[LinkVerdict], without: Iterable[MissingVerdict], now: int
) -> float | None:
    """Delivered share of the messages due within the last second, None without any.

    Messages that the transport lost are due when they were sent.
    """
    due = [verdict for verdict in verdicts if now - SECOND < verdict.received_at_ns <= now]
    absent = [lost for lost in without if lost.is_lost and now - SECOND < lost.sent_at <= now]
    delivered = sum(message.outcome == "delivered" for message in due)
    return delivered / (len(due) + len(absent)) if due or absent else None


def _path_left(
    record: RecordedKnowledge, sender: str, received: Sequence[LinkVerdict], now: int
) -> float | None:
    """Distance (m) along the received positions of `sender` that lies ahead of the vehicle."""
    here = record.places.get(now)
    if here is None or not received:
        return None
    plane = LocalPlane(record.scenario.origin)
    sent, numbers = record.poses[sender], {verdict.pose_seq for verdict in received}
    known = [pose for number, pose in sent.items() if number in numbers]
    poses = sorted(known, key=lambda pose: pose.measured_at_ns)
    places = [
        plane.to_plane(pose.latitude_deg, pose.longitude_deg, pose.altitude_m) for pose in poses
    ]
    return remaining_path_length(places, here)


def remaining_path_length(
    places: Sequence[tuple[float, float]], here: tuple[float, float]
) -> float:
    """Length (m) of a polyline of `places` from the foot of `here` on it to its end.

    The foot is the nearest point of the last stretch that passes by: from the end backwards, the
    first at which the distance grows again within MOST_OFF_PATH_M.
    """
    if not places:
        return 0.0
    best, best_length, length_so_far = _distance(places[-1], here), 0.0, 0.0
    for after, before in zip(reversed(places), reversed(places[:-1]), strict=False):
        length = _distance(before, after)
        share = _foot(after, before, here) if length else 0.0
        foot = tuple(a + share * (b - a) for a, b in zip(after, before, strict=True))
        distance = hypot(foot[0] - here[0], foot[1] - here[1])
        if distance <= best:
            best, best_length = distance, length_so_far + share * length
        elif best < MOST_OFF_PATH_M and distance > best + MOST_OFF_PATH_M:
            break
        length_so_far += length
    return best_length


def _distance(start: tuple[float, float], other: tuple[float, float]) -> float:
    return hypot(start[0] - other[0], start[1] - other[1])


def _foot(start: tuple[float, float], end: tuple[float, float], here: tuple[float, float]) -> float:
    """Share of the segment from `start` to `end` at its point nearest to `here`."""
    east, north = end[0] - start[0], end[1] - start[1]
    along = (here[0] - start[0]) * east + (here[1] - start[1]) * north
    return min(1.0, max(0.0, along / (east * east + north * north)))
