"""Reference page about plug-ins: shipped classes, and the contract of your own."""

from inspect import getdoc, isfunction, signature
from pkgutil import resolve_name

import click

from scenarios.cli.reference.plug_in_examples import EXAMPLES
from scenarios.cli.reference.printing import print_rows, print_section, print_text
from scenarios.cli.reference.table_keys import key_texts, split_doc
from scenarios.definition.schema.plug_ins.point import PlugInPoint
from scenarios.definition.schema.plug_ins.points import POINTS
from scenarios.definition.schema.plug_ins.table import plug_in_table


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
