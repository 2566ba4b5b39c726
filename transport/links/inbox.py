"""What one vehicle receives: bytes in, poses out when their links let them through."""

from collections import Counter, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from heapq import heappop, heappush
from threading import Lock
from typing import Final

from transport.codec import RefusedMessageError, decode
from transport.links.arrival import COPY, ContentStage, Transmission
from transport.links.gate import GPS, LONGEST_POSE_BYTES, MisdatedCount, PoseGate
from transport.links.laws.effect import NOWHERE, Position, TransmissionContext
from transport.links.line import Line
from transport.links.link import Link
from transport.links.places import PlacesPassed
from transport.message_numbers import MessageNumbers
from transport.reasons import counts_as_late
from transport.topics import key
from vehicles.messages import GpsPose, LinkVerdict
from vehicles.received_pose import ReceivedPose

QUEUE: Final = 4096
"""Messages that wait at most for a tick to take them; the oldest go first."""
WINDOW: Final = 8192
"""Numbers this far behind a sender's newest are refused, so that memory is bounded."""


@dataclass(slots=True)
class IncomingLink:
    """The link from one sender, its gate, and what became of its messages so far.

    `content` is what the channel makes of messages themselves, if anything is configured. `line`
    holds messages that depend on one another until their fate is known; `held` are they by number.
    `numbers` are those that came, lost or not. `delivered`, `dropped` (by reason) and `late` count
    verdicts put out; a late message is among the delivered or the dropped as well.
    """

    link: Link
    gate: PoseGate
    content: ContentStage | None = None
    delivered: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    late: int = 0
    line: Line | None = field(init=False)
    held: dict[int, Transmission] = field(default_factory=dict)
    numbers: MessageNumbers = field(default_factory=lambda: MessageNumbers(window=WINDOW))

    def __post_init__(self) -> None:
        """Begin the line, if the link's messages depend on one another."""
        self.line = Line(self.link) if self.link.stages else None

    def number(self, seq: int) -> None:
        """Note that `seq` came; raises RefusedMessageError if it came before or is far behind."""
        newest = self.numbers.newest
        if seq <= newest - WINDOW:
            raise RefusedMessageError("past", f"number {seq} is far behind {newest}")
        if not self.numbers.add(seq):
            raise RefusedMessageError("duplicate", f"number {seq} came before")


@dataclass(frozen=True, slots=True)
class InboxCounts:
    """What an inbox has counted: verdicts put out, and what Health tells of.

    `late` are those that a link had to judge.
    """

    verdicts: int = 0
    heard: int = 0
    dropped: int = 0
    late: int = 0
    rejected: Mapping[str, int] = field(default_factory=dict)


class Inbox:
    """What one vehicle receives, over a link from each sender that it listens to.

    Messages are judged and handed over in `take` alone, in the thread that calls it; only
    `on_bytes` may be called from another.

    A message is late if it came after the tick that should have judged it, or too late to be of
    any use; in a link with stages that tick is the first that its floor lets it through. `heard`
    and `dropped` count what the links judged, `rejected`, by a word of the table of reasons, all
    that no link had to judge, and copies that a link made of what was heard.
    """

    def __init__(
        self,
        receiver: str,
        links: Iterable[IncomingLink],
        *,
        start_at: int,
        before: InboxCounts | None = None,
    ) -> None:
        """`start_at` (ns) is the first instant of the run; what was counted `before` goes on."""
        self.receiver = receiver
        self._before = before or InboxCounts()
        self._refused: Counter[str] = Counter(self._before.rejected)
        self._overflow = 0
        self._places = PlacesPassed()
        self._arrived: deque[tuple[str, bytes]] = deque(maxlen=QUEUE)
        self._lock = Lock()
        self._verdicts: list[LinkVerdict] = []
        self._verdict_seq = self._before.verdicts
        self._reported: Counter[str] = Counter(self._before.rejected)
        self._misdated = MisdatedCount()
        self._complaints: list[str] = []
        self._listen(links, start_at)
        self._senders = {key(sender, GPS): sender for sender in self.links}

    def _listen(self, links: Iterable[IncomingLink], now: int) -> None:
        """Begin at `now` (ns), with nothing heard over `links` so far."""
        self.links = {one.link.sender: one for one in links}
        self._lined = [(name, one) for name, one in self.links.items() if one.line is not None]
        self._waiting: list[tuple[int, str, int, int, Transmission | ReceivedPose]] = []
        self._heard_from = now
        self._taken_until = now - 1

    def listen_anew(self, links: Iterable[IncomingLink], now: int) -> None:
        """Forget all but the counts: over new `links`, hear what is sent from `now` (ns) on."""
        self._before = self.counts
        self._listen(links, now)

    def pass_by(self, now: int, here: Position) -> None:
        """Be `here` at the tick at `now` (ns) without hearing anything; what came waits."""
        self._places.add(now, here)

    def let_go(self, now: int, here: Position) -> None:
        """Be `here` at the tick at `now` (ns), where nobody listens: what was sent by now is gone.

        What came of later is kept: this tick may be late.
        """
        self.pass_by(now, here)
        if not self._arrived:
            return
        with self._lock:
            arrived, self._arrived = self._arrived, deque(maxlen=QUEUE)
            kept = (one for one in arrived if _sent_after(one[1], now))
            self._arrived.extend(kept)

    @property
    def counts(self) -> InboxCounts:
        """What was counted so far."""
        late = self._late_on_links
        return InboxCounts(self._verdict_seq, self.heard, self.dropped, late, dict(self.rejected))

    @property
    def keys(self) -> list[str]:
        """The keys to subscribe to."""
        return list(self._senders)

    @property
    def heard(self) -> int:
        """Poses handed over so far."""
        return self._before.heard + sum([link.delivered for link in self.links.values()])

    @property
    def dropped(self) -> int:
        """Poses that a link dropped so far."""
        return self._before.dropped + sum([link.dropped.total() for link in self.links.values()])

    @property
    def late(self) -> int:
        """Poses so far that came after the tick that should have judged them, or far later."""
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
        """Messages so far that no link had to judge, by reason."""
        return self._refused + Counter(overflow=self._overflow)

    def on_bytes(self, sender_key: str, data: bytes) -> None:
        """Take in a message as it comes from the bus; the oldest go when too many wait."""
        with self._lock:
            self._overflow += len(self._arrived) == self._arrived.maxlen
            # One byte too long is refused like a million, without keeping the million.
            self._arrived.append((sender_key, data[: LONGEST_POSE_BYTES + 1]))

    def note_overflow(self) -> None:
        """Count that more came than could be kept for this vehicle."""
        with self._lock:
            self._overflow += 1

    def take(self, now: int, here: Position = NOWHERE) -> list[ReceivedPose]:
        """Return the poses that have become visible by the tick at `now` (ns).

        They come in the order (visible_at, sender, seq). Instants must not go back. A verdict is
        put out, by `verdicts`, at the tick that hands a pose over, or would have handed it over.
        `here` is where the receiver truly is, for links that depend on it.
        """
        self.pass_by(now, here)
        if self._arrived:
            with self._lock:
                arrived, self._arrived = self._arrived, deque(maxlen=QUEUE)
            for sender_key, data in arrived:
                try:
                    self._judge(sender_key, data, now)
                except RefusedMessageError as refusal:
                    self._refused[refusal.reason] += 1
                    self._note_misdated(sender_key, refusal.reason)
        for sender, link in self._lined:
            self._settle(sender, link, now)
        self._taken_until = now
        return self._hand_over(now) if self._waiting else []

    def verdicts(self) -> list[LinkVerdict]:
        """Return the verdicts put out since the last call."""
        out, self._verdicts = self._verdicts, []
        return out

    def complaints(self) -> list[str]:
        """Return the lines to say since the last call, about stamps that cannot be right."""
        said, self._complaints = self._complaints, []
        return said

    def rejections(self) -> list[tuple[str, int]]:
        """Return what was rejected since the last call: (reason, count)."""
        now = self.rejected
        new = now - self._reported
        self._reported = now
        return sorted(new.items())

    def _note_misdated(self, sender_key: str, reason: str) -> None:
        sender = self._senders.get(sender_key)
        if sender is not None and (line := self._misdated.count(sender, reason)):
            self._complaints.append(line)

    def _judge(self, sender_key: str, data: bytes, now: int) -> None:
        sender = self._senders.get(sender_key)
        if sender is None:
            raise RefusedMessageError("unknown", f"{self.receiver} does not listen to {sender_key}")
        link = self.links[sender]
        pose = link.gate.admit(data, now)
        message = pose.message
        if message.sent_at_ns < self._heard_from:  # while the vehicle did not receive
            return
        link.number(message.seq)
        antenna = Position(message.true_east_m, message.true_north_m, message.true_driven_m)
        here = self._places.at(message.sent_at_ns)
        context = TransmissionContext(message.seq, message.sent_at_ns, len(data), antenna, here)
        judged = link.link.judge(context)
        if link.content is not None:
            link.content.memory.note(message)
        late = judged.visible_at <= self._taken_until
        one = Transmission(pose, context, judged, late, pose)
        if link.line is not None:
            one.late = late or link.line.is_missed(context, self._taken_until)
            if not link.line.has_passed(context):
                link.line.join(context, judged)
                link.held[message.seq] = one
                return
        heappush(self._waiting, (judged.visible_at, sender, message.seq, 0, one))

    def _settle(self, sender: str, link: IncomingLink, now: int) -> None:
        """Let those of a line wait for their instant whose verdict is known now."""
        for context, judged in link.line.settle(now) if link.line else ():
            one = link.held.pop(context.seq)
            one.verdict = judged
            heappush(self._waiting, (judged.visible_at, sender, context.seq, 0, one))

    def _hand_over(self, now: int) -> list[ReceivedPose]:
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
                for further in link.content.arrive(one):
                    heappush(self._waiting, (further.at, sender, seq, further.nth, further.pose))
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
        """Whether the receiver uses a copy that the channel made of message `seq`."""
        if link.content is not None and link.content.filters:
            try:
                link.number(seq)
            except RefusedMessageError as refusal:
                self._refused[refusal.reason] += 1
                return False
        return True

    def _verdict_on(self, one: Transmission, now: int) -> LinkVerdict:
        """The message about what the link did to a pose, of what was sent."""
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
            heard_at_ns=now,
            late=one.late,
            sent_at_ns=sent.sent_at_ns,
            copies=one.copies,
            content=one.content,
        )


def _sent_after(data: bytes, now: int) -> bool:
    """Whether these are the bytes of a pose that was sent after `now` (ns)."""
    try:
        pose = decode(GPS, data, exact=True)
    except RefusedMessageError:
        return False
    return isinstance(pose, GpsPose) and pose.sent_at_ns > now
