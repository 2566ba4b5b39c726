"""Commands that look at channels: a law against a sample, and the laws of recorded links."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.channel.campaign_commands import cuts, figure
from scenarios.cli.common_options import new_file_option, print_or_write, setting_options
from scenarios.cli.error_lines import clear_errors, require
from scenarios.cli.guide import completion

if TYPE_CHECKING:
    from collections.abc import Iterable

    from scenarios.definition.scenario import Scenario
    from scenarios.studies.channel.fitting.fit import FittedLink

NEAREST_M, FARTHEST_M = 1.0, 100_000.0


@click.group(
    epilog="""\b
Examples:
  convoy channel show bursty
  convoy channel fit run.mcap
  convoy channel figure
  convoy channel cuts
"""
)
def channel() -> None:
    """Look at channels: laws against samples, laws of recorded links, what they cost a convoy."""


channel.add_command(figure)
channel.add_command(cuts)


@channel.command(
    epilog="""\b
Examples:
  convoy channel show bursty
  convoy channel show ieee80211p_dense --distance-m 120
  convoy channel show my.toml --link v1:v3 --out v1-v3.png
"""
)
@click.option(
    "--link", metavar="SENDER:RECEIVER", shell_complete=completion.links,
    help="Which link; by default from the lead to the last vehicle.",
)  # fmt: skip
@click.option(
    "--messages", type=click.IntRange(100, 1_000_000), default=20_000, show_default=True,
    help="How many to draw.",
)  # fmt: skip
@click.option(
    "--distance-m", type=float, default=50.0, show_default=True,
    help="How far sender and receiver drive from one another, on a straight road.",
)  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="The figures as JSON.")
@click.option(
    "--out", type=click.Path(dir_okay=False, path_type=Path), metavar="PNG",
    help="Draw a picture, too.",
)  # fmt: skip
@setting_options
@click.argument("scenario", metavar="PRESET|SCENARIO", shell_complete=completion.channels)
def show(
    *,
    scenario: str,
    overrides: tuple[str, ...],
    seed: int | None,
    link: str | None,
    messages: int,
    distance_m: float,
    as_json: bool,
    out: Path | None,
) -> None:
    """Hold the laws of a shipped channel, or of a link of a scenario, against a sample.

    The sample is drawn by the very effects of a run: both ends drive on a straight road, the
    vehicles in between evenly in the line of sight.
    """
    import json
    from dataclasses import asdict

    from rich.console import Console

    from scenarios.cli.channel.comparison_tables import print_comparison
    from scenarios.definition.check.link_sample import StraightDrive
    from scenarios.definition.errors import ScenarioError
    from scenarios.studies.channel.comparison import compare

    with clear_errors():
        if out is not None:
            require("channel show --out", "studies", "matplotlib")
        if not NEAREST_M <= distance_m <= FARTHEST_M:  # nor NaN
            allowed = f"allowed {NEAREST_M:g} to {FARTHEST_M:g} m"
            raise ScenarioError([f"--distance-m: given {distance_m}, {allowed}"])
        loaded = _loaded(scenario, overrides, seed)
        chosen = _selected_link(link, loaded)
        drive = StraightDrive(loaded, chosen, distance_m)
        found, sample = compare(drive, messages)
        if out is not None:
            from scenarios.studies.channel.picture import draw

            draw(found, sample, out)
        if as_json:
            click.echo(json.dumps(asdict(found), indent=2))
            return
        print_comparison(scenario, loaded, found, Console())
        if out is not None:
            click.echo(f"written: {out}")


def _loaded(name: str, overrides: tuple[str, ...], seed: int | None) -> "Scenario":
    """Load a scenario, or a shipped channel in the default one; raises ScenarioError."""
    from scenarios.definition.channel.presets import presets
    from scenarios.definition.error_messages import did_you_mean, toml_repr
    from scenarios.definition.errors import ScenarioError
    from scenarios.definition.scenario import library, load_scenario

    if name in presets():
        return load_scenario(completion.DEFAULT, [f"links.preset={name}", *overrides], seed)
    if name not in library() and not Path(name).exists():
        close = did_you_mean(name, (*presets(), *library()))
        channels, scenarios = ", ".join(presets()), ", ".join(library())
        raise ScenarioError(
            [f"no channel or scenario {toml_repr(name)}{close}, allowed {channels}, {scenarios}"]
        )
    return load_scenario(name, overrides, seed)


def _selected_link(given: str | None, scenario: "Scenario") -> tuple[str, str]:
    """Return the requested link; raises ScenarioError if it does not exist."""
    names, links = scenario.vehicle_names, scenario.links
    if given is None and (names[0], names[-1]) in links:
        return names[0], names[-1]
    return _selected_links(given, list(links), scenario.name)[0]


def _selected_links(
    given: str | None, links: "Iterable[tuple[str, str]]", where: str
) -> list[tuple[str, str]]:
    """Return all links, or the one given as sender:receiver; raises ScenarioError."""
    from scenarios.definition.error_messages import toml_repr
    from scenarios.definition.errors import ScenarioError

    known = {f"{sender}:{receiver}": (sender, receiver) for sender, receiver in links}
    if not known:
        raise ScenarioError([f"{where}: has no links"])
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
@click.option("--link", metavar="SENDER:RECEIVER", help="Only this link.")
@click.option("--json", "as_json", is_flag=True, help="Keys and estimates as JSON.")
@new_file_option
def fit(log: Path, *, link: str | None, as_json: bool, out: Path | None) -> None:
    """Find the laws of the links of a recorded LOG, as a block for a scenario, with intervals."""
    with clear_errors():
        require("channel fit", "studies", "scipy")
    from scenarios.results.log_summary import log_in
    from scenarios.studies.channel.fitting.fit import as_toml, fit_log

    with clear_errors():
        found = {(one.sender, one.receiver): one for one in fit_log(log_in(log))}
        chosen = tuple(found[pair] for pair in _selected_links(link, found, str(log)))
        print_or_write(_as_json(chosen) if as_json else as_toml(chosen), out)


def _as_json(links: "tuple[FittedLink, ...]") -> str:
    import json
    from dataclasses import asdict
    from math import isfinite

    def finite(figures: "dict[str, object]") -> "dict[str, object]":
        """Replace unbounded ends of intervals by None."""
        return {
            key: None if isinstance(value, float) and not isfinite(value) else value
            for key, value in figures.items()
        }

    found = [
        asdict(one) | {"estimates": [finite(asdict(e)) for e in one.estimates]} for one in links
    ]
    return json.dumps(found, indent=2) + "\n"
