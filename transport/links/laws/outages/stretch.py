"""An outage on a stretch of the road."""

from collections.abc import Iterator
from functools import cached_property
from math import inf
from typing import Annotated, Literal

from pydantic import Field

from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.law import Problem
from transport.links.laws.outages.span import Extent, PlacedOutage
from transport.reasons import DropReason

Station = Annotated[float, Field(ge=-1_000_000, le=1_000_000)]


class StretchOutage(PlacedOutage):
    """A stretch of the road, by the arc length from the path's first point on.

    Laps of a path go on counting; `every_m` lets the stretch come again. The stations are those of
    the ends when the run starts; the metres driven are added.
    """

    kind: Literal["stretch"] = "stretch"
    from_m: Station
    to_m: Station
    every_m: Annotated[float, Field(gt=0, le=1_000_000)] | None = None

    @cached_property
    def extent(self) -> Extent:
        """The stretch in m."""
        return Extent(self.from_m, self.to_m, inf if self.every_m is None else self.every_m)

    def problems(self) -> Iterator[Problem]:
        """Return keys of an empty stretch, or one that overlaps its repetition."""
        return self.extent.problems("m")

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop by the ends' stations."""
        setting, holds = self.setting, self.extent.holds
        sender = holds(setting.sender_station + context.sender.driven)
        receiver = holds(setting.receiver_station + context.receiver.driven)
        return "outage" if self.inside(sender, receiver) else 0

    def describe(self) -> str:
        """Give stretch and ends."""
        return f"outage with {self.who} on the road {self.extent.describe('m')}"
