"""A uniform delay."""

from functools import cached_property
from math import sqrt
from typing import Literal

from transport.links.laws.delay.drawn import DrawnDelay, Milliseconds, in_ms, probability
from transport.links.laws.law import Unfit
from vehicles.schedule import MILLISECOND


class UniformDelay(DrawnDelay):
    """Each delay between the two as likely."""

    kind: Literal["uniform"] = "uniform"
    delay_ms_min: Milliseconds = 0.0
    delay_ms_max: Milliseconds

    def check(self) -> None:
        """Find a range that is empty."""
        least, most = self.delay_ms_min, self.delay_ms_max
        if most <= least:
            why = f"given {most:g}, allowed more than {least:g}, the least"
            raise Unfit("delay_ms_max", why)

    @cached_property
    def _ends(self) -> tuple[float, float]:
        return self.delay_ms_min * MILLISECOND, self.delay_ms_max * MILLISECOND

    @property
    def mean_ns(self) -> float:
        """The middle."""
        least, most = self._ends
        return 0.5 * (least + most)

    @property
    def deviation_ns(self) -> float:
        """The width over √12."""
        least, most = self._ends
        return (most - least) / sqrt(12.0)

    def at(self, normal: float) -> float:
        """Return the point between both ends at the number's probability."""
        least, most = self._ends
        return least + probability(normal) * (most - least)

    def describe_law(self) -> str:
        """Give both ends."""
        least, most = self._ends
        return f"delay uniform from {in_ms(least)} to {in_ms(most)}"
