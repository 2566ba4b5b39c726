"""Knowledge of a vehicle at an instant of a recorded run, and why messages were missing."""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import hypot, isfinite, nan
from pathlib import Path
from typing import Any, NamedTuple, cast

from scenarios.definition.channel.build import origin
from scenarios.results.link_account import FATE_WORDS, Fate, MissingVerdict, accounts
from scenarios.results.log_summary import scenario_in, tables_in
from scenarios.results.reaction import NOT_RELIED_ON
from transport.columns import Columns
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.topics import counts_as_loss
from vehicles.driver.controller import RELIED_ON
from vehicles.geometry.geodesy import LocalPlane
from vehicles.messages import OVERRIDES, Override, statuses_in
from vehicles.schedule import SECOND

IN_TRANSIT, NOT_ARRIVED, NOT_RECORDED = "in transit", "not arrived", "not recorded"
"""Fates of messages without a drop: not due yet, without a verdict, or with one that the log
lacks."""
FATES: Mapping[Fate, str] = {"in_flight": IN_TRANSIT, "unrecorded": NOT_RECORDED}
"""Fates of the account of a link; the others are causes why a message did not arrive."""
MOST_OFF_PATH_M = 20.0
"""Largest distance of a vehicle from the path that it follows."""
FOREVER = 2**63
"""After every instant (ns)."""
LEAST_MPS2 = 0.05
"""Least acceleration that is stated."""
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
    `received_ratio` is the delivered share of the messages due within the last second. `use` is the
    direction of control that uses the sender: lateral, longitudinal, or both.
    """

    sender: str
    use: str
    number: int | None
    measured_at_s: float | None
    received_at_s: float | None
    age_s: float | None
    path_left_m: float | None
    received_ratio: float | None
    missing: tuple[MissingMessage, ...]
    status: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """What `vehicle` knew at its last decision until the requested instant.

    `steered_along` are the senders along whose path it steers in its mode.
    `acceleration_mps2` is commanded, `law_acceleration_mps2` that of the longitudinal law, and
    `override` why they differ; None where the log lacks the command. `log_faults` describes damage
    and holes of the log in one line.
    """

    vehicle: str
    decided_at_s: float
    mode: str
    reason: str
    acceleration_mps2: float | None = None
    law_acceleration_mps2: float | None = None
    override: str = ""
    sources: tuple[KnownSource, ...]
    steered_along: tuple[str, ...] = ()
    log_faults: str = ""

    @property
    def sentence(self) -> str:
        """What the vehicle did, the known path per source, and the later messages per source."""
        sources = f"the path of {joined_words(self.steered_along)}"
        action = {
            "path": "drove its own path",
            "straight": "drove straight, as it had received nothing",
            "coast": "extrapolated its last trajectory",
            "stop": f"braked to a stop along {sources}",
        }.get(self.mode, f"followed {sources}")
        if self.mode == "composite" and len(self.steered_along) > 1:
            action = f"followed {sources.replace('path', 'composite trajectory', 1)}"
        parts = [f"At {self.decided_at_s:.2f} s {self.vehicle} {action}.", *self._speed_control()]
        ahead = [source for source in self.sources if source.use != "longitudinal"]
        unused = [_not_relied_on(source) for source in ahead if source.status in NOT_RELIED_ON]
        if unused:
            parts.append(f"Not relied on: {', '.join(unused)}.")
        if ahead:
            parts.append(f"Known path ahead: {', '.join(map(_known_path, ahead))}.")
        parts += [
            f"Later messages of {source.sender}: {counts_of(source.missing)}."
            for source in self.sources
            if source.missing
        ]
        return " ".join(parts)

    def _speed_control(self) -> Iterator[str]:
        """State the commanded acceleration and, if it is not that of the law, why."""
        commanded, law = self.acceleration_mps2, self.law_acceleration_mps2
        if commanded is None or law is None or (abs(commanded) < LEAST_MPS2 and not self.override):
            return
        verb = "braked" if commanded < 0.0 else "accelerated"
        text = f"It {verb} at {abs(commanded):.1f} m/s²"
        if not self.override:
            yield f"{text}, as its longitudinal law requested."
            return
        words = OVERRIDES.get(cast("Override", self.override), "")
        evidence = f" ({self.reason})" if self.reason else ""
        yield (
            f"{text} where its longitudinal law requested {law:+.1f} m/s²; overridden by "
            f"{self.override!r}: {words}{evidence}."
        )


def _not_relied_on(source: KnownSource) -> str:
    status = "on probation after a loss" if source.status == "probation" else source.status
    return f"{source.sender} ({status})"


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


class SentPose(NamedTuple):
    """A recorded pose; instants in ns."""

    number: int
    measured_at: int
    sent_at: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float


class RecordedVerdict(NamedTuple):
    """A recorded verdict on a message; instants in ns."""

    number: int
    measured_at: int
    sent_at: int
    received_at: int
    outcome: str
    reason: str


FIELDS = {
    "tracking": (
        *("decided_at_ns", "mode", "reason", "lead_status", "predecessor_status"),
        "other_sources",
    ),
    "truth": ("true_at_ns", "east_m", "north_m"),
    "command": ("decided_at_ns", "acceleration_mps2", "law_acceleration_mps2", "override"),
    "gps": ("seq", "measured_at_ns", "sent_at_ns", "latitude_deg", "longitude_deg", "altitude_m"),
    "verdict": (
        *("pose_seq", "measured_at_ns", "sent_at_ns", "received_at_ns", "outcome", "reason"),
        "sender",
    ),
}
"""Fields that are read, by topic, in the order of the tuples above."""


class _Messages:
    """Messages of a vehicle and its senders; poses and verdicts are by sender and number."""

    def __init__(
        self, columns: Mapping[tuple[str, str], Columns], vehicle: str, senders: Sequence[str]
    ) -> None:
        self.decisions = _rows(columns.get((vehicle, "tracking")))
        places = _rows(columns.get((vehicle, "truth")))
        self.places = {at: (east, north) for at, east, north in places}
        self.commands = {at: rest for at, *rest in _rows(columns.get((vehicle, "command")))}
        self.poses = {
            sender: {row[0]: SentPose(*row) for row in _rows(columns.get((sender, "gps")))}
            for sender in senders
        }
        self.verdicts: dict[str, dict[int, RecordedVerdict]] = {sender: {} for sender in senders}
        for number, *rest, sender in _rows(columns.get((vehicle, "verdict"))):
            if sender in self.verdicts:
                self.verdicts[sender][number] = RecordedVerdict(number, *rest)

    def decision(self, requested: int) -> tuple[int, str, str, Sequence[str]] | None:
        """Instant, mode, reason and statuses of the last decision until an instant."""
        made = bisect_right(self.decisions, requested, key=lambda decision: decision[0])
        if not made:
            return None
        at, mode, reason, *statuses = self.decisions[made - 1]
        return at, mode, reason, statuses


def _rows(columns: Columns | None) -> list[Any]:
    """Messages as tuples of FIELDS."""
    if columns is None:
        return []
    fields = [columns[name].tolist() for name in FIELDS[columns.topic]]
    return list(zip(*fields, strict=True))


class RecordedKnowledge:
    """Explains what a vehicle knew at instants of a log."""

    def __init__(self, log: Path, vehicle: str) -> None:
        """Open a log; raises LogError for a vehicle that is not in it."""
        self._reader = reader = LogReader(log)
        self.scenario = scenario_in(reader)
        names = self.scenario.vehicle_names
        if vehicle not in names:
            raise LogError(f"{log}: no vehicle {vehicle!r}, allowed {', '.join(names)}")
        reader.require_all("verdict", "tracking", "truth")
        self.log, self.vehicle = log, vehicle
        self.setup = self.scenario.vehicle(vehicle)
        self.senders = self.setup.senders
        starts = [rows for rows in reader.columns(["start"]).values() if len(rows)]
        self.start_at = int(starts[-1].at_ns[-1]) if starts else 0

    @cached_property
    def _messages(self) -> _Messages:
        names = [self.vehicle, *self.senders]
        columns = self._reader.columns(FIELDS, fields=FIELDS, vehicles=names)
        return _Messages(columns, self.vehicle, self.senders)

    def at(self, at_s: float) -> Explanation:
        """Explain the instant `at_s` (s) after the start; raises LogError."""
        requested = self.start_at + round(at_s * SECOND) if isfinite(at_s) else -FOREVER
        decision = self._messages.decision(requested)
        if decision is None or requested > self._reader.last_at:
            raise self._error(requested)
        now, mode, reason, recorded = decision
        statuses = self._statuses(recorded)
        commanded, law, override = self._messages.commands.get(now, (None, None, ""))
        return Explanation(
            vehicle=self.vehicle,
            decided_at_s=self._seconds(now),
            mode=mode,
            reason=reason,
            acceleration_mps2=commanded,
            law_acceleration_mps2=law if law is not None and isfinite(law) else None,
            override=override,
            steered_along=self._steered_along(mode, statuses),
            log_faults=self._reader.faults,
            sources=tuple(
                self._known(sender, now, statuses.get(sender, "")) for sender in self.senders
            ),
        )

    def _statuses(self, recorded: Sequence[str]) -> Mapping[str, str]:
        """Statuses of the sources, from the `recorded` ones of lead, predecessor and all others."""
        ends = self.setup.predecessor or "", self.setup.lead
        return dict(zip(ends, reversed(recorded[:2]), strict=True)) | statuses_in(recorded[2])

    def _steered_along(self, mode: str, statuses: Mapping[str, str]) -> tuple[str, ...]:
        """Lateral sources along whose path the vehicle steers; a composite leaves lost ones out."""
        setup, lateral = self.setup, self.setup.flow.lateral
        ends = setup.lead, setup.predecessor or ""
        if mode in {"lead", "predecessor"}:
            return (ends[mode == "predecessor"],)
        if mode == "intermediate":
            lateral = tuple(name for name in lateral if name not in ends)
        kept = [name for name in lateral if statuses.get(name, "") in RELIED_ON]
        return tuple(kept) if mode in {"composite", "intermediate"} and kept else lateral

    def _error(self, requested: int) -> LogError:
        decisions = self._messages.decisions
        if not decisions:
            return LogError(f"{self.log}: no decisions of {self.vehicle}")
        first, last = (self._seconds(decisions[row][0]) for row in (0, -1))
        at_s = self._seconds(requested) if requested > -FOREVER else nan
        return LogError(
            f"{self.log}: {self.vehicle} has no decision at {at_s:g} s, allowed "
            f"{first:g} to {last:g}"
        )

    @cached_property
    def _without(self) -> Mapping[str, Mapping[int, MissingVerdict]]:
        """Messages without a verdict by sender and number, by the accounts of the links."""
        counted = accounts(tables_in(self._reader, self.scenario))
        return {
            sender: {row.number: row for row in counted[sender, self.vehicle].missing}
            for sender in self.senders
        }

    def _known(self, sender: str, now: int, status: str) -> KnownSource:
        poses, verdicts = self._messages.poses[sender], self._messages.verdicts[sender]
        received = [
            verdict
            for verdict in verdicts.values()
            if verdict.outcome == "delivered" and verdict.received_at <= now
        ]
        newest = max(received, key=lambda verdict: verdict.measured_at, default=None)
        since = newest.number if newest else -1
        without = self._without[sender]
        sent_by_now = sorted(number for number, pose in poses.items() if pose.sent_at <= now)
        missing = [
            self._missing(sender, poses[number], verdicts.get(number), without.get(number))
            for number in sent_by_now
            if number > since
        ]
        return KnownSource(
            sender=sender,
            use=self.setup.flow.use_of(sender),
            number=newest.number if newest else None,
            measured_at_s=self._seconds(newest.measured_at) if newest else None,
            received_at_s=self._seconds(newest.received_at) if newest else None,
            age_s=self._age(newest, now) if newest else None,
            path_left_m=self._path_left(sender, received, now),
            received_ratio=_received(verdicts.values(), without.values(), now),
            missing=tuple(missing),
            status=status,
        )

    def _seconds(self, at: int) -> float:
        return (at - self.start_at) / SECOND

    def _age(self, newest: RecordedVerdict, now: int) -> float:
        """Age (s) of a message by the clock of the vehicle that received it."""
        clock = self.scenario.clock(self.vehicle, self.start_at)
        return (clock.reading(now) - newest.measured_at) / SECOND

    def _missing(
        self,
        sender: str,
        pose: SentPose,
        verdict: RecordedVerdict | None,
        message: MissingVerdict | None,
    ) -> MissingMessage:
        sent_at_s = self._seconds(pose.sent_at)
        if verdict is None:
            fate = FATES.get(message.fate, NOT_ARRIVED) if message else NOT_ARRIVED
            cause = FATE_WORDS[message.fate] if message and fate == NOT_ARRIVED else ""
            return MissingMessage(number=pose.number, sent_at_s=sent_at_s, fate=fate, cause=cause)
        dropped, link = verdict.outcome == "dropped", (sender, self.vehicle)
        return MissingMessage(
            number=pose.number,
            sent_at_s=sent_at_s,
            fate=verdict.reason if dropped else IN_TRANSIT,
            cause=origin(self.scenario.tables, link, verdict.reason) if dropped else "",
            due_at_s=self._seconds(verdict.received_at),
        )

    def _path_left(
        self, sender: str, received: Sequence[RecordedVerdict], now: int
    ) -> float | None:
        """Distance (m) along the received positions of `sender` that lies ahead of the vehicle."""
        here = self._messages.places.get(now)
        if here is None or not received:
            return None
        plane = LocalPlane(self.scenario.origin)
        sent, numbers = self._messages.poses[sender], {verdict.number for verdict in received}
        known = [pose for number, pose in sent.items() if number in numbers]
        poses = sorted(known, key=lambda pose: pose.measured_at)
        places = [
            plane.to_plane(pose.latitude_deg, pose.longitude_deg, pose.altitude_m) for pose in poses
        ]
        return remaining_path_length(places, here)


def explain(log: Path, vehicle: str, at_s: float) -> Explanation:
    """List what `vehicle` knew `at_s` (s) after the start of the run in `log`.

    Raises LogError for an unknown vehicle or an instant outside of the run.
    """
    return RecordedKnowledge(log, vehicle).at(at_s)


def _received(
    verdicts: Iterable[RecordedVerdict], without: Iterable[MissingVerdict], now: int
) -> float | None:
    """Delivered share of the messages due within the last second, None without any.

    Messages that the transport lost are due when they were sent.
    """
    due = [verdict for verdict in verdicts if now - SECOND < verdict.received_at <= now]
    absent = [lost for lost in without if lost.is_lost and now - SECOND < lost.sent_at <= now]
    delivered = sum(message.outcome == "delivered" for message in due)
    return delivered / (len(due) + len(absent)) if due or absent else None


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
            return best_length
        length_so_far += length
    return best_length


def _distance(start: tuple[float, float], other: tuple[float, float]) -> float:
    return hypot(start[0] - other[0], start[1] - other[1])


def _foot(start: tuple[float, float], end: tuple[float, float], here: tuple[float, float]) -> float:
    """Share of the segment from `start` to `end` at its point nearest to `here`."""
    east, north = end[0] - start[0], end[1] - start[1]
    along = (here[0] - start[0]) * east + (here[1] - start[1]) * north
    return min(1.0, max(0.0, along / (east * east + north * north)))
