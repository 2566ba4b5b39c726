"""Commands that list, check and write scenarios: list, check, new."""

from pathlib import Path

import click

from scenarios.cli.common_options import json_option, scenario_options
from scenarios.cli.error_lines import clear_errors


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
  convoy check drive.gpx --out drive.svg         a drive of your own, with a picture
"""
)
@scenario_options
@click.option(
    "--explain", is_flag=True, help="Print JSON with each link's rule, laws, loss, delay and age."
)
@click.option(
    "-o",
    "--output",
    "--out",
    "output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Draw the recorded drive of the path into a new PNG, SVG or PDF file.",
)
@json_option("Print the settings and figures as JSON.")
def check(
    *,
    scenario: str,
    overrides: tuple[str, ...],
    seed: int | None,
    explain: bool,
    output: Path | None,
    as_json: bool,
) -> None:
    """Check a scenario and list warnings.

    SCENARIO is a shipped name (see `convoy list`), a TOML file, or a recorded drive, such as a GPX
    file. Of a drive it also reports length, rate, noise, holes, pauses and what is left out, even
    if it cannot be driven. Nothing is simulated.
    """
    from scenarios.cli.guide.checking import check_scenario

    with clear_errors():
        check_scenario(scenario, overrides, seed, explain=explain, output=output, as_json=as_json)


@click.command(epilog="Example: convoy new > my.toml")
@click.argument("file", required=False, type=click.Path(dir_okay=False, path_type=Path))
def new(file: Path | None) -> None:
    """Write a commented scenario file.

    The file has the most important keys with their defaults; `convoy reference scenario` lists all
    keys. Without FILE it goes to standard output.
    """
    from scenarios.definition.library import template
    from scenarios.results.files import write_whole

    with clear_errors():
        if file is None:
            click.echo(template(), nl=False)
        else:
            write_whole(file, template().encode(), new=True)
            click.echo(f"written: {file}; run it with: convoy run {file}")
