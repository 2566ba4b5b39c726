"""What has come of a source of late: how often it sends, how much of it arrives, for how long not.

SI units; instants in ns.
"""

from collections import deque
from math import nan
from typing import Final, NamedTuple

from vehicles.schedule import SECOND

RECENT: Final = SECOND
"""What came within this time (ns) is counted, and tells the period."""
USUAL_TIME: Final = 10.0
"""Time (s) over which the usual share is a mean, once so much has been seen."""


class _Received(NamedTuple):
    heard_at: int
    measured_at: int
    seq: int


class Reception:
    """The messages of one source as they came (beyond the paper, whose messages always come).

    The period at which they are expected is what lies between two in the sender's own time, over
    what lies between their numbers, so that what is lost on the way does not stretch it.
    """

    def __init__(self, period: float) -> None:
        """`period` (s) is that between the messages that can come, as far as that is known."""
        self._least_period = period
        self.period = period
        self.usual_share = nan
        self._recent: deque[_Received] = deque()
        self._highest = -1
        self._heard_at: deque[int] = deque()
        self._first_at = 0
        self._newest_at: int | None = None
        self._newest_measured_at = 0
        self._counted_until = 0
        self._counted = 0.0

    def add(self, now: int, measured_at: int, seq: int) -> bool:
        """Take in a message heard at `now`; returns whether it is the newest by its time stamp.

        One that came before, by its number, does not count.
        """
        if seq > self._highest:
            self._highest = seq
        elif seq in [one.seq for one in self._recent]:
            return False
        arrival = _Received(now, measured_at, seq)
        self._heard_at.append(now)
        if self._newest_at is None:
            self._first_at = self._counted_until = now
        elif measured_at <= self._newest_measured_at:
            self._recent.insert(max(len(self._recent) - 1, 0), arrival)
            return False
        self._newest_at, self._newest_measured_at = now, measured_at
        self._recent.append(arrival)
        self._drop_old(now)
        self._learn_period()
        return True

    def forget(self) -> None:
        """Forget what came: what lies on both sides of a long silence is no period."""
        self._recent.clear()
        self._heard_at.clear()

    def silence(self, now: int) -> float:
        """Time (s) since a newer message was heard, NaN before the first.

        Not since it was measured: a latency is no silence.
        """
        return nan if self._newest_at is None else (now - self._newest_at) / SECOND

    def share(self, now: int) -> float:
        """Share of the messages of the last second that came, NaN before any.

        Within a second of the first message, of those since then.
        """
        if self._newest_at is None:
            return nan
        share = self._came(now) / self._expected(now)
        return 1.0 if share > 1.0 else share

    def delivers(self, now: int, share: float) -> bool:
        """Whether at least `share` of what usually comes did so in the last second.

        But for one message, which may have come just before or just after.
        """
        return self._came(now) + 1 >= share * self.usual_share * self._expected(now)

    def count_share(self, now: int, share: float) -> None:
        """Let the `share` of the last second count for the usual one."""
        span = (now - self._counted_until) / SECOND
        self._counted_until = now
        if span <= 0.0:
            return
        counted = self._counted + span
        self._counted = USUAL_TIME if counted > USUAL_TIME else counted
        before = 0.0 if self._counted == span else self.usual_share
        self.usual_share = before + (share - before) * span / self._counted

    def pause_count(self, now: int) -> None:
        """Let the time until `now` not count for the usual share."""
        self._counted_until = now

    def _came(self, now: int) -> int:
        """Messages of the last second; those before it are not asked for any more."""
        since, heard_at = now - RECENT, self._heard_at
        while heard_at and heard_at[0] <= since:
            heard_at.popleft()
        return len(heard_at)

    def _expected(self, now: int) -> float:
        since = now - self._first_at
        expected = (RECENT if since > RECENT else since) / SECOND / self.period
        return 1.0 if expected < 1.0 else expected

    def _drop_old(self, now: int) -> None:
        """Keep what came of late, at least two messages."""
        while len(self._recent) > 2 and self._recent[0].heard_at <= now - RECENT:
            self._recent.popleft()

    def _learn_period(self) -> None:
        first, last = self._recent[0], self._recent[-1]
        numbers = last.seq - first.seq
        if numbers > 0:
            spacing = (last.measured_at - first.measured_at) / SECOND / numbers
            self.period = max(spacing, self._least_period)
        elif numbers < 0:  # the sender began anew
            self._recent.clear()
            self._recent.append(last)
            self._heard_at.clear()
            self._heard_at.append(last.heard_at)
