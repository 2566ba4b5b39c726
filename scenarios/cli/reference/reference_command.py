"""`convoy reference`, and the list of pages."""

from collections.abc import Callable, Mapping
from typing import Any

import click

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
    from scenarios.cli.reference import (
        drives_page,
        message_pages,
        other_pages,
        plug_in_page,
        scenario_pages,
        string_page,
    )

    return {
        "scenario": scenario_pages.scenario_page,
        "drives": drives_page.drives_page,
        "links": scenario_pages.links_page,
        "presets": scenario_pages.presets_page,
        "gnss": scenario_pages.gnss_page,
        "degradation": scenario_pages.degradation_page,
        "limits": scenario_pages.limits_page,
        "topics": message_pages.topics_page,
        "wire": message_pages.wire_page,
        "reasons": message_pages.reasons_page,
        "fields": other_pages.fields_page,
        "plug-ins": plug_in_page.plug_ins_page,
        "string-stability": string_page.string_stability_page,
        "intervals": other_pages.intervals_page,
        "exit-codes": other_pages.exit_codes_page,
        ".proto": message_pages.proto_page,
    }
