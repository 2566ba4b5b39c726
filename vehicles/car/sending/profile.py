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
    """The rate of sending (Hz) from a time (s) after the start on; 0: nothing is sent."""

    at: Annotated[float, Setting("after the start", "s", 0, example=0.0)]
    rate: Annotated[float, Setting("from then on", "hz", 0, 100, example=10.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class RateProfile(SendingRule):
    """At a rate that changes; before the first entry nothing is sent."""

    profile: Annotated[tuple[RateEntry, ...], Setting("in order of time", nonempty=True)]

    @property
    def _pairs(self) -> list[tuple[float, float]]:
        return [(one.at, one.rate) for one in self.profile]

    def begin(self, context: SendingContext) -> SendingTrigger:
        return ProfileTrigger(self._pairs, context.start_at)

    def instants(self, context: SendingContext, end_at: int) -> Iterator[int] | None:
        each = (context.start_at + at for at in profile_instants(self._pairs))
        return takewhile(lambda at: at < end_at, each)

    def max_rate(self, fixes: float) -> float:
        return min(max(one.rate for one in self.profile), fixes)

    def nominal_rate(self, fixes: float, speed: float) -> float:  # noqa: ARG002
        """Lowest rate that is not 0."""
        return min((one.rate for one in self.profile if one.rate > 0.0), default=0.0)

    def problems(self) -> Iterator[Problem]:
        yield from SendingRule.problems(self)
        yield from must_increase("profile", [one.at for one in self.profile])

    def describe(self) -> str:
        return ", ".join(f"{one.rate:g} Hz from {one.at:g} s" for one in self.profile)


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


class ProfileTrigger:
    """At a rate that changes over time; an instant too soon is passed over."""

    def __init__(self, profile: Sequence[tuple[float, float]], start_at: int) -> None:
        """`profile` as `profile_instants` takes it, from `start_at` (ns) on."""
        self._instants = profile_instants(profile)
        self._start_at = start_at
        self._next = self._following()

    def _following(self) -> int | None:
        instant = next(self._instants, None)
        return None if instant is None else self._start_at + instant

    def due(self, now: int, unsent: Fix | None, allowed_from: int) -> bool:  # noqa: ARG002
        """Whether it is one of the instants."""
        found = False
        while self._next is not None and self._next <= now:
            found = self._next == now
            self._next = self._following()
        return found and now >= allowed_from

    def sent(self, now: int, fix: Fix) -> None:
        """Nothing depends on what was sent."""
