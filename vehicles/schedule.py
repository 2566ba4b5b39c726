"""Instants in integer nanoseconds: units, periodic schedules, timers."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

SECOND: Final = 1_000_000_000
MILLISECOND: Final = 1_000_000


def nanoseconds(seconds: float) -> int:
    return round(seconds * SECOND)


def instant(start_at: int, k: int, rate_hz: float) -> int:
    """Instant k (ns, k from 0) of a schedule of `rate_hz` that starts at `start_at` (ns)."""
    return start_at + round(k * SECOND / rate_hz)


def instants(start_at: int, end_at: int, rate_hz: float) -> Iterator[int]:
    """Yield the instants (ns) of a schedule of `rate_hz` from `start_at`, `end_at` excluded."""
    k = 0
    while (at := instant(start_at, k, rate_hz)) < end_at:
        yield at
        k += 1


@dataclass(slots=True)
class Cadence:
    """A periodic schedule."""

    start_at: int
    rate_hz: float
    _period: int = field(init=False)  # ns; 0 if not a whole number

    def __post_init__(self) -> None:
        whole = (SECOND / self.rate_hz).is_integer()
        self._period = int(SECOND / self.rate_hz) if whole else 0

    def index(self, now: int) -> int | None:
        """Index of `now` (ns) in the schedule; None if it is not an instant of the schedule."""
        elapsed = now - self.start_at
        if self._period:  # whole nanoseconds, as at 20 and 50 Hz
            return None if elapsed < 0 or elapsed % self._period else elapsed // self._period
        k = round(elapsed * self.rate_hz / SECOND)
        return k if k >= 0 and instant(self.start_at, k, self.rate_hz) == now else None

    def until(self, end_at: int) -> Iterator[int]:
        return instants(self.start_at, end_at, self.rate_hz)

    def due(self, now: int) -> bool:
        """Whether `now` (ns) is an instant of the schedule."""
        if self._period:
            return now >= self.start_at and (now - self.start_at) % self._period == 0
        return self.index(now) is not None


@dataclass(slots=True)
class Timer:
    """A timer that fires at most once per `period` (ns), when it is polled.

    It is due from `due_at` (ns). The next period starts when it fires, or with `steady` when it was
    due, so that periods do not drift with the times of polling.
    """

    period: int
    due_at: int = 0
    steady: bool = False

    def is_due(self, now: int) -> bool:
        """Whether the timer is due at `now` (ns); if so, it fires."""
        if now < self.due_at:
            return False
        self.due_at = (self.due_at if self.steady else now) + self.period
        return True
