"""Instants of a periodic schedule, in integer nanoseconds."""

from dataclasses import dataclass, field

SECOND = 1_000_000_000
"""Nanoseconds in a second."""


def instant(start_at: int, k: int, rate_hz: float) -> int:
    """k-th instant (ns, from 0) of a schedule of `rate_hz` that starts at `start_at` (ns)."""
    return start_at + round(k * SECOND / rate_hz)


@dataclass(frozen=True, slots=True)
class Cadence:
    """A periodic schedule: which instants belong to it."""

    start_at: int
    rate_hz: float
    _period: int = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Work out the period (ns), 0 if it is not whole."""
        whole = (SECOND / self.rate_hz).is_integer()
        object.__setattr__(self, "_period", int(SECOND / self.rate_hz) if whole else 0)

    def index(self, now: int) -> int | None:
        """Number of the instant `now` (ns) in the schedule, None if it is not one of it."""
        since = now - self.start_at
        if self._period:  # whole nanoseconds, as at 20 and 50 Hz
            return None if since < 0 or since % self._period else since // self._period
        k = round(since * self.rate_hz / SECOND)
        return k if k >= 0 and instant(self.start_at, k, self.rate_hz) == now else None

    def due(self, now: int) -> bool:
        """Whether `now` (ns) is one of the instants."""
        return self.index(now) is not None
