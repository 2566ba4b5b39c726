"""Instants in integer nanoseconds: units, periodic schedules, timers."""

from collections.abc import Iterator
from dataclasses import dataclass
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


@dataclass(frozen=True, slots=True)
class Cadence:
    """A periodic schedule."""

    start_at: int
    rate_hz: float

    def index(self, now: int) -> int | None:
        """Index of `now` (ns) in the schedule; None if it is not an instant of the schedule."""
        k = round((now - self.start_at) * self.rate_hz / SECOND)
        is_instant = now == self.start_at + round(k * SECOND / self.rate_hz)
        return k if is_instant and k >= 0 else None

    def until(self, end_at: int) -> Iterator[int]:
        return instants(self.start_at, end_at, self.rate_hz)

    def due(self, now: int) -> bool:
        """Whether `now` (ns) is an instant of the schedule."""
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
