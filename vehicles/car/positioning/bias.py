"""A constant error of a receiver."""

from dataclasses import dataclass
from typing import Annotated

from vehicles.car.dynamics import Body
from vehicles.car.positioning.error_term import ErrorProcess, ErrorTerm, ReceiverContext
from vehicles.setting import Setting


@dataclass(frozen=True, slots=True)
class Bias(ErrorTerm):
    """A constant error: drawn for each vehicle with a deviation per axis, and given (m)."""

    deviation: Annotated[float, Setting("drawn, per axis", "m", 0, 1000)] = 0.0
    east: Annotated[float, Setting("given", "m", -1000, 1000)] = 0.0
    north: Annotated[float, Setting("given", "m", -1000, 1000)] = 0.0

    @property
    def variance(self) -> float:
        return self.deviation**2

    def begin(self, context: ReceiverContext) -> ErrorProcess:
        east, north = context.own_streams("bias").standard_normal(2).tolist()
        return Constant(self.east + self.deviation * east, self.north + self.deviation * north)

    def describe(self) -> str:
        given = f"{self.east:g} m east, {self.north:g} m north"
        return f"bias {given}, {self.deviation:g} m drawn"


@dataclass(frozen=True, slots=True)
class Constant:
    """The same error (m) at all times."""

    east: float
    north: float

    def at(self, body: Body, now: int) -> tuple[float, float]:  # noqa: ARG002
        return self.east, self.north
