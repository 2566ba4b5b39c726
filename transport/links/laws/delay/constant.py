"""A constant delay."""

from functools import cached_property
from typing import Literal

from transport.links.laws.delay.drawn import Milliseconds, OrderedDelay, in_ms
from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.moments import Delays
from transport.reasons import DropReason
from vehicles.schedule import MILLISECOND


class ConstantDelay(OrderedDelay):
    """Always the same delay."""

    kind: Literal["constant"] = "constant"
    delay_ms: Milliseconds

    @cached_property
    def _delay(self) -> int:
        return round(self.delay_ms * MILLISECOND)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:  # noqa: ARG002 - no chance
        """Delay by it."""
        return self._delay

    @property
    def usual_ns(self) -> float:
        """The delay itself."""
        return float(self._delay)

    @property
    def delays(self) -> Delays:
        """The delay itself."""
        return Delays(float(self._delay), 0.0)

    def describe(self) -> str:
        """Give the delay."""
        return f"delay of {in_ms(self._delay)}"
