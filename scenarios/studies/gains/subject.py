"""The car and gains that `convoy paper gains` analyses, and the names of its plots."""

from collections.abc import Sequence
from dataclasses import dataclass

from vehicles.car.parameters import Gains, Loading, VehicleParameters, loaded
from vehicles.theory.gain_sets import abscissa

PICTURES = ("stabilising_slices", "intersection", "propagation", "roots_over_loadings")


@dataclass(frozen=True, slots=True)
class Subject:
    """Car, gains, speeds (m/s, ascending; the last is the reference) and loadings to analyse."""

    parameters: VehicleParameters
    gains: Gains
    speeds: Sequence[float]
    loadings: Sequence[Loading]

    @property
    def reference(self) -> float:
        return self.speeds[-1]

    @property
    def cars(self) -> list[VehicleParameters]:
        return [loaded(self.parameters, loading) for loading in self.loadings]

    def abscissa(self, car: VehicleParameters, speed: float) -> float:
        """Largest real part (1/s) of the roots."""
        return float(abscissa(car, self.gains, [speed])[0])
