"""The table of `convoy check`."""

import json
import re

import pytest
from click.testing import CliRunner

from scenarios.cli.main import cli
from scenarios.definition.scenario import library, load_scenario, scenario_from_text

SETTINGS = {
    "links.loss_ratio=0.2": ("requested channel", "loss 20 %, 1.25 in a row; delay 20 ms"),
    "links.jitter_ms=12": ("requested channel", "delay 26 ± 3.46 ms"),
    "links.preset=bursty": ("requested channel", "loss 20 %, 8 in a row"),
    "links.preset=tunnel": ("requested channel", "loss not predictable"),
    'link=[{sender="v1",receiver="v3",loss_ratio=0.3}]': (
        "requested channel", "loss 30 %, .*: v1 → v3",
    ),
    "convoy.gap_m=7": ("gaps at the start", "7, 7, 7 m"),
    "speed.set_mps=20": ("distance driven", "700 m"),
}  # fmt: skip
"""Settings, and the row of a figure that each changes."""


def checked(*arguments: str) -> str:
    result = CliRunner().invoke(cli, ["check", *arguments], env={"COLUMNS": "80"})
    assert result.exit_code == 0, result.output
    return result.stdout


def rows(text: str) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for line in text.splitlines()[1:]:
        what, figure = line[:26].strip(), line[26:].strip()
        if what or not found:
            found.append((what, figure))
        else:
            found[-1] = found[-1][0], f"{found[-1][1]} {figure}"
    return found


@pytest.mark.parametrize("setting", SETTINGS)
def test_a_setting_changes_its_figure(setting: str) -> None:
    what, expected = SETTINGS[setting]
    found = rows(checked("lane_change", "--set", setting))
    values = [figure for row, figure in found if row == what]
    assert any(re.search(expected, figure) for figure in values), found


@pytest.mark.parametrize("name", library())
def test_no_line_is_empty_or_wider_than_a_terminal(name: str) -> None:
    lines = checked(name).splitlines()
    assert all(line.strip() for line in lines)
    assert max(map(len, lines)) <= 80 or lines[-1].startswith("warning: ")


def test_the_resolved_scenario_is_one_that_runs() -> None:
    resolved = checked("church_lot", "--resolved", "--set", "limits.near_misses_max=3")
    again = scenario_from_text(resolved)
    assert again.tables == load_scenario("church_lot", ["limits.near_misses_max=3"]).tables
    figures = json.loads(checked("church_lot", "--json"))
    assert figures["channel"]["v1 → v2"]["latency_ms_mean"] == 20.0
