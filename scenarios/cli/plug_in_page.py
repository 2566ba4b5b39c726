"""Reference page about plug-ins: shipped classes, and the contract of your own."""

from inspect import getdoc, getsourcefile, isfunction
from pathlib import Path
from pkgutil import resolve_name

import click

from scenarios.cli.table_keys import key_texts, print_rows, print_section, print_text, split_doc
from scenarios.definition.schema.plug_ins.point import ROOT, PlugInPoint, signature_of
from scenarios.definition.schema.plug_ins.points import POINTS
from scenarios.definition.schema.plug_ins.table import plug_in_table

EXAMPLE = """\
from vehicles.driver.steering import SteeringCommand

class PurePursuit:
    def __init__(self, parameters, gains, lookahead_s: float = 0.8):
        self.wheelbase, self.lookahead_s = parameters.wheelbase, lookahead_s

    def steer(self, errors, speed):
        ahead = max(self.lookahead_s * speed, 4.0)
        turn = 2 * (-errors.lateral - ahead * errors.heading) / ahead**2
        feedforward = self.wheelbase * errors.curvature
        feedback = self.wheelbase * turn
        return SteeringCommand(feedforward + feedback, feedforward, feedback)

def steering_effort(run, exponent: float = 2.0):
    efforts = {}
    for name in run.names:
        angle = run.table(name, "truth")["steering_rad"]
        efforts[name] = (abs(angle) ** exponent).mean()
    return efforts

def hard_cornering(run, limit_mps2: float = 3.0):
    for name in run.names:
        acceleration = run.table(name, "truth")["lateral_acceleration_mps2"]
        yield from run.spans(name, abs(acceleration) > limit_mps2)
"""
EXAMPLE_TOML = """\
[control.controller]
use = "mine.PurePursuit"
lookahead_s = 1.0

[[figure]]
use = "mine.steering_effort"
exponent = 1.0

[[event]]
use = "mine.hard_cornering"
limit_mps2 = 0.02
"""


def plug_ins_page() -> None:
    print_text(
        """
        A plug-in is a class or a function that a scenario selects by its name: a shipped one by its
        short name, your own as "module.name", from a module in the working folder or an installed
        one. A table has the name as its key `use`, and the parameters as its other keys.

        The parameters are the arguments of the constructor or the function after those that the
        contract names. Unknown keys and wrong types are refused. An argument may be annotated with
        a `Setting` of `vehicles.setting`, which gives the key a unit and bounds; a single argument
        that is a dataclass stands for its fields. Link models, sending rules and errors of
        receivers are the dataclass or the Pydantic model of their parameters; those of the shipped
        ones are on the pages links, scenario and gnss.

        Controllers, fusions and degradation policies draw random numbers by a parameter `draw` of
        their constructor: `draw("mine")` is the number in (0, 1) of a purpose at the control
        instant. It depends on seed, vehicle, key, purpose and instant only, so it is the same in
        each call at that instant, on every clock, and in a replay. Do not use a clock or random
        numbers of your own.

        An exception or an unfit result, such as a number that is not finite, ends the run with the
        vehicle, the instant, the file and the line, or only its vehicle if
        `convoy.on_vehicle_failure = "continue"`. A function of an event or a figure that fails is
        left out with a warning. A digest of the module is part of the identity of the run.
        """
    )
    click.echo(f"\nExample, mine.py:\n\n{EXAMPLE}\nIn the scenario:\n\n{EXAMPLE_TOML.rstrip()}")
    for point in POINTS:
        _print_point(point)


def _print_point(point: PlugInPoint) -> None:
    print_section(point.key, shipped_texts(point))
    for name in point.shipped if point.base is None else ():
        texts = key_texts(plug_in_table(point, name))
        del texts["use"]
        if texts:
            print_section(f"parameters of {name}", texts.items())
    _print_documented("", point.contract)
    for kind in (point.contract, *point.types):
        if kind is not point.contract:
            _print_documented(f"{kind.__name__}: ", kind)
        is_protocol = getattr(kind, "_is_protocol", False)
        methods = [name for name, value in vars(kind).items() if isfunction(value)]
        for name in methods if is_protocol or kind is point.contract else ():
            if not name.startswith("_"):
                signature = signature_of(kind, name)
                _print_documented(f"{name}{signature}: ", getattr(kind, name))
    files = dict.fromkeys(getsourcefile(resolve_name(place)) for place in point.shipped.values())
    if names := [str(Path(file).relative_to(ROOT)) for file in files if file]:
        click.echo()
        print_text(f"Examples are the shipped ones, in {', '.join(names)}.")


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
