"""Stand-in of the speed guard: brakes in coast and stop, and leaves all else to the speed law."""

from math import isnan, sqrt

from vehicles.car.tyres import GRAVITY
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.degradation.situation import Situation
from vehicles.driver.degradation.stopping import needed_deceleration
from vehicles.driver.ego.own_state import Pose
from vehicles.driver.speed import GapLimits, SpeedCommand, SpeedLaw, VehiclesAhead
from vehicles.messages import Mode
from vehicles.schedule import SECOND

RESERVE = 0.5
"""A stop is to end so far (m) before the end of the known path."""


class SpeedGuard:
    """Wraps a speed law, and slows down where nobody is relied on (beyond the paper)."""

    def __init__(
        self,
        law: SpeedLaw,
        settings: DegradationSettings,
        *,
        limits: GapLimits,
        length: float,
        initial_gap: float,
        friction: float,
    ) -> None:
        """`length` (m) is that of a car, `friction` that of its tyres."""
        self._law, self._settings, self._limits = law, settings, limits
        self._length, self._gap, self._friction = length, initial_gap, friction
        self._last, self._last_at = 0.0, 0
        self._slowed = False

    def command(
        self, now: int, pose: Pose, ahead: VehiclesAhead, situation: Situation, mode: Mode
    ) -> SpeedCommand:
        """Command at `now` (ns): that of the law, or braking (beyond the paper)."""
        asked = self._law.command(now, pose, ahead)
        span = (now - self._last_at) / SECOND
        if self._settings.reaction == "degrade" and mode in ("coast", "stop"):
            lowest = self._last - self._settings.hardest.jerk * span
            asked = SpeedCommand(max(self._braking(pose, situation, mode), lowest), 0.0)
            self._slowed = True
        elif self._slowed:
            asked.acceleration = min(asked.acceleration, self._limits.acceleration)
        self._last, self._last_at = asked.acceleration, now
        return asked

    def _braking(self, pose: Pose, situation: Situation, mode: Mode) -> float:
        known = 0.0 if isnan(situation.known) else max(situation.known, 0.0)
        needed = needed_deceleration(pose.speed, max(known - RESERVE, 0.0))
        if mode == "coast":
            return -min(needed, self._settings.comfortable.deceleration)
        lateral = pose.speed * pose.yaw_rate
        left = sqrt(max((self._friction * GRAVITY) ** 2 - lateral**2, 0.0))
        return -min(needed, self._settings.hardest.deceleration, left)
