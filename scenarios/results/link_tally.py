"""Counts of one directed link during a run."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from transport.topics import counts_as_loss
from vehicles.messages import LinkVerdict, SourceStatus
from vehicles.schedule import MILLISECOND, SECOND

MOST_WORDS, OTHER_WORD = 50, "other"
"""Number of distinct reasons counted; further ones share OTHER_WORD."""
MOST_NUMBERS = 10_000_000
"""Message numbers whose fate is stored, a byte each: a day at 100 Hz."""
OLDEST_S = 86_400.0
"""Largest plausible age."""
LONGEST_NS = 3600 * SECOND
"""Delays beyond this are wrong time stamps."""
RESOLUTION_NS = MILLISECOND // 100
"""Resolution of counted delays and ages; sums are exact."""
MOST_ALARMS = 100_000
"""Stored instants of alarms of a link."""
_LOST, _DELIVERED, _NOT_CARRIED = 1, 2, 3


@dataclass(slots=True)
class LinkTally:
    """Fates of the messages of a link, and ages of its source at commands.

    `transport` counts the delays on the real transport, in multiples of RESOLUTION_NS; empty in
    virtual time. `changed`: its settings were changed during the run.
    """

    delivered: int = 0
    late: int = 0
    copies: int = 0
    reordered: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    false: Counter[str] = field(default_factory=Counter)
    latency_ns_sum: int = 0
    latency_ns_max: int = 0
    latencies: Counter[int] = field(default_factory=Counter)
    transport: Counter[int] = field(default_factory=Counter)
    arrival_gaps: Counter[int] = field(default_factory=Counter)
    ages: Counter[int] = field(default_factory=Counter)
    commands: int = 0
    changed: bool = False
    _fates: bytearray = field(default_factory=bytearray)
    _newest: int = -1
    _received_at: int | None = None

    def add(self, verdict: LinkVerdict) -> None:
        number = verdict.pose_seq
        if verdict.arrived_at_ns:
            self._add_transport(verdict.arrived_at_ns - verdict.sent_at_ns)
        if verdict.outcome == "dropped":
            self._count(self.dropped, verdict.reason)
            lost = counts_as_loss(verdict.reason)
            self._keep(number, _LOST if lost else _NOT_CARRIED)
            return
        if verdict.content:
            self._count(self.false, verdict.content)
        self._keep(number, _DELIVERED)
        late, received_at, before = verdict.late, verdict.received_at_ns, self._received_at
        self.delivered += 1
        self.late += late
        self.copies += verdict.copies
        if number < self._newest:
            self.reordered += 1
        else:
            self._newest = number
        latency = (received_at if late else verdict.visible_at_ns) - verdict.sent_at_ns
        self.latency_ns_sum += latency
        self.latency_ns_max = max(self.latency_ns_max, latency)
        self.latencies[latency // RESOLUTION_NS] += 1
        if before is not None and received_at > before:
            self.arrival_gaps[(received_at - before) // RESOLUTION_NS] += 1
        self._received_at = received_at

    def _add_transport(self, delay_ns: int) -> None:
        if abs(delay_ns) < LONGEST_NS:
            self.transport[delay_ns // RESOLUTION_NS] += 1

    def add_age(self, age_s: float) -> None:
        """Take the age (s) of the newest data at a command, NaN before the first.

        Ages outside of 0 to OLDEST_S count as not fresh.
        """
        self.commands += 1
        if 0.0 <= age_s <= OLDEST_S:
            self.ages[int(age_s * SECOND) // RESOLUTION_NS] += 1

    @property
    def fates(self) -> NDArray[np.uint8]:
        """Fate of each message by number, 0 without a verdict."""
        return np.frombuffer(bytes(self._fates), dtype=np.uint8)

    def lost(self, absent: Sequence[int] = ()) -> NDArray[np.bool_]:
        """Whether each carried message was lost, in the order of numbers.

        `absent` are the numbers that the real transport lost. Other messages without a verdict and
        those held back by the link's rate are left out.
        """
        fates = self.fates
        if absent:
            fates = np.pad(fates, (0, max(absent[-1] + 1 - len(fates), 0)))
            fates[list(absent)] = _LOST
        lost: NDArray[np.bool_] = fates[(fates == _LOST) | (fates == _DELIVERED)] == _LOST
        return lost

    def _keep(self, number: int, fate: int) -> None:
        if number >= MOST_NUMBERS:
            return
        fates = self._fates
        missing = number - len(fates)
        if not missing:  # as mostly
            fates.append(fate)
            return
        if missing > 0:
            fates.extend(bytes(missing + 1))
        fates[number] = fate

    @staticmethod
    def _count(words: Counter[str], word: str) -> None:
        words[word if word in words or len(words) < MOST_WORDS else OTHER_WORD] += 1


@dataclass(slots=True)
class AlarmTally:
    """Instants at which a follower began to count a source as lost."""

    instants: list[int] = field(default_factory=list)
    _status: SourceStatus = "unheard"
    _is_reported: bool = False

    def add(self, at: int, status: SourceStatus) -> None:
        is_lost = status == "lost" != self._status
        if is_lost and len(self.instants) < MOST_ALARMS:
            self.instants.append(at)
        self._is_reported |= status != "unheard"
        self._status = status

    def counted(self, until: int) -> int | None:
        """Count alarms up to an instant (ns) at which the sender still ran; None without status."""
        if not self._is_reported:
            return None
        return sum([at <= until for at in self.instants])
