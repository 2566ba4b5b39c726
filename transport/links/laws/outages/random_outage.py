"""Outage of random duration."""

from functools import cached_property
from math import exp
from typing import Annotated, Literal

from pydantic import Field

from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.moments import Losses
from transport.links.laws.outages.by_time import Outage
from transport.reasons import DropReason
from vehicles.schedule import SECOND

MeanTime = Annotated[float, Field(ge=0.001, le=86_400)]
CACHED_CELLS = 8  # Number of cells whose draws are cached


class RandomOutage(Outage):
    """Random outages with exponentially distributed durations.

    mean_on_s   mean time between outages
    mean_off_s  mean duration of an outage

    The two-state Markov process is computed without its history (uniformisation, Jensen 1953): at
    the events of a Poisson process of rate 1/mean_on + 1/mean_off the state is drawn again, off
    with its stationary probability. The state is that of the last event. Time is divided into
    cells of about one event; the number, instants and states of the events are drawn per cell.
    """

    kind: Literal["random"] = "random"
    mean_on_s: MeanTime
    mean_off_s: MeanTime

    @cached_property
    def _means(self) -> tuple[int, int]:
        return round(self.mean_on_s * SECOND), round(self.mean_off_s * SECOND)

    @cached_property
    def cell(self) -> int:
        """Length of a cell (ns): the mean time between events."""
        on, off = self._means
        return max(round(on * off / (on + off)), 1)

    @cached_property
    def _cells(self) -> dict[tuple[Draw, int], tuple[tuple[int, bool], ...]]:
        return {}

    @property
    def off_ratio(self) -> float:
        on, off = self._means
        return off / (on + off)

    def losses(self, distance_m: float | None) -> Losses:
        return Losses(self.off_ratio, None, 0.0)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return "outage" if self.is_off(draw, context.sent_at - self.setting.start_at) else 0

    def is_off(self, draw: Draw, since: int) -> bool:
        """Whether the link is off `since` ns after the start."""
        cell = since // self.cell
        while True:
            before = [event for event in self._events(draw, cell) if event[0] <= since]
            if before:
                return max(before)[1]
            cell -= 1

    def _events(self, draw: Draw, cell: int) -> tuple[tuple[int, bool], ...]:
        """Events of a cell: instants (ns) and whether the link is off from then on.

        The index of the law is part of the draws, so that appended outages do not change it.
        """
        known = self._cells.get((draw, cell))
        if known is None:
            length, (on, off), share = self.cell, self._means, self.off_ratio
            purpose = f"outage {self.setting.place}"
            mean = length * (1.0 / on + 1.0 / off)
            known = tuple(
                (
                    cell * length + int(draw(f"{purpose} at {k}", cell) * length),
                    draw(f"{purpose} off {k}", cell) < share,
                )
                for k in range(_poisson(draw(f"{purpose} count", cell), mean))
            )
            self._cells[draw, cell] = known
            if len(self._cells) > CACHED_CELLS:
                del self._cells[next(iter(self._cells))]
        return known

    def describe(self) -> str:
        return (
            f"random outages, on for {self.mean_on_s:g} s and off for {self.mean_off_s:g} s on "
            "average"
        )


def _poisson(probability: float, mean: float) -> int:
    count, term = 0, exp(-mean)
    total = term
    while probability >= total and term > 0.0:
        count += 1
        term *= mean / count
        total += term
    return count
