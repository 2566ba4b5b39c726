"""Commands that list, check and write scenarios: list, check, new."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click

from scenarios.cli.common_options import json_option, scenario_options
from scenarios.cli.output import clear_errors

# ---- `convoy reference`, and the list of pages


PAGES: Mapping[str, str] = {
    "scenario": "keys of all other tables of a scenario file",
    "drives": "formats, columns and keys of recorded drives",
    "links": "keys of [links] and [[link]]; laws with parameters and sources",
    "presets": "shipped channels and their sources",
    "gnss": "keys of [gnss]; presets of the receiver",
    "degradation": "keys of [control.degradation]",
    "limits": "keys of [limits], and words of --limit",
    "topics": "messages of a log, with their fields",
    "wire": "Zenoh keys, encoding, liveliness, clock and control queries",
    "reasons": "reasons for which messages are not used",
    "fields": "fields of summary.json and `convoy report --json`",
    "plug-ins": "classes that a scenario selects, and the contract of your own",
    "string-stability": "definitions of the gains along the string of vehicles",
    "intervals": "methods and coverage of the intervals of studies",
    "exit-codes": "exit codes of all commands",
    ".proto": "the Protobuf schema of messages and logs",
}
ALIASES = {"controller": "plug-ins", "controllers": "plug-ins", "proto": ".proto"}


class PageName(click.Choice[str]):
    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        return super().convert(ALIASES.get(value, value), param, ctx)


@click.command(
    epilog="""\b
Examples:
  convoy reference                               the list of pages
  convoy reference links
  convoy reference fields | less
  convoy reference .proto > convoy.proto
"""
)
@click.argument("page", type=PageName(list(PAGES)), metavar="[PAGE]", required=False)
def reference(page: str | None) -> None:
    """Print a reference page.

    Without PAGE, lists the pages.
    """
    if page is not None:
        printers()[page]()
        return
    for name, about in PAGES.items():
        click.echo(f"{name:16} {about}")


def printers() -> Mapping[str, Callable[[], None]]:
    from scenarios.cli import pages, plug_in_page, scenario_pages

    return {
        "scenario": scenario_pages.scenario_page,
        "drives": pages.drives_page,
        "links": scenario_pages.links_page,
        "presets": scenario_pages.presets_page,
        "gnss": scenario_pages.gnss_page,
        "degradation": scenario_pages.degradation_page,
        "limits": scenario_pages.limits_page,
        "topics": pages.topics_page,
        "wire": pages.wire_page,
        "reasons": pages.reasons_page,
        "fields": pages.fields_page,
        "plug-ins": plug_in_page.plug_ins_page,
        "string-stability": pages.string_stability_page,
        "intervals": pages.intervals_page,
        "exit-codes": pages.exit_codes_page,
        ".proto": pages.proto_page,
    }


# ---- Scenario commands


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
  convoy check drive.gpx --out drive.svg         a drive of your own, with a picture
"""
)
@scenario_options
@click.option(
    "-o",
    "--output",
    "--out",
    "output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Draw the recorded drive of the path into a new PNG, SVG or PDF file.",
)
@click.option("--resolved", is_flag=True, help="Print the scenario as TOML with all its settings.")
@json_option("Print the figures and warnings as JSON.")
def check(
    *,
    scenario: str,
    overrides: tuple[str, ...],
    seed: int | None,
    output: Path | None,
    resolved: bool,
    as_json: bool,
) -> None:
    """Check a scenario and list warnings.

    SCENARIO is a shipped name (see `convoy list`), a TOML file, or a recorded drive, such as a GPX
    file. Of a drive it also reports length, rate, noise, holes, pauses and what is left out, even
    if it cannot be driven. Nothing is simulated but the braking of the lead that the gaps hold.
    """
    from scenarios.cli.check_tables import check_scenario

    with clear_errors():
        check_scenario(scenario, overrides, seed, output=output, as_json=as_json, resolved=resolved)


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
