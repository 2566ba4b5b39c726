"""A module with a class or a function for each plug-in point, and the lines that select it."""

from collections.abc import Mapping

CODE = """
from dataclasses import dataclass
from math import hypot, sin
from vehicles.driver.reactions import Extrapolate
from vehicles.driver.steering import SteeringCommand
from vehicles.preview.trajectory import fit_composite
from transport.links.laws.burst_losses import BaseLoss
from transport.links.laws.delays import BaseDelay
from vehicles.car.sending_rules import SendingRule
from vehicles.car.gnss_error_terms import ErrorTerm

class PurePursuit:
    def __init__(self, parameters, gains, lookahead_s=0.8):
        self.wheelbase, self.lookahead_s = parameters.wheelbase, lookahead_s

    def steer(self, errors, speed):
        ahead = max(self.lookahead_s * speed, 4.0)
        turn = 2 * (-errors.lateral - ahead * errors.heading) / ahead**2
        parts = self.wheelbase * errors.curvature, self.wheelbase * turn
        return SteeringCommand(sum(parts), *parts)

@dataclass
class ConstantTimeGap:
    setup: object
    gain_per_s: float = 0.2

    def acceleration(self, speed, ahead):
        policy = self.setup.policy
        closing = ahead.predecessor_speed - speed
        error = ahead.spacing - policy.desired(speed)
        return (closing + self.gain_per_s * error) / max(policy.headway, 0.5)

@dataclass
class OnlyCloseSources:
    distance_m: float = 20.0

    def fuse(self, sources, settings):
        close = [s for s in sources if s.window.station[-1] < self.distance_m]
        fit = fit_composite(close or sources, settings)
        return [] if fit is None else [(1.0, fit)]

@dataclass
class Age:
    age_s: float = 0.5

class BrakeWhenOld(Extrapolate):
    def __init__(self, settings: Age):
        self.age = settings.age_s

    def acceleration(self, situation, mode, speed, wanted):
        old = situation.predecessor.age > self.age
        return min(wanted, -2.0) if old and speed > 0.0 else wanted

class LossOverDistance(BaseLoss):
    reach_m: float

    def judge(self, draw, context):
        there, here = context.sender, context.receiver
        distance = hypot(there.east - here.east, there.north - here.north)
        return "loss" if draw("distance", context.seq) < (distance / self.reach_m) ** 2 else 0

class Retransmissions(BaseDelay):
    step_ms: float = 5.0

    def judge(self, draw, context):
        again = sum(draw(f"attempt {k}", context.seq) < 0.5 for k in range(4))
        return round(again * self.step_ms * 1_000_000)

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
        return hypot(unsent.east - self.last.east, unsent.north - self.last.north) >= self.step

    def sent(self, now, fix):
        self.last = fix

@dataclass(frozen=True)
class Multipath(ErrorTerm):
    amplitude_m: float = 0.1

    @property
    def variance(self):
        return self.amplitude_m**2 / 2

    def begin(self, context):
        return Wave(self.amplitude_m, 6.28 * context.own_streams("phase").random())

class Wave:
    def __init__(self, amplitude, phase):
        self.amplitude, self.phase = amplitude, phase

    def at(self, body, now):
        return self.amplitude * sin(0.1 * body.distance + self.phase), 0.0

def hard_cornering(run, limit_mps2: float = 3.0):
    for name in run.names:
        acceleration = run.table(name, "truth")["lateral_acceleration_mps2"]
        yield from run.spans(name, abs(acceleration) > limit_mps2)

def steering_effort(run, exponent: float = 2.0):
    angles = {name: run.table(name, "truth")["steering_rad"] for name in run.names}
    return {name: (abs(angle) ** exponent).mean() for name, angle in angles.items()}
"""
SETTINGS: Mapping[str, str] = {
    "control.controller": 'control.controller = { use = "mine.PurePursuit", lookahead_s = 1.0 }',
    "control.longitudinal": 'speed.followers = "gap"\n'
    'control.longitudinal = { use = "mine.ConstantTimeGap", gain_per_s = 0.4 }',
    "control.fusion": 'control.fusion = { use = "mine.OnlyCloseSources", distance_m = 15.0 }',
    "control.degradation.reaction": "control.degradation.reaction = "
    '{ use = "mine.BrakeWhenOld", age_s = 0.06 }',
    "links.loss": 'links.loss = { use = "mine.LossOverDistance", reach_m = 60.0 }',
    "links.delay": 'links.delay = { use = "mine.Retransmissions", step_ms = 10.0 }',
    "sending": 'sending = { use = "mine.EveryMetres", step_m = 2.5 }',
    "gnss.errors": 'gnss.errors = [{ use = "mine.Multipath", amplitude_m = 0.05 }]',
    "event": 'event = [{ use = "mine.hard_cornering", limit_mps2 = 0.02 }]',
    "figure": 'figure = [{ use = "mine.steering_effort", exponent = 1.0 }]',
}
"""Lines of a scenario by the key of the plug-in point."""
