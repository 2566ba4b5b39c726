"""What one vehicle hears: received bytes in, poses out when their links let them through."""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from heapq import heappop, heappush
from threading import Lock

from transport.admission import GPS, LONGEST_POSE_BYTES, Admission
from transport.codec import RefusedMessageError
from transport.link import LinkRule, Verdict, verdict
from transport.topics import key
from vehicles.messages import GpsPose, LinkVerdict

WINDOW = 8192
"""Sequence numbers that lie further behind a sender's newest are refused, so memory is bounded."""


@dataclass(slots=True)
class LinkCount:
    """What became of one sender's messages, beside the rule that was asked for.

    delivered, dropped (by reason), late and delay_ns_sum count the verdicts that were put out so
    far; late ones are among delivered or dropped. `arrived` counts distinct messages that came,
    `missing` those that a later one came without.
    """

    sender: str
    rule: LinkRule
    arrived: int = 0
    missing: int = 0
    duplicates: int = 0
    delivered: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    late: int = 0
    delay_ns_sum: int = 0

    @property
    def loss_ratio(self) -> float:
        """Share lost of the messages that the link's rate let onto it; 0 when there were none."""
        lost = self.dropped["loss"]
        carried = self.delivered + lost
        return lost / carried if carried else 0.0

    @property
    def delay_ms_mean(self) -> float:
        """Mean time from measurement to the instant of becoming visible; 0 with none delivered."""
        return self.delay_ns_sum / self.delivered / 1e6 if self.delivered else 0.0


class _Sequence:
    """Which sequence numbers of one sender have come: the newest `WINDOW` of them, at most."""

    def __init__(self) -> None:
        self.newest = -1
        self._seen: set[int] = set()

    def add(self, seq: int) -> bool:
        """Note `seq`; False when it came before. Raises RefusedMessageError when too far back."""
        if seq <= self.newest - WINDOW:
            raise RefusedMessageError("past", f"number {seq} lies far behind {self.newest}")
        if seq in self._seen:
            return False
        self._seen.add(seq)
        self.newest = max(self.newest, seq)
        if len(self._seen) >= 2 * WINDOW:
            self._seen = {one for one in self._seen if one > self.newest - WINDOW}
        return True


class Inbox:
    """The ear of one vehicle: a rule per sender it listens to.

    `start_at` (ns) and `source_rate_hz` are the schedule on which all senders measure. Only
    `on_bytes` may be called from another thread.
    """

    def __init__(
        self,
        receiver: str,
        links: Mapping[str, LinkRule],
        *,
        seed: int,
        start_at: int,
        source_rate_hz: float,
    ) -> None:
        self.receiver = receiver
        self.links = {sender: LinkCount(sender, rule) for sender, rule in links.items()}
        self.rejected: Counter[str] = Counter()
        self.overflow = 0
        self._seed = seed
        self._source_rate_hz = source_rate_hz
        self._admission = Admission(start_at, source_rate_hz)
        self._heard_until = start_at - 1
        self._arrived: deque[tuple[str, bytes]] = deque(maxlen=GPS.queue)
        self._lock = Lock()
        self._sequences = {sender: _Sequence() for sender in links}
        self._waiting: list[tuple[int, str, int, Verdict, GpsPose, bool]] = []
        self._verdicts: list[LinkVerdict] = []
        self._verdict_seq = 0
        self._rejected_before: Counter[str] = Counter()

    @property
    def keys(self) -> list[str]:
        """The keys to subscribe to."""
        return [key(sender, GPS) for sender in self.links]

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
        with self._lock:
            arrived, self._arrived = self._arrived, deque(maxlen=GPS.queue)
        for sender_key, data in arrived:
            try:
                self._judge(self._admission.admit(sender_key, data, now))
            except RefusedMessageError as refusal:
                self.rejected[refusal.reason] += 1
        self._heard_until = now
        return self._hand_over(now)

    def verdicts(self) -> list[LinkVerdict]:
        """Return the verdicts put out since the last call."""
        out, self._verdicts = self._verdicts, []
        return out

    def rejections(self) -> list[tuple[str, int]]:
        """Return what was rejected since the last call: (reason, count), overflow among them."""
        now = self.rejected + Counter(overflow=self.overflow)
        new = now - self._rejected_before
        self._rejected_before = now
        return sorted(new.items())

    def _judge(self, pose: GpsPose) -> None:
        link = self.links.get(pose.vehicle)
        if link is None:
            raise RefusedMessageError("unknown", f"{self.receiver} does not listen to it")
        sequence = self._sequences[pose.vehicle]
        if not sequence.add(pose.seq):
            link.duplicates += 1
            return
        link.arrived += 1
        link.missing = sequence.newest + 1 - link.arrived
        judged = verdict(
            link.rule,
            source_rate_hz=self._source_rate_hz,
            seed=self._seed,
            sender=pose.vehicle,
            receiver=self.receiver,
            seq=pose.seq,
            measured_at=pose.measured_at_ns,
        )
        late = judged.visible_at <= self._heard_until
        heappush(self._waiting, (judged.visible_at, pose.vehicle, pose.seq, judged, pose, late))

    def _hand_over(self, now: int) -> list[GpsPose]:
        heard: list[GpsPose] = []
        while self._waiting and self._waiting[0][0] <= now:
            _, sender, _, judged, pose, late = heappop(self._waiting)
            link = self.links[sender]
            link.late += late
            if judged.outcome == "delivered":
                link.delivered += 1
                link.delay_ns_sum += judged.visible_at - pose.measured_at_ns
                heard.append(pose)
            else:
                link.dropped[judged.reason] += 1
            self._verdicts.append(self._verdict_message(judged, pose, now, late=late))
        return heard

    def _verdict_message(
        self, judged: Verdict, pose: GpsPose, now: int, *, late: bool
    ) -> LinkVerdict:
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
