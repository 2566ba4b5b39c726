"""Instants in integer nanoseconds: their units, periodic schedules, and what is due."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

SECOND: Final = 1_000_000_000
"""Nanoseconds in a second."""

MILLISECOND: Final = 1_000_000
"""Nanoseconds in a millisecond."""


def nanoseconds(seconds: float) -> int:
    """Span in ns, to the nearest."""
    return round(seconds * SECOND)


def instant(start_at: int, k: int, rate_hz: float) -> int:
    """k-th instant (ns, from 0) of a schedule of `rate_hz` that starts at `start_at` (ns)."""
    return start_at + round(k * SECOND / rate_hz)


def instants(start_at: int, end_at: int, rate_hz: float) -> Iterator[int]:
    """Yield the instants (ns) of a schedule of `rate_hz` from `start_at` on, before `end_at`.

    A duration that is a whole number of periods has duration x rate of them: the end itself, where
    the next one would lie, does not belong.
    """
    k = 0
    while (at := instant(start_at, k, rate_hz)) < end_at:
        yield at
        k += 1


@dataclass(slots=True)
class Cadence:
    """A periodic schedule: which instants belong to it."""

    start_at: int
    rate_hz: float
    _period: int = field(init=False)

    def __post_init__(self) -> None:
        """Work out the period (ns), 0 if it is not whole."""
        whole = (SECOND / self.rate_hz).is_integer()
        self._period = int(SECOND / self.rate_hz) if whole else 0

    def index(self, now: int) -> int | None:
        """Number of the instant `now` (ns) in the schedule, None if it is not one of it."""
        since = now - self.start_at
        if self._period:  # whole nanoseconds, as at 20 and 50 Hz
            return None if since < 0 or since % self._period else since // self._period
        k = round(since * self.rate_hz / SECOND)
        return k if k >= 0 and instant(self.start_at, k, self.rate_hz) == now else None

    def until(self, end_at: int) -> Iterator[int]:
        """Instants (ns) from the start on, before `end_at`."""
        return instants(self.start_at, end_at, self.rate_hz)

    def due(self, now: int) -> bool:
        """Whether `now` (ns) is one of the instants."""
        if self._period:
            return now >= self.start_at and (now - self.start_at) % self._period == 0
        return self.index(now) is not None


@dataclass(slots=True)
class Timer:
    """Something done every `period` (ns) at most, at the instants at which somebody asks.

    It is due from the instant `due_at` (ns) on. Once done it is due a period later, counted from
    when it was done, or with `steady` from when it was due, so that no period is stretched.
    """

    period: int
    due_at: int = 0
    steady: bool = False

    def is_due(self, now: int) -> bool:
        """Whether it is due at `now` (ns); if so, it counts as done."""
        if now < self.due_at:
            return False
        self.due_at = (self.due_at if self.steady else now) + self.period
        return True
