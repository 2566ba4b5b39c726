"""An example of a user-defined class for each plug-in point; the tests run all of them."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PlugInExample:
    """A module `mine.py`, and the lines of a scenario that select its class."""

    code: str
    toml: str


EXAMPLES: Mapping[str, PlugInExample] = {
    "control.controller": PlugInExample(
        """\
from dataclasses import dataclass
from vehicles.driver.steering import SteeringCommand

class PurePursuit:
    @dataclass
    class Settings:
        lookahead_s: float = 0.8

    def __init__(self, parameters, gains, settings):
        self.wheelbase = parameters.wheelbase
        self.lookahead_s = settings.lookahead_s

    def steer(self, errors, speed):
        ahead = max(self.lookahead_s * speed, 4.0)
        turn = 2 * (-errors.lateral - ahead * errors.heading) / ahead**2
        feedforward = self.wheelbase * errors.curvature
        feedback = self.wheelbase * turn
        return SteeringCommand(feedforward + feedback, feedforward, feedback)
""",
        """\
[control.controller]
use = "mine.PurePursuit"
lookahead_s = 1.0
""",
    ),
    "control.longitudinal": PlugInExample(
        """\
from dataclasses import dataclass

class ConstantTimeGap:
    @dataclass
    class Settings:
        gain_per_s: float = 0.2

    def __init__(self, setup, settings):
        self.policy, self.gain = setup.policy, settings.gain_per_s

    def acceleration(self, speed, ahead):
        error = ahead.spacing - self.policy.desired(speed)
        closing = ahead.predecessor_speed - speed
        return (closing + self.gain * error) / max(self.policy.headway, 0.5)
""",
        """\
[speed]
followers = "gap"
[control.longitudinal]
use = "mine.ConstantTimeGap"
gain_per_s = 0.4
""",
    ),
}
"""Examples by the key of the plug-in point."""
