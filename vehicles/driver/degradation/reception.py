"""Reception of a source: period, share and age of its messages, probation after a loss.

SI units; instants in ns.
"""

from collections import deque
from math import exp, isnan, nan
from typing import Final, NamedTuple

from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.degradation.situation import LOST, SourceFreshness
from vehicles.schedule import SECOND

RECENT: Final = SECOND  # Time (ns) over which arrivals are counted and the period is estimated
SHARE_TIME: Final = 10.0  # Averaging time (s) of the usual share
CLOSING_RATE: Final = 0.1  # An opened gap closes again at this share of the own speed
CLOSING_TIME: Final = 3.0  # Time constant (s) of a wide gap, as after a stop of a minute
AGE_WEIGHT: Final = 0.05  # Weight of a new message in the usual age of messages at reception


class _Arrival(NamedTuple):
    received_at: int
    measured_at: int
    seq: int


class Reception:
    """Statistics of the messages of one source that arrived in the last second.

    The period is the time between two stamps divided by the difference of their sequence numbers,
    so losses do not stretch it.
    """

    def __init__(self, period: float) -> None:
        """`period` (s) is the shortest expected one."""
        self._least_period = period
        self.period = period
        self.usual_share = nan
        self._recent: deque[_Arrival] = deque()
        self._highest = -1
        self._received_at: deque[int] = deque()
        self._first_at = 0
        self._newest_at: int | None = None
        self._newest_measured_at = 0
        self._counted_until = 0
        self._counted = 0.0

    def add(self, now: int, measured_at: int, seq: int) -> bool:
        """Count a message received at `now`, unless its number is repeated.

        Returns whether it is the newest by its stamp.
        """
        if seq > self._highest:
            self._highest = seq
        elif seq in [arrival.seq for arrival in self._recent]:
            return False
        recent, arrival = self._recent, _Arrival(now, measured_at, seq)
        self._received_at.append(now)
        if self._newest_at is None:
            self._first_at = self._counted_until = now
        elif measured_at <= self._newest_measured_at:
            recent.insert(max(len(recent) - 1, 0), arrival)
            return False
        self._newest_at, self._newest_measured_at = now, measured_at
        recent.append(arrival)
        while len(recent) > 2 and recent[0].received_at <= now - RECENT:
            recent.popleft()
        self._learn_period()
        return True

    def reset(self) -> None:
        self._recent.clear()
        self._received_at.clear()

    def silence(self, now: int) -> float:
        """Time (s) since a newer message was received (not measured), NaN before the first."""
        return nan if self._newest_at is None else (now - self._newest_at) / SECOND

    def share(self, now: int) -> float:
        """Received share of the expected messages of the last second, NaN before the first."""
        if self._newest_at is None:
            return nan
        received, expected = self._counts(now)
        share = received / expected
        return 1.0 if share > 1.0 else share

    def delivers(self, now: int, share: float) -> bool:
        """Whether `share` of the usual messages arrived in the last second; one may be missing."""
        received, expected = self._counts(now)
        return received + 1 >= share * self.usual_share * expected

    def update_usual_share(self, now: int, share: float) -> None:
        span = (now - self._counted_until) / SECOND
        self._counted_until = now
        if span <= 0.0:
            return
        counted = self._counted + span
        self._counted = SHARE_TIME if counted > SHARE_TIME else counted
        before = 0.0 if self._counted == span else self.usual_share
        self.usual_share = before + (share - before) * span / self._counted

    def skip_usual_share(self, now: int) -> None:
        self._counted_until = now

    def _counts(self, now: int) -> tuple[int, float]:
        since, received_at = now - RECENT, self._received_at
        while received_at and received_at[0] <= since:
            received_at.popleft()
        span = now - self._first_at
        expected = (RECENT if span > RECENT else span) / SECOND / self.period
        return len(received_at), 1.0 if expected < 1.0 else expected

    def _learn_period(self) -> None:
        first, last = self._recent[0], self._recent[-1]
        numbers = last.seq - first.seq
        if numbers > 0:
            spacing = (last.measured_at - first.measured_at) / SECOND / numbers
            self.period = max(spacing, self._least_period)
        elif numbers < 0:  # the sender has restarted
            self._recent.clear()
            self._recent.append(last)
            self._received_at.clear()
            self._received_at.append(last.received_at)


class Probation:
    """Time for which a source must be received before it is relied on again.

    It doubles with each relapse and halves after each `probation_halving` without one, similar to
    PX4's estimator EKF2.
    """

    def __init__(self, settings: DegradationSettings) -> None:
        self._settings = settings
        self._next = settings.probation
        self._trusted_at: int | None = None
        self._began_at = 0
        self.length = settings.probation

    def fail(self, now: int) -> None:
        """Lengthen the next probation: the source was lost or refused at `now` (ns)."""
        settings = self._settings
        if self._trusted_at is not None:
            healthy = (now - self._trusted_at) / SECOND
            halvings = min(int(healthy / settings.probation_halving), 64)
            self._next = max(self._next * 0.5**halvings, settings.probation)
            self._trusted_at = None
        self.length = self._next
        self._next = min(2.0 * self.length, max(settings.probation_max, settings.probation))

    def begin(self, now: int) -> None:
        self._began_at = now

    def served(self, now: int) -> float:
        return (now - self._began_at) / SECOND  # s

    def end(self, now: int) -> None:
        self._trusted_at = now


class AgeWatch:
    """Age of the predecessor's newest sample beyond the usual age, and its recent maximum."""

    def __init__(self, settings: DegradationSettings, period: float) -> None:
        """`period` (s) is the time between messages until it is estimated."""
        self._settings = settings
        self._period = period
        self._usual = 0.0
        self._measured_at: int | None = None
        self._late_at: int | None = None
        self._peak, self._peak_at = 0.0, 0

    @property
    def usual(self) -> float:
        """Largest expected age (s): that at reception, plus a period."""
        return self._usual + self._period

    def observe(self, now: int, age: float, source: SourceFreshness) -> None:
        settings = self._settings
        if not isnan(source.period):
            self._period = source.period
        measured_at = now - round(age * SECOND)
        if not isnan(source.age) and measured_at != self._measured_at:
            first = self._measured_at is None
            self._measured_at = measured_at
            self._usual = age if first else self._usual + AGE_WEIGHT * (age - self._usual)
        if source.status in LOST or age > self._usual + settings.late_periods * self._period:
            self._late_at = now
            growth = max(age - self.usual, 0.0)
            if growth >= self.growth(now):
                self._peak, self._peak_at = growth, now

    def is_new_peak(self, now: int) -> bool:
        """Whether the newest sample at `now` (ns) is late, and older than any recent one."""
        return self._peak_at == now

    def is_recently_late(self, now: int) -> bool:
        """Whether messages are late at `now` (ns), or were so less than a probation ago."""
        if self._late_at is None:
            return False
        return now - self._late_at <= self._settings.probation * SECOND

    def growth(self, now: int) -> float:
        """Recent maximum (s) of the age beyond the usual age; it decays, so gaps do not pump."""
        if not self._peak:
            return 0.0
        since = (now - self._peak_at) / SECOND - self._settings.probation
        since = max(since, 0.0)
        return max(self._peak * exp(-since / CLOSING_TIME) - CLOSING_RATE * since, 0.0)
