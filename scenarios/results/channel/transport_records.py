"""What the log shows of the real transport: sending and receiving of each vehicle."""

from array import array
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from scenarios.results.channel.link_tally import LONGEST_NS, MOST_NUMBERS, RESOLUTION_NS
from scenarios.results.holes import RecordedSeries
from vehicles.messages import LinkVerdict, Tracking
from vehicles.schedule import SECOND

AWAY_NS = SECOND
"""A vehicle whose pose reached the recorder later than this, or not at all, was away."""
FOREVER = 2**63 - 1
"""After every instant (ns)."""
_UNKNOWN = -1

Instants = NDArray[np.int64]


class SentPoses:
    """Poses of one vehicle by number: instants of sending, and their delays to the recorder.

    `delays` counts delays in multiples of RESOLUTION_NS. `is_physical`: a delay differed from 0, as
    in no virtual run.
    """

    def __init__(self) -> None:
        self._sent_at = array("q")
        self._held: set[int] = set()
        self.is_physical = False
        self.delays: Counter[int] = Counter()

    def __len__(self) -> int:
        """Count the messages up to the newest recorded one."""
        return len(self._sent_at)

    def add(self, number: int, sent_at: int, recorded_at: int) -> None:
        """Take a recorded pose; instants are ns."""
        if number >= MOST_NUMBERS:
            return
        missing = number - len(self._sent_at)
        if missing >= 0:
            self._sent_at.extend([_UNKNOWN] * missing)
            self._sent_at.append(sent_at)
        else:
            self._sent_at[number] = sent_at
        if delay := recorded_at - sent_at:
            self.is_physical = True
            if -LONGEST_NS < delay < LONGEST_NS:
                self.delays[delay // RESOLUTION_NS] += 1
            if delay > AWAY_NS:
                self._held.add(number)

    def instants(self, count: int) -> Instants:
        """Instants (ns) of sending of the first `count` messages; interpolated where not recorded.

        Without any recorded pose they are 0.
        """
        given = np.array(self._sent_at, dtype=np.int64)
        (known,) = np.nonzero(given != _UNKNOWN)
        if not len(known):
            return np.zeros(count, dtype=np.int64)
        numbers, first = np.arange(count), int(given[known[0]])
        since = np.interp(numbers, known, given[known] - first)
        beyond = numbers - known[-1]
        if len(known) > 1 and count > known[-1]:
            period = float(np.median(np.diff(given[known]) / np.diff(known)))
            since[beyond > 0] += period * beyond[beyond > 0]
        result: Instants = first + np.round(since).astype(np.int64)
        exact = known[known < count]
        result[exact] = given[exact]
        return result

    @property
    def end_late(self) -> bool:
        """Whether the newest pose was later than AWAY_NS."""
        return len(self._sent_at) - 1 in self._held

    def late_span(self) -> tuple[int, int] | None:
        """Instants (ns) of sending of the first and the last pose that was later than AWAY_NS."""
        if not self._held:
            return None
        return self._sent_at[min(self._held)], self._sent_at[max(self._held)]

    def away(self) -> NDArray[np.bool_]:
        """Whether each message up to the newest was not recorded, or later than AWAY_NS."""
        away: NDArray[np.bool_] = np.array(self._sent_at, dtype=np.int64) == _UNKNOWN
        away[sorted(self._held)] = True
        return away


class ReceiverRecord:
    """Verdicts and decisions of one receiver: where they are missing, and where it did not run."""

    def __init__(self, longest_step_ns: int) -> None:
        """A longer time than `longest_step_ns` between two decisions means that it did not run."""
        self.longest_step_ns = longest_step_ns
        self._next_decision = 0
        self.decided_at: int | None = None
        self.down: list[tuple[int, int]] = []
        """Spans (ns) between two decisions in which its software did not run."""
        self.verdicts = RecordedSeries()

    def begin(self, start_at: int) -> None:
        """Set the start of the run (ns), at which the first decision is due."""
        if self.decided_at is None:
            self.decided_at = start_at

    def add_verdict(self, verdict: LinkVerdict) -> None:
        self.verdicts.add(verdict.seq, verdict.received_at_ns)

    def add_tracking(self, tracking: Tracking) -> None:
        at, before = tracking.decided_at_ns, self.decided_at
        is_next = tracking.seq == self._next_decision
        if is_next and before is not None and at - before > self.longest_step_ns:
            self.down.append((before, at))
        self._next_decision = tracking.seq + 1
        self.decided_at = at

    def holes(self, count: int) -> list[tuple[int, int, int]]:
        """Spans (ns) with missing verdicts, each with their number, of `count` in all."""
        return list(self.verdicts.spans(count, 0, FOREVER))
