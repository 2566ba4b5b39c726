"""Sending of each fix."""

from dataclasses import dataclass

from vehicles.car.gnss import Fix
from vehicles.car.sending.rule import SendingContext, SendingRule, SendingTrigger


@dataclass(frozen=True, slots=True, kw_only=True)
class EveryFix(SendingRule):
    """Each fix, as soon as it is available.

    Section III-A: measurements are broadcast.
    """

    @property
    def is_periodic(self) -> bool:
        return self.dcc is None

    def begin(self, context: SendingContext) -> SendingTrigger:
        return self

    def due(self, now: int, unsent: Fix | None, allowed_from: int) -> bool:
        return unsent is not None and now >= allowed_from

    def sent(self, now: int, fix: Fix) -> None:
        pass

    def max_rate(self, fixes: float) -> float:
        return fixes

    def nominal_rate(self, fixes: float, speed: float) -> float:
        return fixes

    def describe(self) -> str:
        return "every fix"
