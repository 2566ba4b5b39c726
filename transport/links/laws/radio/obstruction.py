"""Obstruction of a radio link by the vehicles between sender and receiver."""

from math import ceil, log10
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.link_law import LawTable
from transport.links.laws.radio.shadowing import Deviation, ShadowField
from transport.links.laws.vehicles_between import VehiclesBetween

Floats = NDArray[np.float64]
Radius = Annotated[float, Field(ge=0, le=10)]

MAX_LOSS = 150.0  # Loss (dB) with which no radio receives anything


class Obstruction(LawTable):
    """Base of the loss caused by vehicles in between; `varies` if it is random along the road.

    A vehicle obstructs the link if its circle of `radius_m` cuts the line of sight.
    """

    varies: ClassVar[bool] = False

    def loss(
        self,
        between: VehiclesBetween,
        variation: ShadowField,
        draw: Draw,
        context: TransmissionContext,
        distance: float,
    ) -> tuple[float, bool]:
        """Loss (dB) over `distance` (m), and whether a vehicle obstructs the link."""
        raise NotImplementedError

    def losses(
        self, count: int, distance: float, normals: Floats, weights: Floats
    ) -> tuple[Floats, Floats]:
        """Losses (dB) over `distance` (m) behind `count` vehicles, and their weights.

        `normals` and `weights` are those of a quadrature over a standard normal number.
        """
        raise NotImplementedError

    def describe(self, count: int) -> str:
        """Describe the law in a few words, for up to `count` vehicles in between."""
        raise NotImplementedError


class LossPerVehicle(Obstruction):
    """The same loss for each vehicle in the line of sight (ETSI TR 103 257).

    loss_db   loss per vehicle
    radius_m  radius of a vehicle's circle
    """

    kind: Literal["etsi"] = "etsi"
    loss_db: Annotated[float, Field(ge=0.1, le=100)] = 6.9
    radius_m: Radius = 1.5

    def loss(
        self,
        between: VehiclesBetween,
        variation: ShadowField,
        draw: Draw,
        context: TransmissionContext,
        distance: float,
    ) -> tuple[float, bool]:
        count = between.count_obstructing(context, ceil(MAX_LOSS / self.loss_db))
        return self.loss_db * count, count > 0

    def losses(
        self, count: int, distance: float, normals: Floats, weights: Floats
    ) -> tuple[Floats, Floats]:
        most = ceil(MAX_LOSS / self.loss_db)
        return np.array([self.loss_db * min(count, most)]), np.ones(1)

    def describe(self, count: int) -> str:
        return f"{self.loss_db:g} dB for each of up to {count} vehicles in between"


class SingleLoss(Obstruction):
    """One random loss max(0, N(mean, deviation)) for any number of vehicles (3GPP TR 37.885).

    mean_db       mean; it grows by max(0, 15 log₁₀ d − 41) dB over d metres
    deviation_db  standard deviation
    radius_m      radius of a vehicle's circle

    9 and 4.5 dB are for trucks higher than both antennas, 5 and 4 dB for cars. The report does not
    specify the autocorrelation; here it is that of the shadowing.
    """

    varies = True

    kind: Literal["3gpp"] = "3gpp"
    mean_db: Annotated[float, Field(ge=-300, le=300)] = 9.0
    deviation_db: Deviation = 4.5
    radius_m: Radius = 1.5

    def loss(
        self,
        between: VehiclesBetween,
        variation: ShadowField,
        draw: Draw,
        context: TransmissionContext,
        distance: float,
    ) -> tuple[float, bool]:
        if not between.count_obstructing(context, 1):
            return 0.0, False
        normal = variation.at(draw, context.receiver.travelled)
        return max(0.0, self._mean(distance) + self.deviation_db * normal), True

    def losses(
        self, count: int, distance: float, normals: Floats, weights: Floats
    ) -> tuple[Floats, Floats]:
        return np.maximum(0.0, self._mean(distance) + self.deviation_db * normals), weights

    def _mean(self, distance: float) -> float:
        return self.mean_db + max(0.0, 15.0 * log10(distance) - 41.0)

    def describe(self, count: int) -> str:
        law = f"{self.mean_db:g} ± {self.deviation_db:g} dB once"
        return f"{law} for up to {count} vehicles in between"


ObstructionLaw = Annotated[LossPerVehicle | SingleLoss, Field(discriminator="kind")]
