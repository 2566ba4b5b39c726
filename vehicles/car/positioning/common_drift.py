"""Drift shared by all receivers."""

from dataclasses import dataclass

from vehicles.car.dynamics import Body
from vehicles.car.positioning.drift import Drift, GaussMarkov
from vehicles.car.positioning.error_term import ErrorProcess, ErrorTerm, ReceiverContext


@dataclass(frozen=True, slots=True)
class CommonDrift(Drift, ErrorTerm):
    """Drift shared by all receivers (satellites, atmosphere), a Gauss–Markov process.

    It does not change distances between vehicles.
    """

    shared = True

    @property
    def variance(self) -> float:
        return self.deviation**2

    def begin(self, context: ReceiverContext) -> ErrorProcess:
        return ScaledDrift(
            self.deviation,
            GaussMarkov(self.time_constant, context.start_at, context.shared_streams("drift")),
        )

    def describe(self) -> str:
        return f"common drift {self.deviation:g} m over {self.time_constant:g} s"


@dataclass(frozen=True, slots=True)
class ScaledDrift:
    """A Gauss–Markov process of standard deviation `deviation` (m)."""

    deviation: float
    unit_process: GaussMarkov

    def at(self, body: Body, now: int) -> tuple[float, float]:
        east, north = self.unit_process.at(now)
        return self.deviation * east, self.deviation * north
