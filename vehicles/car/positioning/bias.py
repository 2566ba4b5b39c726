"""A constant error of a receiver."""

from dataclasses import dataclass
from typing import Annotated

from vehicles.car.dynamics import Body
from vehicles.car.positioning.error_term import ErrorProcess, ErrorTerm, ReceiverContext
from vehicles.setting import Setting


@dataclass(frozen=True, slots=True)
class Bias(ErrorTerm):
    """A constant error: a configured offset plus a random one per vehicle (m)."""

    deviation: Annotated[
        float, Setting("standard deviation of the random part, per axis", "m", 0, 1000)
    ] = 0.0
    east: Annotated[float, Setting("configured part, east", "m", -1000, 1000)] = 0.0
    north: Annotated[float, Setting("configured part, north", "m", -1000, 1000)] = 0.0

    @property
    def variance(self) -> float:
        return self.deviation**2

    def begin(self, context: ReceiverContext) -> ErrorProcess:
        east, north = context.own_streams("bias").standard_normal(2).tolist()
        return ConstantError(self.east + self.deviation * east, self.north + self.deviation * north)

    def describe(self) -> str:
        offset = f"{self.east:g} m east, {self.north:g} m north"
        return f"bias {offset}, {self.deviation:g} m random"


@dataclass(frozen=True, slots=True)
class ConstantError:
    east: float
    north: float

    def at(self, body: Body, now: int) -> tuple[float, float]:
        return self.east, self.north
