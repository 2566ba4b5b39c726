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
    "control.fusion": PlugInExample(
        """\
from dataclasses import dataclass
from vehicles.preview.trajectory import fit_composite

class OnlyCloseSources:
    @dataclass
    class Settings:
        distance_m: float = 20.0

    def __init__(self, settings):
        self.distance = settings.distance_m

    def fuse(self, sources, settings):
        ends = [source.window.station[-1] for source in sources]
        close = [s for s, end in zip(sources, ends) if end < self.distance]
        fit = fit_composite(close or sources, settings)
        return [] if fit is None else [(1.0, fit)]
""",
        """\
[control.fusion]
use = "mine.OnlyCloseSources"
distance_m = 15.0
""",
    ),
    "control.degradation.reaction": PlugInExample(
        """\
from dataclasses import dataclass
from vehicles.driver.reactions import Extrapolate

class BrakeWhenOld(Extrapolate):
    @dataclass
    class Settings:
        age_s: float = 0.5
        braking_mps2: float = 2.0

    def __init__(self, settings):
        self.age, self.braking = settings.age_s, settings.braking_mps2

    def acceleration(self, situation, mode, speed, wanted):
        old = situation.predecessor.age > self.age
        return min(wanted, -self.braking) if old and speed > 0.0 else wanted
""",
        """\
[control.degradation.reaction]
use = "mine.BrakeWhenOld"
age_s = 0.06
""",
    ),
    "links.loss": PlugInExample(
        """\
from math import hypot
from transport.links.laws.loss.base import BaseLoss

class LossOverDistance(BaseLoss):
    reach_m: float

    def judge(self, draw, context):
        there, here = context.sender, context.receiver
        distance = hypot(there.east - here.east, there.north - here.north)
        lost = draw("distance", context.seq) < (distance / self.reach_m) ** 2
        return "loss" if lost else 0
""",
        """\
[links]
loss = { use = "mine.LossOverDistance", reach_m = 60.0 }
""",
    ),
    "links.delay": PlugInExample(
        """\
from transport.links.laws.delay.base import BaseDelay
from transport.links.laws.moments import Delays

class Retransmissions(BaseDelay):
    step_ms: float = 5.0

    def judge(self, draw, context):
        again = sum(draw(f"attempt {k}", context.seq) < 0.5 for k in range(4))
        return round(again * self.step_ms * 1_000_000)

    @property
    def delays(self):
        return Delays(2 * self.step_ms * 1e6, (self.step_ms * 1e6) ** 2)
""",
        """\
[links]
delay = { use = "mine.Retransmissions", step_ms = 10.0 }
""",
    ),
    "sending": PlugInExample(
        """\
from dataclasses import dataclass
from vehicles.car.sending.rule import SendingRule

@dataclass(frozen=True, kw_only=True)
class EveryMetres(SendingRule):
    step_m: float = 1.0

    def begin(self, context):
        return Distance(self.step_m)

    def nominal_rate(self, fixes, speed):
        return min(fixes, speed / self.step_m) or 1.0

class Distance:
    def __init__(self, step):
        self.step, self.last = step, None

    def due(self, now, unsent, allowed_from):
        if unsent is None or self.last is None:
            return unsent is not None
        east = unsent.east - self.last.east
        north = unsent.north - self.last.north
        return east**2 + north**2 >= self.step**2

    def sent(self, now, fix):
        self.last = fix
""",
        """\
[sending]
use = "mine.EveryMetres"
step_m = 2.5
""",
    ),
    "gnss.errors": PlugInExample(
        """\
from dataclasses import dataclass
from math import sin
from vehicles.car.positioning.error_term import ErrorTerm

@dataclass(frozen=True)
class Multipath(ErrorTerm):
    amplitude_m: float = 0.1

    @property
    def variance(self):
        return self.amplitude_m**2 / 2

    def begin(self, context):
        phase = 6.28 * context.own_streams("phase").random()
        return Wave(self.amplitude_m, phase)

class Wave:
    def __init__(self, amplitude, phase):
        self.amplitude, self.phase = amplitude, phase

    def at(self, body, now):
        return self.amplitude * sin(0.1 * body.distance + self.phase), 0.0
""",
        """\
[[gnss.errors]]
use = "mine.Multipath"
amplitude_m = 0.05
""",
    ),
    "event": PlugInExample(
        """\
from dataclasses import dataclass

class HardCornering:
    @dataclass
    class Settings:
        limit_mps2: float = 3.0

    def __init__(self, settings):
        self.limit = settings.limit_mps2

    def holds(self, pose):
        return abs(pose.lateral_acceleration_mps2) > self.limit
""",
        """\
[[event]]
use = "mine.HardCornering"
limit_mps2 = 0.02
""",
    ),
    "figure": PlugInExample(
        """\
from dataclasses import dataclass

class SteeringEffort:
    @dataclass
    class Settings:
        exponent: float = 2.0

    def __init__(self, settings):
        self.exponent, self.total, self.count = settings.exponent, 0.0, 0

    def add(self, pose):
        self.total += abs(pose.steering_rad) ** self.exponent
        self.count += 1

    def value(self):
        return self.total / self.count if self.count else None
""",
        """\
[[figure]]
use = "mine.SteeringEffort"
exponent = 1.0
""",
    ),
}
"""Examples by the key of the plug-in point."""
