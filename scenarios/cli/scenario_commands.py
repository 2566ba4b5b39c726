"""Commands that list, check and write scenarios: list, check, new."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.common_options import json_option, scenario_options
from scenarios.cli.error_lines import MissingExtraError, clear_errors, require

if TYPE_CHECKING:
    from scenarios.definition.scenario import Scenario


@click.command(name="list", epilog="Example: convoy list")
@json_option("Print kinds, names and descriptions as JSON.")
def list_scenarios(*, as_json: bool) -> None:
    """List scenarios, channel presets and drills."""
    import json

    from scenarios.definition.channel.presets import presets, read_preset
    from scenarios.definition.scenario import drills, library, load_scenario

    shipped = {name: load_scenario(name).tables.description for name in library()}
    failures = {name: load_scenario(name).tables.description for name in drills()}
    channels = {name: read_preset(name).description for name in presets()}
    if as_json:
        entries = [
            {"kind": kind, "name": name, "description": description}
            for kind, descriptions in (
                ("scenario", shipped),
                ("channel", channels),
                ("drill", failures),
            )
            for name, description in descriptions.items()
        ]
        click.echo(json.dumps(entries, indent=2))
        return
    groups = (
        ("scenarios, for convoy run:", shipped),
        ("channel presets, for links.preset:", channels),
        ("drills, for convoy drill:", failures),
    )
    width = max(len(name) for _, descriptions in groups for name in descriptions)
    for place, (heading, descriptions) in enumerate(groups):
        click.echo(f"\n{heading}" if place else heading)
        for name, description in descriptions.items():
            click.echo(f"{name:{width}} {description}")


@click.command(
    epilog="""\b
Examples:
  convoy check church_lot
  convoy check my.toml --set speed.set_mps=25 --json
  convoy check lossy_lane_change --explain       the laws of each link
"""
)
@scenario_options
@click.option(
    "--explain", is_flag=True, help="Print each link's rule, laws, loss, delay and data age."
)
@json_option("Print the settings and figures as JSON.")
def check(
    *, scenario: str, overrides: tuple[str, ...], seed: int | None, explain: bool, as_json: bool
) -> None:
    """Check a scenario and list warnings.

    SCENARIO is a shipped name (see `convoy list`), a TOML file, or a recorded drive, such as a GPX
    file. Nothing is simulated.
    """
    import json
    from dataclasses import asdict

    from rich.console import Console

    from scenarios.cli.channel.link_settings import print_links
    from scenarios.cli.guide.check_table import print_report
    from scenarios.definition.check.findings import report_of
    from scenarios.definition.check.link_forecast import link_forecasts
    from scenarios.definition.scenario import load_scenario

    with clear_errors():
        loaded = load_scenario(scenario, overrides, seed)
        report = report_of(loaded)
        warnings = (*report.warnings, *_certificate_warnings(loaded))
        links, receivers = link_forecasts(loaded) if explain else ((), ())
        if as_json:
            figures = asdict(report) | {"warnings": warnings}
            if explain:
                figures["explained"] = [asdict(link) for link in links]
                figures["receivers"] = [asdict(receiver) for receiver in receivers]
            click.echo(json.dumps(figures, indent=2))
            return
        if explain:
            print_links(loaded.name, links, receivers, Console())
        else:
            print_report(report, Console())
        for line in warnings:
            click.echo(f"warning: {line}")


def _certificate_warnings(scenario: "Scenario") -> tuple[str, ...]:
    """Warn if a change of speed has no certificate of the gains, or if SciPy is missing."""
    try:
        require("certificate of the gains", "studies", "scipy")
    except MissingExtraError as error:
        return (str(error),)
    from scenarios.definition.check.steering_loop import certificate_warnings

    return tuple(certificate_warnings(scenario))


@click.command(epilog="Example: convoy new > my.toml")
@click.argument("file", required=False, type=click.Path(dir_okay=False, path_type=Path))
def new(file: Path | None) -> None:
    """Write a commented scenario file.

    The file has the most important keys with their defaults; `convoy reference scenario` lists all
    keys. Without FILE it goes to standard output.
    """
    from scenarios.definition.library import template

    with clear_errors():
        if file is None:
            click.echo(template(), nl=False)
        else:
            with file.open("x", encoding="utf-8") as target:
                target.write(template())
            click.echo(f"written: {file}; run it with: convoy run {file}")
