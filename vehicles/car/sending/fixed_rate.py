"""Sending at a constant rate."""

from dataclasses import dataclass
from typing import Annotated

from vehicles.car.gnss import Fix
from vehicles.car.sending.rule import PhasedRule, SendingContext, SendingTrigger
from vehicles.schedule import Cadence
from vehicles.setting import Setting


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedRate(PhasedRule):
    """At a constant rate and phase, independent of control and GNSS."""

    rate: Annotated[float, Setting("rate of sending", "hz", 0.01, 100, example=10.0)]

    @property
    def is_periodic(self) -> bool:
        return self.dcc is None

    @property
    def schedule_rate(self) -> float:
        return self.rate

    def begin(self, context: SendingContext) -> SendingTrigger:
        return PeriodicTrigger(self.cadence(context))

    def max_rate(self, fixes: float) -> float:
        return min(self.rate, fixes)

    def nominal_rate(self, fixes: float, speed: float) -> float:
        return self.rate

    def describe(self) -> str:
        return f"{self.rate:g} Hz, {self.describe_phase()}"


@dataclass(frozen=True, slots=True)
class PeriodicTrigger:
    """Triggers at the instants of a schedule; those barred by congestion control are skipped."""

    cadence: Cadence

    def due(self, now: int, unsent: Fix | None, allowed_from: int) -> bool:
        return now >= allowed_from and self.cadence.due(now)

    def sent(self, now: int, fix: Fix) -> None:
        pass
