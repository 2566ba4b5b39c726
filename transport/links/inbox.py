"""The inbox of one vehicle: bytes in, poses out once their links deliver them."""

from collections import Counter, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from heapq import heappop, heappush
from threading import Lock
from typing import Final

from transport.codec import RefusedMessageError, decode
from transport.links.content_stage import COPY, ContentStage, Transmission
from transport.links.gate import GPS, LONGEST_POSE_BYTES, PoseGate, TimestampRefusals
from transport.links.laws.effect import UNKNOWN_POSITION, Position, TransmissionContext
from transport.links.link import Link
from transport.links.positions import PositionHistory
from transport.links.staged_messages import StagedMessages
from transport.message_numbers import MessageNumbers
from transport.reasons import counts_as_late
from transport.topics import key
from vehicles.messages import GpsPose, LinkVerdict
from vehicles.received_pose import ReceivedPose

QUEUE: Final = 4096
"""Largest number of messages between two ticks; the oldest are dropped."""
WINDOW: Final = 8192
"""Numbers this far behind a sender's newest are refused, so that memory is bounded."""


@dataclass(slots=True)
class IncomingLink:
    """The link from one sender, its gate, and its counters.

    `content` alters the content of messages, if configured. `line` holds messages that depend on
    one another until their verdicts are known, `held` are their transmissions by number. `numbers`
    are those that came, lost or not. `delivered`, `dropped` (by reason) and `late` count published
    verdicts; a late message is among the delivered or the dropped as well.
    """

    link: Link
    gate: PoseGate
    content: ContentStage | None = None
    delivered: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    late: int = 0
    line: StagedMessages | None = field(init=False)
    held: dict[int, Transmission] = field(default_factory=dict)
    numbers: MessageNumbers = field(default_factory=lambda: MessageNumbers(window=WINDOW))

    def __post_init__(self) -> None:
        self.line = StagedMessages(self.link) if self.link.stages else None

    def number(self, seq: int) -> None:
        """Note the number `seq`; raises RefusedMessageError if it is repeated or far behind."""
        newest = self.numbers.newest
        if seq <= newest - WINDOW:
            raise RefusedMessageError("past", f"number {seq} is far behind {newest}")
        if not self.numbers.add(seq):
            raise RefusedMessageError("duplicate", f"number {seq} came before")


@dataclass(frozen=True, slots=True)
class InboxCounts:
    """Counters of an inbox for Health, to be continued; `late` are those that a link judged."""

    verdicts: int = 0
    delivered: int = 0
    dropped: int = 0
    late: int = 0
    rejected: Mapping[str, int] = field(default_factory=dict)


class Inbox:
    """Receives the messages of one vehicle, over a link from each of its senders.

    Messages are judged and delivered in `take`, in the thread that calls it; only `on_bytes` may be
    called from another.

    A message is late if it came after the tick that should have judged it, or too late to be of
    any use; in a link with stages that tick is the first that its floor lets it through.
    `delivered` and `dropped` count the verdicts of links, `rejected`, by reason, the messages that
    no link judged, and refused copies.
    """

    def __init__(
        self,
        receiver: str,
        links: Iterable[IncomingLink],
        *,
        start_at: int,
        before: InboxCounts | None = None,
    ) -> None:
        """`start_at` (ns) is the first instant of the run; counters `before` are continued."""
        self.receiver = receiver
        self._before = before or InboxCounts()
        self._refused: Counter[str] = Counter(self._before.rejected)
        self._overflow = 0
        self._positions = PositionHistory()
        self._arrived: deque[tuple[str, bytes]] = deque(maxlen=QUEUE)
        self._lock = Lock()
        self._verdicts: list[LinkVerdict] = []
        self._verdict_seq = self._before.verdicts
        self._reported: Counter[str] = Counter(self._before.rejected)
        self._misdated = TimestampRefusals()
        self._complaints: list[str] = []
        self._listen(links, start_at)
        self._senders = {key(sender, GPS): sender for sender in self.links}

    def _listen(self, links: Iterable[IncomingLink], now: int) -> None:
        self.links = {one.link.sender: one for one in links}
        self._lined = [(name, one) for name, one in self.links.items() if one.line is not None]
        self._waiting: list[tuple[int, str, int, int, Transmission | ReceivedPose]] = []
        self._listens_from = now
        self._taken_until = now - 1

    def restart(self, links: Iterable[IncomingLink], now: int) -> None:
        """Forget all but the counts; receive over new `links` messages sent from `now` (ns) on."""
        self._before = self.counts
        self._listen(links, now)

    def skip(self, now: int, here: Position) -> None:
        """Note the position at the tick at `now` (ns) without receiving; messages wait."""
        self._positions.add(now, here)

    def discard(self, now: int, here: Position) -> None:
        """Note the position at the tick at `now` (ns), and drop the messages sent by then.

        Later ones are kept: this tick may be late.
        """
        self.skip(now, here)
        if not self._arrived:
            return
        with self._lock:
            arrived, self._arrived = self._arrived, deque(maxlen=QUEUE)
            kept = [one for one in arrived if _sent_after(one[1], now)]
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
        too_late = sum([count for word, count in self._refused.items() if counts_as_late(word)])
        return too_late + self._late_on_links

    @property
    def _late_on_links(self) -> int:
        held = [one.late for link in self.links.values() for one in link.held.values()]
        waiting = [one.late for *_, one in self._waiting if isinstance(one, Transmission)]
        links = [link.late for link in self.links.values()]
        return self._before.late + sum(links) + sum(held) + sum(waiting)

    @property
    def rejected(self) -> Counter[str]:
        return self._refused + Counter(overflow=self._overflow)

    def on_bytes(self, sender_key: str, data: bytes) -> None:
        """Queue a message from the bus; when too many wait the oldest are dropped."""
        with self._lock:
            self._overflow += len(self._arrived) == self._arrived.maxlen
            # One byte beyond the limit suffices for the refusal.
            self._arrived.append((sender_key, data[: LONGEST_POSE_BYTES + 1]))

    def count_overflow(self) -> None:
        """Count an overflow of the bus's own queue."""
        with self._lock:
            self._overflow += 1

    def take(self, now: int, here: Position = UNKNOWN_POSITION) -> list[ReceivedPose]:
        """Return the poses that have become visible by the tick at `now` (ns).

        They come in the order (visible_at, sender, seq). Instants must not decrease. A verdict is
        published by `verdicts` at the tick that delivers a pose, or would have delivered it.
        `here` is the true position of the receiver, for links that depend on it.
        """
        self.skip(now, here)
        if self._arrived:
            with self._lock:
                arrived, self._arrived = self._arrived, deque(maxlen=QUEUE)
            for sender_key, data in arrived:
                try:
                    self._judge(sender_key, data, now)
                except RefusedMessageError as refusal:
                    self._refused[refusal.reason] += 1
                    sender = self._senders.get(sender_key, "")
                    if sender and (line := self._misdated.count(sender, refusal.reason)):
                        self._complaints.append(line)
        for name, link in self._lined:
            for context, judged in link.line.resolve(now) if link.line else ():
                one = link.held.pop(context.seq)
                one.verdict = judged
                heappush(self._waiting, (judged.visible_at, name, context.seq, 0, one))
        self._taken_until = now
        return self._deliver(now) if self._waiting else []

    def verdicts(self) -> list[LinkVerdict]:
        """Verdicts since the last call."""
        out, self._verdicts = self._verdicts, []
        return out

    def clock_warnings(self) -> list[str]:
        """Warnings about impossible stamps since the last call."""
        lines, self._complaints = self._complaints, []
        return lines

    def rejections(self) -> list[tuple[str, int]]:
        """Rejected messages since the last call: (reason, count)."""
        now = self.rejected
        new = now - self._reported
        self._reported = now
        return sorted(new.items())

    def _judge(self, sender_key: str, data: bytes, now: int) -> None:
        sender = self._senders.get(sender_key)
        if sender is None:
            raise RefusedMessageError("unknown", f"{self.receiver} does not listen to {sender_key}")
        link = self.links[sender]
        pose = link.gate.admit(data, now)
        message = pose.message
        if message.sent_at_ns < self._listens_from:  # while the vehicle did not receive
            return
        link.number(message.seq)
        antenna = Position(message.true_east_m, message.true_north_m, message.true_distance_m)
        here = self._positions.at(message.sent_at_ns)
        context = TransmissionContext(message.seq, message.sent_at_ns, len(data), antenna, here)
        judged = link.link.judge(context)
        if link.content is not None:
            link.content.history.note(message)
        late = judged.visible_at <= self._taken_until
        one = Transmission(pose, context, judged, late, pose)
        if link.line is not None:
            one.late = late or link.line.is_late(context, self._taken_until)
            if not link.line.is_overtaken(context):
                link.line.join(context, judged)
                link.held[message.seq] = one
                return
        heappush(self._waiting, (judged.visible_at, sender, message.seq, 0, one))

    def _deliver(self, now: int) -> list[ReceivedPose]:
        delivered: list[ReceivedPose] = []
        while self._waiting and self._waiting[0][0] <= now:
            _, sender, seq, nth, one = heappop(self._waiting)
            link = self.links[sender]
            if not isinstance(one, Transmission):
                if nth != COPY or self._takes_copy(link, seq):
                    one.received_at = now
                    delivered.append(one)
                continue
            if link.content is not None:
                for extra in link.content.arrive(one):
                    heappush(self._waiting, (extra.at, sender, seq, extra.nth, extra.pose))
            link.late += one.late
            if one.verdict.outcome == "delivered":
                link.delivered += 1
                one.pose.received_at = now
                delivered.append(one.pose)
            else:
                link.dropped[one.verdict.reason] += 1
            self._verdicts.append(self._verdict_on(one, now))
        return delivered

    def _takes_copy(self, link: IncomingLink, seq: int) -> bool:
        if link.content is not None and link.content.filters:
            try:
                link.number(seq)
            except RefusedMessageError as refusal:
                self._refused[refusal.reason] += 1
                return False
        return True

    def _verdict_on(self, one: Transmission, now: int) -> LinkVerdict:
        seq, self._verdict_seq = self._verdict_seq, self._verdict_seq + 1
        sent, judged = one.sent.message, one.verdict
        return LinkVerdict(
            vehicle=self.receiver,
            seq=seq,
            sender=sent.vehicle,
            pose_seq=sent.seq,
            measured_at_ns=sent.measured_at_ns,
            outcome=judged.outcome,
            reason=judged.reason,
            visible_at_ns=judged.visible_at,
            received_at_ns=now,
            late=one.late,
            sent_at_ns=sent.sent_at_ns,
            copies=one.copies,
            content=one.content,
        )


def _sent_after(data: bytes, now: int) -> bool:
    try:
        pose = decode(GPS, data, exact=True)
    except RefusedMessageError:
        return False
    return isinstance(pose, GpsPose) and pose.sent_at_ns > now
