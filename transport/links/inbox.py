"""What one vehicle hears: received bytes in, poses out when their links let them through."""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from heapq import heappop, heappush
from threading import Lock

from transport.codec import RefusedMessageError
from transport.links.admission import GPS, LONGEST_POSE_BYTES, Admission
from transport.links.link import Link, LinkRule, Verdict, effects
from transport.topics import key
from vehicles.messages import GpsPose, LinkVerdict

WINDOW = 8192
"""Sequence numbers that lie further behind a sender's newest are refused, so memory is bounded."""


@dataclass(slots=True)
class HeardLink:
    """One sender's link and what became of its messages so far.

    `delivered`, `dropped` (by reason) and `late` count verdicts put out; a late message is among
    the delivered or the dropped as well.
    """

    link: Link
    admission: Admission
    delivered: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    late: int = 0
    _newest: int = -1
    _seen: set[int] = field(default_factory=set)

    def check_new(self, seq: int) -> None:
        """Note that `seq` came; raises RefusedMessageError if it did before or is far behind."""
        if seq <= self._newest - WINDOW:
            raise RefusedMessageError("past", f"number {seq} is far behind {self._newest}")
        if seq in self._seen:
            raise RefusedMessageError("duplicate", f"number {seq} came before")
        self._seen.add(seq)
        self._newest = max(self._newest, seq)
        if len(self._seen) >= 2 * WINDOW:
            self._seen = {one for one in self._seen if one > self._newest - WINDOW}


class Inbox:
    """The ear of one vehicle: a rule per sender it listens to.

    All senders measure from `start_at` (ns) on, at `source_rate_hz`, one rate for all or one for
    each. Messages are judged and handed over in `take` alone, in the thread that calls it; only
    `on_bytes` may be called from another.

    A message is late if it came after the tick that should have judged it. `heard`, `dropped` and
    `late` count messages; `rejected` counts, by reason, those that no link had to judge; `overflow`
    counts those that newer ones pushed out before a tick took them. The reasons:

    garbage, oversized   not a pose           foreign    under another vehicle's key
    unknown              not listened to      absurd     numbers that no vehicle measures
    past, future         not of this run      sequence   numbered ahead of the schedule
    duplicate            came before
    """

    def __init__(
        self,
        receiver: str,
        links: Mapping[str, LinkRule],
        *,
        seed: int,
        start_at: int,
        source_rate_hz: float | Mapping[str, float],
    ) -> None:
        self.receiver = receiver
        self.links: dict[str, HeardLink] = {}
        for sender, rule in links.items():
            if isinstance(source_rate_hz, Mapping):
                rate_hz = source_rate_hz[sender]
            else:
                rate_hz = source_rate_hz
            link = Link(effects(rule, rate_hz), seed, sender, receiver)
            self.links[sender] = HeardLink(link, Admission(sender, start_at, rate_hz))
        self.rejected: Counter[str] = Counter()
        self.overflow = 0
        self._taken_until = start_at - 1
        self._arrived: deque[tuple[str, bytes]] = deque(maxlen=GPS.queue)
        self._lock = Lock()
        self._senders = {key(sender, GPS): sender for sender in links}
        self._waiting: list[tuple[int, str, int, Verdict, GpsPose, bool]] = []
        self._verdicts: list[LinkVerdict] = []
        self._verdict_seq = 0
        self._reported: Counter[str] = Counter()

    @property
    def keys(self) -> list[str]:
        """The keys to subscribe to."""
        return list(self._senders)

    @property
    def heard(self) -> int:
        """Poses handed over so far."""
        return sum(link.delivered for link in self.links.values())

    @property
    def dropped(self) -> int:
        """Poses that a link dropped so far."""
        return sum(link.dropped.total() for link in self.links.values())

    @property
    def late(self) -> int:
        """Poses so far that came after the tick that should have judged them."""
        return sum(link.late for link in self.links.values())

    def on_bytes(self, sender_key: str, data: bytes) -> None:
        """Take in a message as it comes from the bus; the oldest go when too many wait."""
        with self._lock:
            self.overflow += len(self._arrived) == self._arrived.maxlen
            # One byte too long is refused like a million, without keeping the million.
            self._arrived.append((sender_key, data[: LONGEST_POSE_BYTES + 1]))

    def take(self, now: int) -> list[GpsPose]:
        """Return the poses that have become visible by the tick at `now` (ns).

        They come in the order (visible_at, sender, seq). Instants must not go back. A verdict is
        put out, by `verdicts`, at the tick that hands a pose over, or would have handed it over.
        """
        if self._arrived:
            with self._lock:
                arrived, self._arrived = self._arrived, deque(maxlen=GPS.queue)
            for sender_key, data in arrived:
                try:
                    self._judge(sender_key, data, now)
                except RefusedMessageError as refusal:
                    self.rejected[refusal.reason] += 1
        self._taken_until = now
        return self._hand_over(now) if self._waiting else []

    def verdicts(self) -> list[LinkVerdict]:
        """Return the verdicts put out since the last call."""
        out, self._verdicts = self._verdicts, []
        return out

    def rejections(self) -> list[tuple[str, int]]:
        """Return what was rejected since the last call, overflow too: (reason, count)."""
        now = self.rejected + Counter(overflow=self.overflow)
        new = now - self._reported
        self._reported = now
        return sorted(new.items())

    def _judge(self, sender_key: str, data: bytes, now: int) -> None:
        sender = self._senders.get(sender_key)
        if sender is None:
            raise RefusedMessageError("unknown", f"{self.receiver} does not listen to {sender_key}")
        link = self.links[sender]
        pose = link.admission.admit(data, now)
        link.check_new(pose.seq)
        judged = link.link.judge(pose.seq, pose.measured_at_ns)
        late = judged.visible_at <= self._taken_until
        heappush(self._waiting, (judged.visible_at, sender, pose.seq, judged, pose, late))

    def _hand_over(self, now: int) -> list[GpsPose]:
        heard: list[GpsPose] = []
        while self._waiting and self._waiting[0][0] <= now:
            _, sender, _, judged, pose, late = heappop(self._waiting)
            link = self.links[sender]
            link.late += late
            if judged.outcome == "delivered":
                link.delivered += 1
                heard.append(pose)
            else:
                link.dropped[judged.reason] += 1
            self._verdicts.append(self._message(judged, pose, now, late=late))
        return heard

    def _message(self, judged: Verdict, pose: GpsPose, now: int, *, late: bool) -> LinkVerdict:
        seq, self._verdict_seq = self._verdict_seq, self._verdict_seq + 1
        return LinkVerdict(
            vehicle=self.receiver,
            seq=seq,
            sender=pose.vehicle,
            pose_seq=pose.seq,
            measured_at_ns=pose.measured_at_ns,
            outcome=judged.outcome,
            reason=judged.reason,
            visible_at_ns=judged.visible_at,
            heard_at_ns=now,
            late=late,
        )
