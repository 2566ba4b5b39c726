"""Clocks and the ticks of a run.

Instants are integer nanoseconds of Unix time, durations are float seconds. A node receives
scheduled instants, never readings of the clock.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from math import inf
from threading import Event
from typing import Protocol

from vehicles.schedule import MILLISECOND, SECOND, instants

LATE_SHARE_OF_PERIOD = 0.5  # Lateness of a tick, in control periods, from which it is late
SLEW_NS = SECOND  # Shortest time over which a correction of the clock is spread
LARGEST_SLEW = 0.1  # Largest share by which a correction changes the speed of the clock
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


@dataclass(frozen=True, slots=True)
class SystemTime:
    """Reads the clocks of the system, `monotonic` and `unix` (ns), and waits.

    `sleep` takes s; `wait` waits for an event, at most a number of s.
    """

    monotonic: Callable[[], int] = time.monotonic_ns
    unix: Callable[[], int] = time.time_ns
    sleep: Callable[[float], object] = time.sleep
    wait: Callable[[Event, float], object] = Event.wait


SYSTEM_TIME = SystemTime()


@dataclass(frozen=True, slots=True)
class ClockSetting:
    """Unix time by the monotonic clock (ns), as a line from `begun` (monotonic ns) on.

    offset      Unix time minus monotonic time at `begun`
    corrected   part of `offset` by which the clock was corrected
    rate        share by which the clock runs faster than the monotonic clock, until corrected again
    slew        further share, until `slewed_until` (monotonic ns)
    """

    offset: int
    corrected: int = 0
    begun: int = 0
    rate: float = 0.0
    slew: float = 0.0
    slewed_until: int = 0

    def gained(self, monotonic: int) -> int:
        """Gain (ns) over the monotonic clock since `begun`."""
        if not self.rate and not self.slew:
            return 0
        slewed = min(monotonic, self.slewed_until) - self.begun
        return round((monotonic - self.begun) * self.rate + slewed * self.slew)

    def slewing(self, monotonic: int, correction: int, rate: float) -> "ClockSetting":
        """Add a correction (ns), spread over `SLEW_NS` or longer, and a rate."""
        gained = self.gained(monotonic)
        slewed_ns = max(SLEW_NS, round(abs(correction) / LARGEST_SLEW))
        return ClockSetting(
            offset=self.offset + gained,
            corrected=self.corrected + gained,
            begun=monotonic,
            rate=self.rate + rate,
            slew=correction / slewed_ns,
            slewed_until=monotonic + slewed_ns,
        )


class WallClock:
    """Unix time, read once and continued by the monotonic clock.

    Changes of the system clock therefore do not affect a run.
    """

    def __init__(
        self,
        is_stopped: Callable[[], bool] = lambda: False,
        setting: ClockSetting | None = None,
        system: SystemTime = SYSTEM_TIME,
    ) -> None:
        """`is_stopped` ends a wait; a restarted process takes the `setting` of its predecessor."""
        self._is_stopped = is_stopped
        self.monotonic = system.monotonic
        self._sleep = system.sleep
        # Replaced as a whole: other threads read the clock.
        if setting is None:
            setting = ClockSetting(system.unix() - system.monotonic())
        self.setting = setting

    def now(self) -> int:
        return self.at(self.monotonic())

    def at(self, monotonic: int) -> int:
        """Unix time (ns) at an instant of the monotonic clock (ns)."""
        setting = self.setting
        return monotonic + setting.offset + setting.gained(monotonic)

    @property
    def corrected(self) -> int:
        """Sum of all corrections so far (ns)."""
        setting = self.setting
        return setting.corrected + setting.gained(self.monotonic())

    def set_back(self, error: int) -> None:
        """Set the clock back by `error` (ns) at once, as before a run."""
        setting = self.setting
        self.setting = replace(
            setting, offset=setting.offset - error, corrected=setting.corrected - error
        )

    def slew(self, error: int, drift: float) -> None:
        """Remove an `error` (ns) gradually, and a `drift` (share) from now on.

        The clock never stops or leaps.
        """
        self.setting = self.setting.slewing(self.monotonic(), -error, -drift)

    def wait_until(self, at: int) -> int:
        # Sleep in slices: a signal handler cannot end an Event.wait() without taking its lock.
        while (remaining := at - self.now()) > 0 and not self._is_stopped():
            self._sleep(min(remaining, _LONGEST_SLEEP_NS) / SECOND)
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
    system: SystemTime = SYSTEM_TIME,
) -> bool:
    """Wait until a condition holds; returns False after `at_most_s`.

    For conditions set by signal handlers, which must not take the lock of an event.
    """
    begun = system.monotonic()
    while not holds():
        if system.monotonic() - begun >= at_most_s * SECOND:
            return False
        system.sleep(every_s)
    return True
