"""The inbox of one vehicle: takes bytes from the bus, returns the poses delivered by its links."""

from array import array
from bisect import bisect_right
from collections import Counter, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from heapq import heappop, heappush
from threading import Lock
from typing import Final

from transport.codec import MessageNumbers, RefusedMessageError, decode
from transport.links.content_stage import COPY, ContentStage, Transmission
from transport.links.laws.link_law import (
    UNKNOWN_POSITION,
    Position,
    StagedMessage,
    TransmissionContext,
)
from transport.links.link import GPS, LONGEST_POSE_BYTES, Link, PoseGate, TimestampRefusals, Verdict
from transport.topics import RefusalReason, counts_as_late, key
from vehicles.messages import GpsPose, LinkVerdict
from vehicles.received_pose import ReceivedPose

# ---- Recent positions of a receiver, stored in compact arrays


MAX_POSITIONS: Final = 4096  # Number of stored ticks: at least a minute, for late messages
DELETED_AT_ONCE: Final = MAX_POSITIONS // 8


class PositionHistory:
    """True positions of a receiver at its last ticks, at least `MAX_POSITIONS` of them."""

    def __init__(self) -> None:
        self._instants = array("q")
        self._coordinates = array("d")

    def add(self, now: int, position: Position) -> None:
        """Add the position at the tick at `now` (ns); ticks are added in order."""
        self._instants.append(now)
        self._coordinates.extend(position)
        if len(self._instants) >= MAX_POSITIONS + DELETED_AT_ONCE:
            del self._instants[:DELETED_AT_ONCE]
            del self._coordinates[: 3 * DELETED_AT_ONCE]

    def at(self, instant: int) -> Position:
        """Position at the last tick until `instant` (ns), or at the oldest stored tick."""
        index = 3 * max(bisect_right(self._instants, instant) - 1, 0)
        return Position(*self._coordinates[index : index + 3])


# ---- Messages of a link with stages, which wait until their verdicts are final


class StagedMessages:
    """Messages of one link in its stages, after the verdicts of its effects."""

    def __init__(self, link: Link) -> None:
        self._stages = [law.stage() for law in link.stages]
        self._link = link
        self._pending: list[tuple[int, int, StagedMessage]] = []
        self._newest = -1

    def is_late(self, context: TransmissionContext, tick: int) -> bool:
        """Whether messages sent at the same instant were already decided at `tick` (ns)."""
        return context.sent_at <= self._link.latest_sent_at(tick)

    def is_overtaken(self, context: TransmissionContext) -> bool:
        """Whether a later message was already decided, so that this one can no longer join."""
        return context.seq <= self._newest

    def join(self, context: TransmissionContext, verdict: Verdict) -> None:
        """Add a message with the verdict of the effects."""
        message = StagedMessage(context, verdict.visible_at, verdict.reason)
        heappush(self._pending, (context.sent_at, context.seq, message))

    def resolve(self, now: int) -> list[tuple[TransmissionContext, Verdict]]:
        """Messages whose verdicts became final by the tick at `now` (ns)."""
        until = self._link.latest_sent_at(now)
        messages = []
        while self._pending and self._pending[0][0] <= until:
            _, self._newest, message = heappop(self._pending)
            messages.append(message)
        for stage in self._stages:
            messages = stage.carry(messages, until)
        return [
            (
                message.context,
                Verdict(
                    "dropped" if message.reason else "delivered", message.reason, message.visible_at
                ),
            )
            for message in messages
        ]


def judge_stream(link: Link, stream: Iterable[TransmissionContext]) -> list[Verdict]:
    """Verdicts on all messages sent over a link, in the order of their numbers."""
    contexts = sorted(stream, key=lambda context: context.seq)
    if not link.stages:
        return [link.judge(context) for context in contexts]
    staged = StagedMessages(link)
    for context in contexts:
        staged.join(context, link.judge(context))
    final = staged.resolve(_FOREVER)
    return [verdict for _, verdict in sorted(final, key=lambda pair: pair[0].seq)]


_FOREVER: Final = 2**63 - 1


# ---- Inbox


QUEUE: Final = 4096  # Maximum number of messages between two ticks; the oldest are dropped
LONGEST_WAITING: Final = 8000  # Length of the list of waiting messages, half of that of a message
WINDOW: Final = 8192  # Older numbers of a sender are refused, which bounds the memory


@dataclass(slots=True)
class IncomingLink:
    """The link from one sender, its gate and its counters.

    `content` alters the content of messages, if configured. `staged` holds the messages in the
    stages of the link, `pending` their transmissions by number. `numbers` are those received from
    the bus, lost on the link or not. `delivered`, `dropped` (by reason) and `late` count published
    verdicts; a late message is also counted as delivered or dropped.
    """

    link: Link
    gate: PoseGate
    content: ContentStage | None = None
    delivered: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    late: int = 0
    staged: StagedMessages | None = field(init=False)
    pending: dict[int, Transmission] = field(default_factory=dict)
    numbers: MessageNumbers = field(default_factory=lambda: MessageNumbers(window=WINDOW))

    def __post_init__(self) -> None:
        self.staged = StagedMessages(self.link) if self.link.stages else None

    def register(self, seq: int) -> None:
        """Register the number `seq`; raises RefusedMessageError if it is repeated or too old."""
        newest = self.numbers.newest
        if seq <= newest - WINDOW:
            raise RefusedMessageError("past", f"number {seq} is far behind {newest}")
        if not self.numbers.add(seq):
            raise RefusedMessageError("duplicate", f"number {seq} was received before")


@dataclass(frozen=True, slots=True)
class InboxCounts:
    """Counters of an inbox for Health; `late` are messages with a verdict of a link."""

    verdicts: int = 0
    delivered: int = 0
    dropped: int = 0
    late: int = 0
    rejected: Mapping[str, int] = field(default_factory=dict)


class Inbox:
    """Receives the messages of one vehicle over a link from each of its senders.

    Messages are judged and delivered by `take`, on the calling thread; only `on_bytes` may be
    called from another thread.

    A message is late if it arrives after the tick at which it should have been visible, or, on a
    link with stages, decided. `delivered` and `dropped` count verdicts of links, `rejected` counts,
    by reason, refused messages and copies, which have no verdict.
    """

    def __init__(
        self,
        receiver: str,
        links: Iterable[IncomingLink],
        *,
        start_at: int,
        before: InboxCounts | None = None,
    ) -> None:
        """`start_at` (ns) is the first instant of the run; counting continues from `before`."""
        self.receiver = receiver
        self._before = before or InboxCounts()
        self._refused: Counter[str] = Counter(self._before.rejected)
        self._overflow = 0
        self._positions = PositionHistory()
        self._arrived: deque[tuple[str, bytes, int]] = deque(maxlen=QUEUE)
        self._lock = Lock()
        self._verdicts: list[LinkVerdict] = []
        self._verdict_seq = self._before.verdicts
        self._reported: Counter[str] = Counter(self._before.rejected)
        self._misdated = TimestampRefusals()
        self._clock_warnings: list[str] = []
        self._connect(links, start_at)
        self._senders = {key(sender, GPS): sender for sender in self.links}

    def _connect(self, links: Iterable[IncomingLink], now: int) -> None:
        self.links = {incoming.link.sender: incoming for incoming in links}
        self._staged = [
            (sender, link) for sender, link in self.links.items() if link.staged is not None
        ]
        self._waiting: list[tuple[int, str, int, int, Transmission | ReceivedPose]] = []
        self._receives_from = now
        self._taken_until = now - 1

    def restart(self, links: Iterable[IncomingLink], now: int) -> None:
        """Reset all but the counts; receive messages sent from `now` (ns) on over new `links`."""
        self._before = self.counts
        self._connect(links, now)

    def skip(self, now: int, position: Position) -> None:
        """Store the position at the tick at `now` (ns) without receiving; messages wait."""
        self._positions.add(now, position)

    def discard(self, now: int, position: Position) -> None:
        """Store the position at the tick at `now` (ns) and discard messages sent until then.

        Later ones are kept, because this tick may be late.
        """
        self.skip(now, position)
        if not self._arrived:
            return
        with self._lock:
            arrived, self._arrived = self._arrived, deque(maxlen=QUEUE)
            kept = [message for message in arrived if _sent_after(message[1], now)]
            self._arrived.extend(kept)

    @property
    def counts(self) -> InboxCounts:
        late, rejected = self._late_on_links, dict(self.rejected)
        return InboxCounts(self._verdict_seq, self.delivered, self.dropped, late, rejected)

    @property
    def keys(self) -> list[str]:
        return list(self._senders)

    @property
    def delivered(self) -> int:
        return self._before.delivered + sum([link.delivered for link in self.links.values()])

    @property
    def dropped(self) -> int:
        return self._before.dropped + sum([link.dropped.total() for link in self.links.values()])

    @property
    def late(self) -> int:
        refused = sum([count for word, count in self._refused.items() if counts_as_late(word)])
        return refused + self._late_on_links

    @property
    def _late_on_links(self) -> int:
        pending = [each.late for link in self.links.values() for each in link.pending.values()]
        waiting = [item.late for *_, item in self._waiting if isinstance(item, Transmission)]
        links = [link.late for link in self.links.values()]
        return self._before.late + sum(links) + sum(pending) + sum(waiting)

    @property
    def rejected(self) -> Counter[str]:
        return self._refused + Counter(overflow=self._overflow)

    def on_bytes(self, sender_key: str, data: bytes, arrived_at: int = 0) -> None:
        """Queue a message that arrived from the bus at an instant (ns), 0 if that is unknown.

        If the queue is full, the oldest message is dropped.
        """
        with self._lock:
            self._overflow += len(self._arrived) == self._arrived.maxlen
            # One byte beyond the limit suffices for the refusal.
            self._arrived.append((sender_key, data[: LONGEST_POSE_BYTES + 1], arrived_at))

    def count_refused(self, reason: RefusalReason, count: int) -> None:
        """Count messages refused elsewhere in this process; on the thread that calls `take`."""
        self._refused[reason] += count

    def count_overflow(self) -> None:
        """Count an overflow of the buffer of the bus."""
        with self._lock:
            self._overflow += 1

    def take(self, now: int, position: Position = UNKNOWN_POSITION) -> list[ReceivedPose]:
        """Return the poses that became visible by the tick at `now` (ns).

        They are in the order (visible_at, sender, seq). Instants must not decrease. `verdicts`
        returns the verdict at the tick that delivers the pose, or would have delivered it.
        `position` is the true position of the receiver, for links that depend on it.
        """
        self.skip(now, position)
        if self._arrived:
            self._judge_arrived(now)
        for name, link in self._staged:
            for context, verdict in link.staged.resolve(now) if link.staged else ():
                transmission = link.pending.pop(context.seq)
                transmission.verdict = verdict
                heappush(self._waiting, (verdict.visible_at, name, context.seq, 0, transmission))
        self._taken_until = now
        return self._deliver(now) if self._waiting else []

    def _judge_arrived(self, now: int, *, ends: bool = False) -> None:
        """Judge the messages sent by the tick at `now` (ns), or all that arrived if it `ends`.

        A late tick finds messages sent after it, when the position of the receiver is not known
        yet: they wait for the next tick.
        """
        with self._lock:
            arrived, self._arrived = self._arrived, deque(maxlen=QUEUE)
        early: list[tuple[str, bytes, int]] = []
        for sender_key, data, arrived_at in arrived:
            try:
                if not self._judge(sender_key, data, now, arrived_at, ends=ends):
                    early.append((sender_key, data, arrived_at))
            except RefusedMessageError as refusal:
                self._refused[refusal.reason] += 1
                sender = self._senders.get(sender_key, "")
                if sender and (warning := self._misdated.count(sender, refusal.reason)):
                    self._clock_warnings.append(warning)
        if early:
            with self._lock:
                self._arrived.extendleft(reversed(early))

    def waiting(self, now: int) -> str:
        """List the messages that arrived in time and have no verdict by `now` (ns), for Health.

        Those that arrived late, after the last tick, were of no use: they are not in flight. Up to
        LONGEST_WAITING characters.
        """
        self._judge_arrived(now, ends=True)
        numbers = {sender: MessageNumbers() for sender in self.links}
        for _, sender, seq, _, item in self._waiting:
            if isinstance(item, Transmission) and not item.late:
                numbers[sender].add(seq)
        for sender, link in self.links.items():
            for seq, transmission in link.pending.items():
                if not transmission.late:
                    numbers[sender].add(seq)
        text = ""
        for sender, waiting in numbers.items():
            for first, last in waiting.ranges():
                longer = f"{text},{sender} {first} {last}" if text else f"{sender} {first} {last}"
                text = longer if len(longer) <= LONGEST_WAITING else text
        return text

    def verdicts(self) -> list[LinkVerdict]:
        out, self._verdicts = self._verdicts, []
        return out

    def clock_warnings(self) -> list[str]:
        warnings, self._clock_warnings = self._clock_warnings, []
        return warnings

    def rejections(self) -> list[tuple[str, int]]:
        now = self.rejected
        new = now - self._reported
        self._reported = now
        return sorted(new.items())

    def _judge(
        self, sender_key: str, data: bytes, now: int, arrived_at: int, *, ends: bool
    ) -> bool:
        """Judge a message; False for one that has to wait for the next tick."""
        sender = self._senders.get(sender_key)
        if sender is None:
            raise RefusedMessageError("unknown", f"{self.receiver} has no link for {sender_key}")
        link = self.links[sender]
        pose = link.gate.admit(data, now)
        message = pose.message
        if message.sent_at_ns < self._receives_from:  # sent before a restart
            return True
        if message.sent_at_ns > now and not ends:
            return False
        link.register(message.seq)
        antenna = Position(message.true_east_m, message.true_north_m, message.true_distance_m)
        own = self._positions.at(message.sent_at_ns)
        context = TransmissionContext(message.seq, message.sent_at_ns, len(data), antenna, own)
        verdict = link.link.judge(context)
        if link.content is not None:
            link.content.history.add(message)
        late = verdict.visible_at <= self._taken_until
        transmission = Transmission(pose, context, verdict, late, pose, arrived_at=arrived_at)
        if link.staged is not None:
            transmission.late = late or link.staged.is_late(context, self._taken_until)
            if not link.staged.is_overtaken(context):
                link.staged.join(context, verdict)
                link.pending[message.seq] = transmission
                return True
        heappush(self._waiting, (verdict.visible_at, sender, message.seq, 0, transmission))
        return True

    def _deliver(self, now: int) -> list[ReceivedPose]:
        delivered: list[ReceivedPose] = []
        while self._waiting and self._waiting[0][0] <= now:
            _, sender, seq, nth, item = heappop(self._waiting)
            link = self.links[sender]
            if not isinstance(item, Transmission):
                if nth != COPY or self._accepts_copy(link, seq):
                    item.received_at = now
                    delivered.append(item)
                continue
            if link.content is not None:
                for extra in link.content.apply(item):
                    heappush(self._waiting, (extra.at, sender, seq, extra.nth, extra.pose))
            link.late += item.late
            if item.verdict.outcome == "delivered":
                link.delivered += 1
                item.pose.received_at = now
                delivered.append(item.pose)
            else:
                link.dropped[item.verdict.reason] += 1
            self._verdicts.append(self._verdict_on(item, now))
        return delivered

    def _accepts_copy(self, link: IncomingLink, seq: int) -> bool:
        if link.content is not None and link.content.filters:
            try:
                link.register(seq)
            except RefusedMessageError as refusal:
                self._refused[refusal.reason] += 1
                return False
        return True

    def _verdict_on(self, transmission: Transmission, now: int) -> LinkVerdict:
        seq, self._verdict_seq = self._verdict_seq, self._verdict_seq + 1
        sent, verdict = transmission.sent.message, transmission.verdict
        return LinkVerdict(
            vehicle=self.receiver,
            seq=seq,
            sender=sent.vehicle,
            pose_seq=sent.seq,
            measured_at_ns=sent.measured_at_ns,
            outcome=verdict.outcome,
            reason=verdict.reason,
            visible_at_ns=verdict.visible_at,
            received_at_ns=now,
            late=transmission.late,
            sent_at_ns=sent.sent_at_ns,
            copies=transmission.copies,
            content=transmission.content,
            arrived_at_ns=transmission.arrived_at,
        )


def _sent_after(data: bytes, now: int) -> bool:
    try:
        pose = decode(GPS, data, exact=True)
    except RefusedMessageError:
        return False
    return isinstance(pose, GpsPose) and pose.sent_at_ns > now
