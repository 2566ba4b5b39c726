"""Recorded delays."""

from functools import cached_property
from math import fsum, sqrt
from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from transport.links.laws.delay.drawn import DrawnDelay, Milliseconds, in_ms, probability
from transport.links.laws.law import Unfit
from vehicles.schedule import MILLISECOND

MOST_RECORDED = 1000
"""Recorded delays that stand for all: every link of every vehicle's process holds them."""


class EmpiricalDelay(DrawnDelay):
    """Recorded delays, each as likely: the column delay_ms of a CSV `file`.

    When the file has been read they are `recorded_ms`, sorted, and it is their `source`. Of more
    than 1000 as many quantiles stay, evenly spread: no probability is off by more than 0.001.
    """

    kind: Literal["empirical"] = "empirical"
    file: Annotated[str, StringConstraints(min_length=1)] | None = None
    source: str | None = None
    recorded_ms: Annotated[
        tuple[Milliseconds, ...], Field(strict=False, max_length=MOST_RECORDED)
    ] = ()

    def check(self) -> None:
        """Find delays that are given twice or not at all."""
        if self.file is not None and self.recorded_ms:
            raise Unfit("recorded_ms", "given together with file, allowed one of them")
        if self.file is None and not self.recorded_ms:
            raise Unfit("file", "missing, needed without recorded_ms")

    @cached_property
    def _recorded(self) -> tuple[float, ...]:
        return tuple(one * MILLISECOND for one in sorted(self.recorded_ms))

    @property
    def mean_ns(self) -> float:
        """Mean of those recorded."""
        return fsum(self._recorded) / len(self._recorded)

    @property
    def deviation_ns(self) -> float:
        """Deviation of those recorded, which are the whole law."""
        mean = self.mean_ns
        return sqrt(fsum((one - mean) ** 2 for one in self._recorded) / len(self._recorded))

    def at(self, normal: float) -> float:
        """Return the recorded delay at the number's probability."""
        count = len(self._recorded)
        return self._recorded[min(int(probability(normal) * count), count - 1)]

    def describe_law(self) -> str:
        """Give their count and their moments."""
        moments = f"{in_ms(self.mean_ns)} ± {in_ms(self.deviation_ns)}"
        return f"delay as in {len(self._recorded)} recorded ones, {moments}"
