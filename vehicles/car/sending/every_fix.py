"""Each fix is sent."""

from dataclasses import dataclass

from vehicles.car.gnss import Fix
from vehicles.car.sending.rule import SendingCourse, SendingRule, SendingStart


@dataclass(frozen=True, slots=True, kw_only=True)
class EveryFix(SendingRule):
    """Each fix, as soon as it is known.

    Section III-A: measurements are broadcast.
    """

    @property
    def is_even(self) -> bool:
        return self.dcc is None

    def begin(self, start: SendingStart) -> SendingCourse:  # noqa: ARG002
        return self

    def due(self, now: int, waiting: Fix | None, opens: int) -> bool:
        return waiting is not None and now >= opens

    def sent(self, now: int, fix: Fix) -> None:
        pass

    def highest_rate(self, fixes: float) -> float:
        return fixes

    def usual_rate(self, fixes: float, speed: float) -> float:  # noqa: ARG002
        return fixes

    def describe(self) -> str:
        return "every fix"
