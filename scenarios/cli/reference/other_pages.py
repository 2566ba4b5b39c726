"""Reference pages about summaries, controllers and exit codes."""

from inspect import getdoc
from pkgutil import resolve_name

import click

from scenarios.cli.reference.printing import print_section, print_text
from scenarios.definition.schema.scenario_tables import CONTROLLERS
from scenarios.results.summary import documented_fields
from scenarios.runs.stop import EXIT_CODES
from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.driver.steering import LateralController, SteeringCommand
from vehicles.driver.tracking import TrackingErrors


def fields_page() -> None:
    print_text(
        "Fields of summary.json and of `convoy report --json`. A field is null where nothing was "
        "measured."
    )
    for group, docs in documented_fields().items():
        print_section(group, docs.items())


def controllers_page() -> None:
    print_text(
        'control.controller names a shipped controller, or a class of your own as "module.Class" '
        "in the working folder."
    )
    print_section("shipped controllers", controller_texts())
    click.echo()
    print_text(getdoc(LateralController) or "")
    click.echo()
    print_text(f"steer(errors, speed): {getdoc(LateralController.steer)}")
    for kind in (TrackingErrors, SteeringCommand, VehicleParameters, Gains):
        click.echo()
        print_text(f"{kind.__name__}: {getdoc(kind)}")


def controller_texts() -> list[tuple[str, str]]:
    """Name and first sentence of each shipped controller."""
    return [
        (name, (getdoc(resolve_name(place)) or "").partition("\n\n")[0].replace("\n", " "))
        for name, place in CONTROLLERS.items()
    ]


def exit_codes_page() -> None:
    print_text("Exit codes of all commands.")
    print_section("exit codes", [(str(code), meaning) for code, meaning in EXIT_CODES.items()])
