"""`convoy channel show` and `convoy channel fit`."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli import common_options
from scenarios.cli.common_options import (
    FiniteRange,
    json_option,
    link_option,
    output_option,
    partial_option,
    print_or_write,
    setting_options,
)
from scenarios.cli.output import clear_errors, warn_of_log
from scenarios.definition.errors import require
from scenarios.results.files import json_text

if TYPE_CHECKING:
    from collections.abc import Iterable

    from scenarios.definition.scenario import Scenario


DEFAULT = "lane_change"
"""Scenario in which a preset is shown."""
NEAREST_M, FARTHEST_M = 1.0, 100_000.0


@click.group(
    epilog="""\b
Examples:
  convoy channel show bursty
  convoy channel fit run.mcap
"""
)
def channel() -> None:
    """Inspect channels and fit them to runs."""


@channel.command(
    epilog="""\b
Examples:
  convoy channel show bursty
  convoy channel show ieee80211p_dense --distance-m 120
  convoy channel show my.toml --link v1:v3
"""
)
@link_option("Link of the scenario. Default: from the lead to the last vehicle.")
@click.option(
    "--messages", type=click.IntRange(100, 1_000_000), default=20_000, show_default=True,
    metavar="N", help="Number of messages in the sample.",
)  # fmt: skip
@click.option(
    "--distance-m", type=FiniteRange(NEAREST_M, FARTHEST_M), default=50.0, show_default=True,
    metavar="M", help="Distance between sender and receiver in m.",
)  # fmt: skip
@json_option("Print the figures as JSON.")
@setting_options
@click.argument("scenario", metavar="PRESET|SCENARIO", shell_complete=common_options.scenarios)
def show(
    *,
    scenario: str,
    overrides: tuple[str, ...],
    seed: int | None,
    link: str | None,
    messages: int,
    distance_m: float,
    as_json: bool,
) -> None:
    """Compare a channel's laws with a sample.

    Draws messages over a shipped channel PRESET or a link of SCENARIO, and compares them with the
    figures that its laws predict. Both vehicles drive on a straight road. Vehicles between them are
    evenly spaced on the line of sight.
    """
    from rich.console import Console

    from scenarios.cli.comparison_tables import print_comparison
    from scenarios.definition.check.link_forecast import StraightDrive
    from scenarios.studies.channel.comparison import compare

    with clear_errors():
        loaded = _loaded(scenario, overrides, seed)
        chosen = _selected_link(link, loaded)
        drive = StraightDrive(loaded, chosen, distance_m)
        found, _ = compare(drive, messages)
        if as_json:
            click.echo(json_text(found), nl=False)
            return
        print_comparison(scenario, loaded, found, Console())


def _loaded(name: str, overrides: tuple[str, ...], seed: int | None) -> "Scenario":
    """Load a scenario, or a shipped channel in the default one; raises ScenarioError."""
    from scenarios.definition.channel.presets import presets
    from scenarios.definition.errors import ScenarioError
    from scenarios.definition.scenario import library, load_scenario
    from scenarios.definition.wording import did_you_mean, toml_repr

    if name in presets():
        return load_scenario(DEFAULT, [f"links.preset={name}", *overrides], seed)
    if name not in library() and not Path(name).exists():
        close = did_you_mean(name, (*presets(), *library()))
        channels, scenarios = ", ".join(presets()), ", ".join(library())
        raise ScenarioError(
            [f"no preset or scenario {toml_repr(name)}{close}, allowed {channels}, {scenarios}"]
        )
    return load_scenario(name, overrides, seed)


def _selected_link(given: str | None, scenario: "Scenario") -> tuple[str, str]:
    """Return the requested link; raises ScenarioError if it does not exist."""
    names, links = scenario.vehicle_names, scenario.links
    if given is None and (names[0], names[-1]) in links:
        return names[0], names[-1]
    return _selected_links(given, list(links), scenario.name)[0]


def _selected_links(
    given: str | None, links: "Iterable[tuple[str, str]]", place: str
) -> list[tuple[str, str]]:
    """Return all links, or the one given as sender:receiver; raises ScenarioError."""
    from scenarios.definition.errors import ScenarioError
    from scenarios.definition.wording import toml_repr

    known = {f"{sender}:{receiver}": (sender, receiver) for sender, receiver in links}
    if not known:
        raise ScenarioError([f"{place}: has no links"])
    if given is None:
        return [*known.values()]
    if given not in known:
        raise ScenarioError([f"--link: given {toml_repr(given)}, allowed {', '.join(known)}"])
    return [known[given]]


@channel.command(
    epilog="""\b
Examples:
  convoy channel fit runs/20260101-120000-lossy_lane_change
  convoy channel fit run.mcap --link v1:v3 -o v1-v3.toml
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@link_option("Fit this link only.")
@json_option("Print keys and estimates as JSON.")
@output_option("Write the result to this new file instead of standard output.")
@partial_option
def fit(log: Path, *, link: str | None, as_json: bool, output: Path | None, partial: bool) -> None:
    """Fit channel laws to a recorded run.

    LOG is a run.mcap or its folder. Prints a TOML block that reproduces the links in a scenario,
    with confidence intervals of the estimates.
    """
    with clear_errors():
        require("channel fit", "studies", "scipy")
    from scenarios.results.log_summary import log_in
    from scenarios.studies.channel.fit import as_toml, fit_log

    with clear_errors():
        found = {(one.sender, one.receiver): one for one in fit_log(log_in(log), partial=partial)}
        chosen = tuple(found[pair] for pair in _selected_links(link, found, str(log)))
        warn_of_log(chosen[0].log_faults)
        print_or_write(json_text(chosen) if as_json else as_toml(chosen), output)
