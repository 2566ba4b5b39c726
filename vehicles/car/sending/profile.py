"""Sending at a rate that changes over time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import takewhile
from typing import Annotated

from vehicles.car.gnss import Fix
from vehicles.car.sending.rule import SendingContext, SendingRule, SendingTrigger, must_increase
from vehicles.schedule import SECOND, nanoseconds
from vehicles.setting import Problem, Setting


@dataclass(frozen=True, slots=True)
class RateEntry:
    """The rate of sending from `at_s` on; 0: nothing is sent."""

    at: Annotated[float, Setting("time after the start of the run", "s", 0, example=0.0)]
    rate: Annotated[float, Setting("rate from then on", "hz", 0, 100, example=10.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class RateProfile(SendingRule):
    """At a changing rate; nothing is sent before the first entry."""

    profile: Annotated[tuple[RateEntry, ...], Setting("rates in order of time", nonempty=True)]

    @property
    def _pairs(self) -> list[tuple[float, float]]:
        return [(entry.at, entry.rate) for entry in self.profile]

    def begin(self, context: SendingContext) -> SendingTrigger:
        return ProfileTrigger(self._pairs, context.start_at)

    def instants(self, context: SendingContext, end_at: int) -> Iterator[int] | None:
        each = (context.start_at + at for at in profile_instants(self._pairs))
        return takewhile(lambda at: at < end_at, each)

    def max_rate(self, fixes: float) -> float:
        return min(max(entry.rate for entry in self.profile), fixes)

    def nominal_rate(self, fixes: float, speed: float) -> float:
        return min((entry.rate for entry in self.profile if entry.rate > 0.0), default=0.0)

    def problems(self) -> Iterator[Problem]:
        yield from SendingRule.problems(self)
        yield from must_increase("profile", [entry.at for entry in self.profile])

    def describe(self) -> str:
        return ", ".join(f"{entry.rate:g} Hz from {entry.at:g} s" for entry in self.profile)


def profile_instants(profile: Sequence[tuple[float, float]]) -> Iterator[int]:
    """Instants (ns) of a changing rate: `profile` has times (s) with the rate (Hz) from then on.

    These are the instants at which the integral of the rate is a whole number, so a change of rate
    rescales the rest of the current period.
    """
    integral = Fraction(0)
    target = 0
    ends = [*(nanoseconds(at) for at, _ in profile[1:]), None]
    for (at_s, rate_hz), end in zip(profile, ends, strict=True):
        if rate_hz <= 0.0:
            continue
        at, rate = nanoseconds(at_s), Fraction(rate_hz) / SECOND
        while True:
            instant = at + (target - integral) / rate
            if end is not None and instant >= end:
                integral += (end - at) * rate
                break
            yield round(instant)
            target += 1


class ProfileTrigger:
    """Triggers at a changing rate; instants barred by congestion control are skipped."""

    def __init__(self, profile: Sequence[tuple[float, float]], start_at: int) -> None:
        """Take a profile as in `profile_instants`, from `start_at` (ns) on."""
        self._instants = profile_instants(profile)
        self._start_at = start_at
        self._next = self._following()

    def _following(self) -> int | None:
        instant = next(self._instants, None)
        return None if instant is None else self._start_at + instant

    def due(self, now: int, unsent: Fix | None, allowed_from: int) -> bool:
        is_instant = False
        while self._next is not None and self._next <= now:
            is_instant = self._next == now
            self._next = self._following()
        return is_instant and now >= allowed_from

    def sent(self, now: int, fix: Fix) -> None:
        """Do nothing: the instants do not depend on messages."""
