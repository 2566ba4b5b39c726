"""A steering command that the car can follow: no further and no faster than its wheels turn."""

import math
from dataclasses import replace

from vehicles.driver.steering import SteeringCommand


class CommandLimit:
    """Limits the steering command of a driver (Section III-C) to what the rack can follow.

    A command further away than that winds up while the actuator, eq. (4), moves as fast as it can.
    The paper states no such limit; without a limit of the rate commands pass unchanged.
    """

    def __init__(
        self,
        rate: float = math.inf,
        period: float = 0.0,
        steering_limit: float = math.inf,
        *,
        first: float = 0.0,
    ) -> None:
        """Limit to `rate` (rad/s) over a control period (s), starting at the command `first` (rad).

        `steering_limit` is the largest angle (rad).
        """
        self._step = rate * period if math.isfinite(rate) else math.inf
        self._limit = steering_limit
        self._last = first

    def limited(self, command: SteeringCommand) -> SteeringCommand:
        """Command of this control instant, at most a step from the last; δ_ff, δ_fb stay.

        Call once per control instant.
        """
        wanted, step, limit = command.steering, self._step, self._limit
        if (-step <= wanted - self._last <= step and -limit <= wanted <= limit) or step == math.inf:
            self._last = wanted
            return command
        wanted = min(max(wanted, -limit), limit)
        self._last = min(max(wanted, self._last - step), self._last + step)
        return replace(command, steering=self._last)
