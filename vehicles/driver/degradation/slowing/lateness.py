"""How much later than usual a vehicle is heard; SI units."""

from math import exp, isnan
from typing import Final

from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.degradation.situation import SourceFreshness
from vehicles.schedule import SECOND

CLOSING_RATE: Final = 0.1
"""A gap that was opened closes again at this share of the own speed; while it is wide, faster:"""
CLOSING_TIME: Final = 3.0
"""a time constant (s), so that a car that stood for a minute does not stay behind for ten."""

USUAL_SHARE: Final = 0.05
"""Weight of a new message in what age messages usually have when they are heard."""


class AgeWatch:
    """How much older than usual what is known of the predecessor is, and was lately.

    Until the first message, the predecessor is where it was at the start.
    """

    def __init__(self, settings: DegradationSettings, period: float) -> None:
        """`period` (s) is the time between messages until it is learned."""
        self._settings = settings
        self._period = period
        self._usual = 0.0
        self._measured_at: int | None = None
        self._late_at: int | None = None
        self._peak, self._peak_at = 0.0, 0

    @property
    def usual(self) -> float:
        """Largest age (s) to be expected: that when heard, and a period."""
        return self._usual + self._period

    def observe(self, now: int, age: float, source: SourceFreshness) -> None:
        """Take the age (s) of the newest sample at `now` (ns)."""
        settings = self._settings
        if not isnan(source.period):
            self._period = source.period
        measured_at = now - round(age * SECOND)
        if not isnan(source.age) and measured_at != self._measured_at:
            first = self._measured_at is None
            self._measured_at = measured_at
            self._usual = age if first else self._usual + USUAL_SHARE * (age - self._usual)
        if source.is_lost or age > self._usual + settings.late_periods * self._period:
            self._late_at = now
            growth = max(age - self.usual, 0.0)
            if growth >= self.growth(now):
                self._peak, self._peak_at = growth, now

    def is_longest(self, now: int) -> bool:
        """Whether what is known at `now` (ns) is late, and older than it was lately."""
        return self._peak_at == now

    def is_awake(self, now: int) -> bool:
        """Whether messages are late at `now` (ns), or were within the probation."""
        if self._late_at is None:
            return False
        return now - self._late_at <= self._settings.probation * SECOND

    def growth(self, now: int) -> float:
        """Age beyond the usual (s): the largest lately, which is forgotten gradually.

        A gap that followed the present age would pump.
        """
        if not self._peak:
            return 0.0
        since = (now - self._peak_at) / SECOND - self._settings.probation
        since = max(since, 0.0)
        return max(self._peak * exp(-since / CLOSING_TIME) - CLOSING_RATE * since, 0.0)
