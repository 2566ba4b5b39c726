"""Clocks and the ticks of a run.

Instants are integer nanoseconds of Unix time, durations are float seconds. A node receives
scheduled instants, never readings of the clock.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from math import inf
from typing import Protocol

from vehicles.schedule import MILLISECOND, SECOND, instants

LATE_SHARE_OF_PERIOD = 0.5
"""A tick is late if it begins more than this share of a control period after its instant."""
_LONGEST_SLEEP_NS = 50 * MILLISECOND


@dataclass(slots=True)
class Tick:
    """One step of the schedule at instant `at` (ns), `span_s` seconds before the next."""

    at: int
    span_s: float


class Clock(Protocol):
    """Wall or virtual time (ns)."""

    def now(self) -> int: ...

    def wait_until(self, at: int) -> int:
        """Wait for instant `at` and return the lateness in ns, negative if the clock stopped."""


class WallClock:
    """Unix time, read once and continued by the monotonic clock.

    Changes of the system clock therefore do not affect a run.
    """

    def __init__(
        self, is_stopped: Callable[[], bool] = lambda: False, offset: int | None = None
    ) -> None:
        """`is_stopped` ends a wait; `offset` (ns) is Unix time minus monotonic time.

        A restarted process takes the offset of its predecessor.
        """
        self._is_stopped = is_stopped
        self.offset = time.time_ns() - time.monotonic_ns() if offset is None else offset

    def now(self) -> int:
        return time.monotonic_ns() + self.offset

    def wait_until(self, at: int) -> int:
        # Sleep in slices: a signal handler cannot end an Event.wait() without taking its lock.
        while (remaining := at - self.now()) > 0 and not self._is_stopped():
            time.sleep(min(remaining, _LONGEST_SLEEP_NS) / SECOND)
        return -remaining


class VirtualClock:
    """Virtual time: jumps to the instant of each wait, so no tick is late."""

    def __init__(self, start_at: int) -> None:
        self._now = start_at

    def now(self) -> int:
        return self._now

    def wait_until(self, at: int) -> int:
        if at > self._now:
            self._now = at
        return self._now - at


def ticks(
    start_at: int, end_at: int, *rates_hz: float, more: Iterable[Iterable[int]] = ()
) -> Iterator[Tick]:
    """Yield the union of the instants of all rates; the last tick lasts until `end_at`.

    `more` are further series of ascending instants (ns), from `start_at` to before `end_at`.
    """
    series = [instants(start_at, end_at, rate_hz) for rate_hz in rates_hz]
    series += [iter(further) for further in more]
    following = [next(times, end_at) for times in series]
    at = min(following, default=end_at)
    while at < end_at:
        for index, times in enumerate(series):
            while following[index] <= at:
                following[index] = next(times, end_at)
        after = min(following)
        yield Tick(at, (after - at) / SECOND)
        at = after


def late_threshold(control_rate_hz: float) -> int:
    """Lateness (ns) above which a tick counts as late: 10 ms at 50 Hz."""
    return round(LATE_SHARE_OF_PERIOD * SECOND / control_rate_hz)


def poll(
    holds: Callable[[], bool],
    *,
    every_s: float,
    at_most_s: float = inf,
    sleep: Callable[[float], object] = time.sleep,
) -> bool:
    """Wait until a condition holds; returns False after `at_most_s`.

    For conditions set by signal handlers, which must not take the lock of an event.
    """
    give_up_at = time.monotonic() + at_most_s
    while not holds():
        if time.monotonic() >= give_up_at:
            return False
        sleep(every_s)
    return True
