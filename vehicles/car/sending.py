"""When a vehicle sends which of its fixes: apart from when it measures.

At an instant of sending the newest fix goes out, and none goes out twice: where there is no newer
one than was sent last, nothing is sent, and the instant is lost.

The rule of cooperative awareness messages is that of ETSI EN 302 637-2, Section 6.1.3; reactive
congestion control that of ETSI TS 102 687 V1.2.1, Annex A.1, as open implementations code them.
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import accumulate
from math import degrees, hypot
from typing import Final, Protocol

from numpy.random import Generator

from vehicles.car.gnss import Fix
from vehicles.geometry.geodesy import wrap_angle
from vehicles.schedule import MILLISECOND, SECOND, Cadence, nanoseconds

LONG_AGO: Final = -(2**62)
"""An instant (ns) before every run."""
ROUNDING: Final = 1000
"""Instants are rounded to 1 ns: a span may be shorter than asked for by so much (ns)."""

HEADING: Final = 4.0
POSITION: Final = 4.0
SPEED: Final = 0.5
"""A change of more than so many degrees, metres, or m/s since the last message asks for another
(EN 302 637-2)."""
SHORTEST: Final = 100 * MILLISECOND
LONGEST: Final = 1000 * MILLISECOND
"""Least and greatest interval (ns) of cooperative awareness messages (EN 302 637-2)."""
REPEATS: Final = 3
"""So many messages keep the interval after which the last change asked for one (EN 302 637-2)."""

BUSY = (0.0, 0.30, 0.40, 0.50, 0.60)
"""Channel busy ratios from which on the states of congestion control hold (TS 102 687)."""
QUIET = tuple(span * MILLISECOND for span in (100, 200, 400, 500, 1000))
"""Least time (ns) between two messages in each of them (TS 102 687)."""

FARTHEST: Final = 3.0
"""Jitter of drawn intervals is normal, cut at so many standard deviations."""


class SendingRule(Protocol):
    """Decides on the instants at which a vehicle wants to send (EN 302 637-2 or simpler)."""

    def due(self, now: int, waiting: Fix | None, opens: int) -> bool:
        """Whether `now` (ns) is an instant of sending (EN 302 637-2 or simpler).

        `waiting` is the newest fix that was not sent, `opens` (ns) from when on congestion control
        lets something through.
        """
        ...

    def sent(self, now: int, fix: Fix) -> None:
        """Take note of what was sent at `now` (ns) (EN 302 637-2)."""
        ...


class EveryFix:
    """Each fix as soon as it is known: Section III-A, where what is measured is broadcast."""

    def due(self, now: int, waiting: Fix | None, opens: int) -> bool:
        """Whether there is one, and it may be sent (Section III-A)."""
        return waiting is not None and now >= opens

    def sent(self, now: int, fix: Fix) -> None:
        """Nothing depends on what was sent (Section III-A)."""


@dataclass(frozen=True, slots=True)
class FixedRate:
    """At a rate of its own, whatever that of Section III-A's receiver; too soon is passed over."""

    cadence: Cadence

    def due(self, now: int, waiting: Fix | None, opens: int) -> bool:  # noqa: ARG002
        """Whether it is an instant of the schedule."""
        return now >= opens and self.cadence.due(now)

    def sent(self, now: int, fix: Fix) -> None:
        """Nothing depends on what was sent."""


def profile_instants(profile: Sequence[tuple[float, float]]) -> Iterator[int]:
    """Instants (ns) of a rate that changes: `profile` has times (s) and the rate (Hz) from then on.

    Where the integral of the rate is a whole number, so a change of rate changes what is left of
    the period that is on. Before the first time nothing is sent.
    """
    turns = Fraction(0)
    wanted = 0
    ends = [*(nanoseconds(at) for at, _ in profile[1:]), None]
    for (at_s, rate_hz), end in zip(profile, ends, strict=True):
        if rate_hz <= 0.0:
            continue
        at, rate = nanoseconds(at_s), Fraction(rate_hz) / SECOND
        while True:
            instant = at + (wanted - turns) / rate
            if end is not None and instant >= end:
                turns += (end - at) * rate
                break
            yield round(instant)
            wanted += 1


class Profile:
    """At a rate that changes over time; an instant too soon is passed over."""

    def __init__(self, profile: Sequence[tuple[float, float]], start_at: int) -> None:
        """`profile` as `profile_instants` takes it, from `start_at` (ns) on."""
        self._instants = profile_instants(profile)
        self._start_at = start_at
        self._next = self._following()

    def _following(self) -> int | None:
        instant = next(self._instants, None)
        return None if instant is None else self._start_at + instant

    def due(self, now: int, waiting: Fix | None, opens: int) -> bool:  # noqa: ARG002
        """Whether it is one of the instants."""
        found = False
        while self._next is not None and self._next <= now:
            found = self._next == now
            self._next = self._following()
        return found and now >= opens

    def sent(self, now: int, fix: Fix) -> None:
        """Nothing depends on what was sent."""


class CooperativeAwareness:
    """The rule of EN 302 637-2, Section 6.1.3, on the newest fix at each instant of checking.

    A message is due if heading, position or speed have changed enough since the last one, and at
    the latest after the interval that the last such change took; after three in a row that came by
    time alone, each second.
    """

    def __init__(self, checks: Cadence) -> None:
        """`checks` are at most 100 ms apart."""
        self._checks = checks
        self._last: Fix | None = None
        self._sent_at = LONG_AGO
        self._interval = LONGEST
        self._by_time = 0
        self._changed = False

    def due(self, now: int, waiting: Fix | None, opens: int) -> bool:
        """Whether the rule asks for a message (EN 302 637-2, Section 6.1.3)."""
        if waiting is None or now < opens or not self._checks.due(now):
            return False
        elapsed = now - self._sent_at + ROUNDING
        self._changed = self._last is not None and _has_changed(self._last, waiting)
        return elapsed >= (SHORTEST if self._changed else self._interval)

    def sent(self, now: int, fix: Fix) -> None:
        """Set the interval after which the next message is due (EN 302 637-2, Section 6.1.3)."""
        if self._changed:
            self._interval, self._by_time = min(now - self._sent_at, LONGEST), 0
        elif self._last is not None:
            self._by_time += 1
            if self._by_time >= REPEATS:
                self._interval = LONGEST
        self._last, self._sent_at = fix, now


def _has_changed(last: Fix, now: Fix) -> bool:
    return (
        abs(degrees(wrap_angle(now.yaw - last.yaw))) > HEADING
        or hypot(now.east - last.east, now.north - last.north) > POSITION
        or abs(now.speed - last.speed) > SPEED
    )


@dataclass(slots=True)
class Shares:
    """Intervals (ns) and how often each of them comes, in any unit; jitter (ns) about them.

    Molina-Masegosa et al. (2020) measured such a distribution; shares are taken of their sum.
    """

    intervals: Sequence[int]
    shares: Sequence[float]
    jitter: int
    _sums: list[float] = field(init=False)

    def __post_init__(self) -> None:
        """Add the shares up."""
        self._sums = list(accumulate(self.shares))

    @property
    def shortest(self) -> float:
        """Least span (ns) between two instants drawn: the jitter is cut off."""
        return min(self.intervals) - FARTHEST * self.jitter

    def draw(self, random: Generator) -> int:
        """Draw an interval (ns) by inversion of its distribution (Molina-Masegosa et al., 2020)."""
        place = bisect_right(self._sums, random.random() * self._sums[-1])
        off = min(max(float(random.standard_normal()), -FARTHEST), FARTHEST)
        return round(self.intervals[place] + off * self.jitter)


class DrawnIntervals:
    """Intervals drawn one by one; what is due goes at the next tick of the vehicle's schedule.

    The instants themselves are not rounded, so the mean interval stays the distribution's
    (Molina-Masegosa et al., 2020). The first lies within the first interval drawn. Where congestion
    control asks for more, the interval ends when it lets something through.
    """

    def __init__(self, shares: Shares, start_at: int, random: Generator) -> None:
        """`random` is for these intervals alone."""
        self._shares, self._random = shares, random
        self._next = start_at + round(random.random() * shares.draw(random))

    def due(self, now: int, waiting: Fix | None, opens: int) -> bool:  # noqa: ARG002
        """Whether an interval is over (Molina-Masegosa et al., 2020); then the next begins."""
        at = max(self._next, opens)
        if now < at:
            return False
        while at <= now:
            at += self._shares.draw(self._random)
        self._next = at
        return True

    def sent(self, now: int, fix: Fix) -> None:
        """Nothing depends on what was sent (Molina-Masegosa et al., 2020)."""


class ReactiveControl:
    """Reactive congestion control of TS 102 687 V1.2.1, Annex A.1: how long to keep quiet.

    The busier the channel, the higher the state; at each evaluation it goes one state at most
    towards that of the busy ratio. It begins in the lowest.
    """

    def __init__(self, busy: Sequence[tuple[float, float]], start_at: int, period: int) -> None:
        """`busy` has times (s) and the channel busy ratio from then on; 0 before the first.

        `period` (ns) is that of the evaluations, the first at `start_at` (ns).
        """
        self._since = [start_at + nanoseconds(at) for at, _ in busy]
        self._ratios = [0.0, *(ratio for _, ratio in busy)]
        self._period = period
        self._next = start_at
        self._state = 0

    def quiet(self, now: int) -> int:
        """Least time (ns) between two messages at `now` (ns), which does not go back (TS 102 687).

        T_off of Table A.1.
        """
        while self._next <= now:
            ratio = self._ratios[bisect_right(self._since, self._next)]
            wanted = bisect_right(BUSY, ratio) - 1
            self._state += (wanted > self._state) - (wanted < self._state)
            self._next += self._period
        return QUIET[self._state]


class Sender:
    """Sends the newest fix at the instants of a rule (EN 302 637-2 or simpler), none twice.

    `control` keeps messages apart (TS 102 687), if there is such.
    """

    def __init__(
        self, rule: SendingRule | None = None, control: ReactiveControl | None = None
    ) -> None:
        self._rule: SendingRule = rule or EveryFix()
        self._control = control
        self._waiting: Fix | None = None
        self._sent_at = LONG_AGO

    def send(self, now: int, fix: Fix | None) -> Fix | None:
        """Take the fix known since `now` (ns), if there is one; returns what is sent at `now`.

        Instants must not go back (EN 302 637-2, TS 102 687).
        """
        if fix is not None:
            self._waiting = fix
        opens = LONG_AGO
        if self._control is not None:
            opens = self._sent_at + self._control.quiet(now) - ROUNDING
        if not self._rule.due(now, self._waiting, opens) or self._waiting is None:
            return None
        sent, self._waiting = self._waiting, None
        self._sent_at = now
        self._rule.sent(now, sent)
        return sent


def quiet_at(busy_ratio: float) -> int:
    """Least time (ns) between two messages in the state of that busy ratio (TS 102 687)."""
    return QUIET[bisect_right(BUSY, busy_ratio) - 1]


def awareness_interval(speed: float, check: float) -> float:
    """Interval (s) at which EN 302 637-2 asks for messages at a constant speed (m/s), straight on.

    The first check, every `check` s, after more than 4 m; from 0.1 to 1 s.
    """
    if speed * LONGEST / SECOND <= POSITION:
        return LONGEST / SECOND
    checks = least = 1
    while checks * check * speed <= POSITION + 1e-9:
        checks += 1
    while least * check < SHORTEST / SECOND - 1e-9:
        least += 1
    return min(max(checks, least) * check, LONGEST / SECOND)
