"""Reference page about plug-ins: shipped classes, and the contract of your own."""

from collections.abc import Mapping
from dataclasses import dataclass
from inspect import getdoc, isfunction, signature
from pkgutil import resolve_name

import click

from scenarios.cli.table_keys import key_texts, print_rows, print_section, print_text, split_doc
from scenarios.definition.schema.plug_ins.point import PlugInPoint
from scenarios.definition.schema.plug_ins.points import POINTS
from scenarios.definition.schema.plug_ins.table import plug_in_table

# ---- An example of a user-defined class for each plug-in point; the tests run all of them


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
from transport.links.laws.burst_losses import BaseLoss

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
from transport.links.laws.delays import BaseDelay
from transport.links.laws.link_law import Delays

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
from vehicles.car.sending_rules import SendingRule

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
from vehicles.car.gnss_error_terms import ErrorTerm

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


# ---- Plug in page


def plug_ins_page() -> None:
    print_text(
        """
        A plug-in is a class that a scenario selects by its name: a shipped one by its short name,
        your own as "module.Class", from a module in the working folder or an installed one. A
        table has the name as its key `use`, and the parameters of the class as its other keys.

        A class with parameters names a dataclass or a Pydantic model as its attribute `Settings`.
        Its instance is the last argument of the constructor. Unknown keys and wrong types are
        refused. A field of a dataclass may be annotated with a `Setting` of `vehicles.setting`,
        which gives the key a unit and bounds. The parameters of shipped laws of links, sending
        rules and errors are on the pages links, scenario and gnss.

        Controllers, fusions and degradation policies draw random numbers by a parameter `draw` of
        their constructor, which is given by keyword: `draw("mine")` is the number in (0, 1) of a
        purpose at the control instant. It depends on seed, vehicle, key, purpose and instant only,
        so it is the same in each call at that instant, on every clock, and in a replay. Links,
        sending rules and errors of receivers have draws of their own, described below.

        Before a run each class is constructed and called; if this fails or depends on a clock or
        on random numbers of its own, the scenario is refused. During a run, an exception or a
        result that is not finite ends the run with a one-line message, or only its vehicle if
        `convoy.on_vehicle_failure = "continue"`. A digest of the module, with the modules next to
        it that it imports, is part of the identity of the run.
        """
    )
    for point in POINTS:
        _print_point(point)


def _print_point(point: PlugInPoint) -> None:
    print_section(point.key, shipped_texts(point))
    for name in point.shipped if point.base is None else ():
        if texts := parameter_texts(point, name):
            print_section(f"parameters of {name}", texts.items())
    _print_documented("", point.contract)
    for method, arguments in point.methods.items():
        _print_documented(f"{method}({arguments}): ", getattr(point.contract, method))
    for kind in point.types:
        _print_documented(f"{kind.__name__}: ", kind)
        for name, method in vars(kind).items() if is_protocol(kind) else ():
            if isfunction(method) and not name.startswith("_"):
                arguments = ", ".join(list(signature(method).parameters)[1:])
                _print_documented(f"{name}({arguments}): ", method)
    example = EXAMPLES[point.key]
    click.echo(
        f"\nExample, mine.py:\n\n{example.code}\nIn the scenario:\n\n{example.toml.rstrip()}"
    )


def parameter_texts(point: PlugInPoint, name: str) -> dict[str, str]:
    """Documentation, values and default of each parameter of a shipped class."""
    texts = key_texts(plug_in_table(point, name))
    return {key: text for key, text in texts.items() if key != "use"}


def is_protocol(kind: type) -> bool:
    return bool(getattr(kind, "_is_protocol", False))


def _print_documented(name: str, documented: object) -> None:
    """Print a docstring after a name, with its list of attributes or arguments as rows."""
    text, rows = split_doc(getdoc(documented) or "")
    click.echo()
    print_text(f"{name}{text}")
    if rows:
        click.echo()
        print_rows(rows.items())


def shipped_texts(point: PlugInPoint) -> list[tuple[str, str]]:
    """Name and first sentence of each shipped class."""
    return [
        (name, (getdoc(resolve_name(place)) or "").partition("\n\n")[0].replace("\n", " "))
        for name, place in point.shipped.items()
    ]
