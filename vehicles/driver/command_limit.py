"""Limits of the steering angle and its rate."""

import math
from dataclasses import replace

from vehicles.driver.steering import SteeringCommand


class CommandLimit:
    """Limits the steering command of a driver (Section III-C) to what the actuator can follow.

    A command beyond that winds up while the actuator, eq. (4), moves at its rate limit. The paper
    states no such limit; without a rate limit commands pass unchanged.
    """

    def __init__(
        self,
        rate: float = math.inf,
        period: float = 0.0,
        steering_limit: float = math.inf,
        *,
        first: float = 0.0,
    ) -> None:
        """Limit to `rate` (rad/s) over a control `period` (s) and to ±`steering_limit` (rad).

        `first` (rad) is the initial command.
        """
        self._step = rate * period if math.isfinite(rate) else math.inf
        self._limit = steering_limit
        self._last = first

    def limited(self, command: SteeringCommand) -> SteeringCommand:
        """Limit δ_c and leave δ_ff and δ_fb unchanged; call once per control instant."""
        wanted, step, limit = command.steering, self._step, self._limit
        if (-step <= wanted - self._last <= step and -limit <= wanted <= limit) or step == math.inf:
            self._last = wanted
            return command
        wanted = min(max(wanted, -limit), limit)
        self._last = min(max(wanted, self._last - step), self._last + step)
        return replace(command, steering=self._last)
