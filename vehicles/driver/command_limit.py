"""A steering command that the car can follow: no further and no faster than its wheels turn."""

import math
from dataclasses import replace

from vehicles.driver.steering import SteeringCommand


class CommandLimit:
    """Holds back the steering command of a driver (Section III-C) to what the rack can do.

    A command further than that away would only tell the actuator, eq. (4), to go as fast as it can,
    and wind up meanwhile. The paper is silent on it; without a limit of the rate nothing is done.
    """

    def __init__(
        self,
        rate: float = math.inf,
        period: float = 0.0,
        steering_limit: float = math.inf,
        *,
        first: float = 0.0,
    ) -> None:
        """Limit to `rate` (rad/s) over a control period (s), from the command `first` (rad) on.

        `steering_limit` is the largest angle (rad), beyond which no command is taken for one.
        """
        self._step = rate * period if math.isfinite(rate) else math.inf
        self._limit = steering_limit
        self._last = first

    def held_back(self, command: SteeringCommand) -> SteeringCommand:
        """Command of this control instant, at most a step from the last one's.

        To be called once at every control instant. The parts δ_ff and δ_fb stay what they were.
        """
        asked, step, limit = command.steering, self._step, self._limit
        if (-step <= asked - self._last <= step and -limit <= asked <= limit) or step == math.inf:
            self._last = asked
            return command
        asked = min(max(asked, -limit), limit)
        self._last = min(max(asked, self._last - step), self._last + step)
        return replace(command, steering=self._last)
