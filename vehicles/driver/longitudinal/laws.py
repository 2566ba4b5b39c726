"""Shipped longitudinal controllers."""

from vehicles.driver.longitudinal.controller import LongitudinalSetup, VehiclesAhead
from vehicles.driver.longitudinal.gap_keeping import gap_acceleration


class GapLaw:
    """The CACC law of PATH, which keeps a constant distance or time gap (Rajamani, eq. 7.39)."""

    def __init__(self, setup: LongitudinalSetup) -> None:
        self._policy = setup.policy
        self._limits = setup.limits

    def acceleration(self, speed: float, ahead: VehiclesAhead) -> float:
        """Keep the desired spacing, by the predecessor's and the lead's speed."""
        return gap_acceleration(ahead, speed, self._policy, self._limits)
