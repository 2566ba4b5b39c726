"""A predecessor that has announced when it will stop; SI units, instants in ns."""

from vehicles.driver.degradation.settings import Braking
from vehicles.driver.degradation.situation import SourceFreshness
from vehicles.driver.degradation.slowing.stopping import stopping_distance
from vehicles.schedule import SECOND


class AnnouncedStop:
    """Whether the predecessor is taken to stop as hard as it can, and how far it gets.

    Else cars that drive into silence one after the other would begin to brake one after the other
    at one and the same place, and all come to stand there.
    """

    def __init__(self, hardest: Braking) -> None:
        self._hardest = hardest
        self._heard_at = 0

    def is_expected(self, now: int, predecessor: SourceFreshness) -> bool:
        """Whether it stops at `now`, as it announced: until it is heard of what it does instead.

        While it is heard, until its brakes have gripped: from then on they can be followed.
        """
        stops_at = predecessor.stops_at
        if not stops_at or now < stops_at:
            self._heard_at = 0
            return False
        since = (now - stops_at) / SECOND
        if predecessor.age >= since or predecessor.is_lost or predecessor.status == "late":
            return True
        self._heard_at = self._heard_at or now
        hardest = self._hardest
        return now - self._heard_at <= hardest.deceleration / hardest.jerk * SECOND

    def way(self, now: int, speed: float, predecessor: SourceFreshness) -> float:
        """How far (m) it gets from where it was at its newest sample, at `speed` (m/s) then.

        It drives on at that speed until the announced instant, or brakes already.
        """
        free = (predecessor.stops_at - now) / SECOND + predecessor.age
        if free > 0.0:
            return speed * free + stopping_distance(speed, 0.0, self._hardest)
        braked = min(max(predecessor.acceleration, -self._hardest.deceleration), 0.0)
        return stopping_distance(speed, braked, self._hardest)
