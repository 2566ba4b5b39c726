"""Limits of the steering angle and its rate."""

import math
from dataclasses import InitVar, dataclass, replace
from math import inf
from typing import Final

from vehicles.driver.settings import DegradationSettings
from vehicles.driver.steering import SteeringCommand


@dataclass(eq=False)
class CommandLimit:
    """Limits the steering command of a driver (Section III-C) to what the actuator can follow.

    A command beyond that winds up while the actuator, eq. (4), moves at its rate limit. The limits
    are `rate` (rad/s) over a control `period` (s) and ±`steering_limit` (rad). `first` (rad) is the
    initial command.
    """

    rate: float = inf
    period: float = 0.0
    steering_limit: float = inf
    first: InitVar[float] = 0.0

    def __post_init__(self, first: float) -> None:
        self._step = self.rate * self.period if self.rate < inf else inf
        self._last = first

    def limited(self, command: SteeringCommand) -> SteeringCommand:
        """Limit δ_c and leave δ_ff and δ_fb unchanged; call once per control instant."""
        wanted, step, limit, last = command.steering, self._step, self.steering_limit, self._last
        self._last = min(max(wanted, -limit, last - step), limit, last + step)
        return command if self._last == wanted else replace(command, steering=self._last)


# ---- Speed limit of a car that is uncertain of its lateral position; SI units


LANE_MARGIN: Final = 0.82  # To the edge of a lane (m): a width of 1.86 m on 3.5 m
DRIFT: Final = math.radians(1.0)
"""Lateral speed over speed of a car that is one degree off its lane's direction and needs a second
to correct that. Autoware's localisation monitor warns at the same angle."""
WALKING_PACE: Final = 3.0  # Least limit (m/s), so that no car stops for this


class PositionLimit:
    """Speed limit of a car that is uncertain of its lateral position.

    The margin in the lane, less three standard deviations, must last for the time of a correction:
    v = (margin - 3 σ) / `DRIFT`, at least a walking pace. It is 30 m/s at 3 σ = 0.3 m, where
    Autoware's localisation monitor reports an error, 14 m/s at 0.57 m (RTK float), and a walking
    pace from 0.77 m on.

    `speed` (m/s) is infinite while the deviation is at most the configured one or unknown, `reason`
    states why it is not.
    """

    def __init__(self, settings: DegradationSettings) -> None:
        self._allowed = settings.lateral_deviation_max if settings.reaction == "degrade" else inf
        self._deviation, self.speed = 0.0, inf

    def observe(self, deviation: float) -> None:
        """Set the limit by the lateral deviation (m) of the own position, NaN if unknown."""
        self._deviation, self.speed = deviation, inf
        if deviation > self._allowed:
            self.speed = max((LANE_MARGIN - 3.0 * deviation) / DRIFT, WALKING_PACE)

    @property
    def reason(self) -> str:
        if self.speed == inf:
            return ""
        width = 3.0 * self._deviation
        return f"lateral position uncertain by {width:.2f} m (3σ): at most {self.speed:.1f} m/s"

    def gap_margin(self, accuracy: float) -> float:
        """Distance (m) by which to widen the gap: 3 deviations of the difference of two positions.

        `accuracy` (m) is that of the vehicle ahead; both axes of a position have similar
        deviations.
        """
        return 0.0 if self.speed == inf else 3.0 * math.hypot(self._deviation, accuracy)
