"""Shell completion, and its speed."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete

from scenarios.cli.guide.completion import OWN_FILES
from scenarios.cli.main import EXAMPLES, cli
from scenarios.definition.channel.presets import presets
from scenarios.definition.library import template
from scenarios.definition.overrides import parse_override
from scenarios.definition.scenario import library, load_scenario
from scenarios.definition.traces.formats.registry import TEXT_FORMATS

MINE = 'extends = "lane_change"\nname = "mine"\n[convoy]\nnames = ["ann", "bob"]\n'


def offered(*words: str) -> list[str]:
    """Completions of the last word of a command line."""
    *before, begun = words
    shell = ShellComplete(cli, {}, "convoy", "_CONVOY_COMPLETE")
    return [item.value for item in shell.get_completions(before, begun) if item.type == "plain"]


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder with one scenario and one recorded drive."""
    (tmp_path / "mine.toml").write_text(MINE, encoding="utf-8")
    (tmp_path / "ride.gpx").touch()
    (tmp_path / "notes.md").touch()
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("command", ["run", "check", "record", "vehicle"])
def test_shipped_scenarios_and_files_are_offered(command: str) -> None:
    assert offered(command, "") == [*library(), "mine.toml", "ride.gpx"]
    assert offered(command, "lo") == ["lossy_lane_change"]


def test_offered_drives_can_be_read() -> None:
    known = {suffix for one in TEXT_FORMATS for suffix in one.suffixes}
    assert {*OWN_FILES} - known == {".toml", ".mcap"}


def test_channels_and_links_are_offered() -> None:
    assert offered("channel", "show", "lte") == [
        "lte_v2x_dense", "lte_v2x_light", "lte_v2x_oneshot",
    ]  # fmt: skip
    assert {*presets(), *library(), "mine.toml", "ride.gpx"} == {*offered("channel", "show", "")}
    assert offered("channel", "show", "mine.toml", "--link", "") == ["ann:bob"]
    assert offered("channel", "show", "bursty", "--link", "v2") == ["v2:v3"]
    assert offered("run", "--set", "links.preset=bu") == ["links.preset=bursty"]


def test_information_flows_and_their_links_are_offered() -> None:
    lateral = "information_flow.lateral"
    assert offered("run", "--set", f"{lateral}=pre") == [f"{lateral}=predecessor"]
    assert f"{lateral}.ahead=" in offered("run", "--set", lateral)
    words = offered("run", "--set", "vehicle.v3.information_flow.longitudinal=")
    assert "vehicle.v3.information_flow.longitudinal=bidirectional" in words
    flow = ("--set", "information_flow.longitudinal=bidirectional")
    assert offered("channel", "show", "lane_change", *flow, "--link", "v4") == ["v4:v3"]


def test_vehicles_are_those_of_the_given_scenario() -> None:
    assert offered("vehicle", "--name", "") == ["v1", "v2", "v3", "v4"]
    assert offered("vehicle", "mine.toml", "--name", "a") == ["ann"]
    assert offered("vehicle", "--set", "convoy.vehicles=2", "--name", "") == ["v1", "v2"]
    assert offered("vehicle", "nowhere.toml", "--name", "") == []


def test_keys_of_a_scenario_are_offered_for_set() -> None:
    keys = offered("run", "--set", "")
    assert {"seed=", "links.loss_ratio=", "limits.collisions_max=", "path.laps="} <= {*keys}
    assert "vehicle.v3.control.gains.yaw_rate_s=" in keys
    assert "link.0.sender=" in keys
    assert offered("check", "--set", "convoy.g") == ["convoy.gap_m="]
    assert offered("run", "--set", "vehicle.b") == []
    assert "vehicle.bob.gap_m=" in offered("run", "mine.toml", "--set", "vehicle.b")


def test_limits_of_all_vehicles_and_of_each_are_offered() -> None:
    assert "lane" in offered("bisect", "--limit", "la")
    assert offered("bisect", "mine.toml", "--limit", "bob.g") == ["bob.gap_m="]
    assert offered("run", "--set", "limits.v3.tr") == ["limits.v3.true_gap_m_min="]
    assert not [key for key in offered("run", "--set", "limits.v3.") if "modes" in key]


def test_every_commented_key_of_the_template_is_offered() -> None:
    keys = {key.rstrip("=") for key in offered("run", "--set", "")}
    for table in ("convoy", "speed", "control", "gnss", "links", "limits", "loading"):
        assert f"[{table}]" in template()
        assert any(key.startswith(f"{table}.") for key in keys)


def test_a_complete_key_is_offered_with_its_values() -> None:
    fusions = ["composite", "blend"]
    assert offered("run", "--set", "control.fu") == [f"control.fusion={one}" for one in fusions]
    assert offered("run", "--set", "control.fusion=b") == ["control.fusion=blend"]
    assert offered("run", "--set", "links.loss_") == ["links.loss_ratio=0.0"]
    kinds = offered("run", "--set", "links.loss.kind")
    assert {"links.loss.kind=none", "links.loss.kind=four_state"} < {*kinds}
    assert "control.controller=stanley" in offered("run", "--set", "control.controller=")


def test_offered_values_are_accepted() -> None:
    for begun in ("control.fu", "links.loss_", "control.knows", "gnss.rate", "events.path"):
        for setting in offered("run", "--set", begun):
            parse_override(setting)
            load_scenario("lane_change", [setting])


def test_viewers_are_offered() -> None:
    assert offered("run", "--rerun", "s") == ["spawn", "serve", "save="]


BASH = """
{line}
press() {{ COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)) COMPREPLY=(); _convoy_completion convoy; }}
press convoy run --set imu.yaw_rate_; echo "${{COMPREPLY[@]}}"
press convoy run --set control.fusion = b; echo "${{COMPREPLY[@]}}"
press convoy run --set = convoy.on_v; echo "${{COMPREPLY[@]}}"
press convoy run --set = links.loss_ratio = 0.1 lo; echo "${{COMPREPLY[@]}}"
"""
"""Bash splits words at `=` and completes the last part."""


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_bash_completes_with_the_line_of_the_help(tmp_path: Path) -> None:
    (line,) = re.findall(r"^ +(eval .*bash_source.*?)  ", EXAMPLES, re.MULTILINE)
    command = tmp_path / "convoy"
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -m scenarios.cli "$@"\n')
    command.chmod(0o755)
    path = f"{tmp_path}:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", BASH.format(line=line)],
        env=os.environ | {"PATH": path}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout.splitlines() == [
        "imu.yaw_rate_noise_radps= imu.yaw_rate_bias_radps=",
        "blend",
        "convoy.on_vehicle_failure=end convoy.on_vehicle_failure=continue",
        "lossy_lane_change",
    ], done.stderr


@pytest.mark.spread(3)
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("run --set links.loss_", "links.loss_ratio=0.0"),
        ("channel show burs", "bursty"),
        ("run --set links.preset=nlosv_e", "nlosv_etsi"),
    ],
)
def test_the_script_of_a_shell_loads_no_simulation(shell: str, words: str, found: str) -> None:
    code = "import sys; from scenarios.cli.main import cli\ntry: cli(prog_name='convoy')\n"
    code += "finally: print(*sys.modules, file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {
            "_CONVOY_COMPLETE": f"{shell}_complete",
            "COMP_WORDS": f"convoy {words}",
            "COMP_CWORD": words.rsplit(maxsplit=1)[-1] if shell == "fish" else "3",
        },
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert found in done.stdout, done.stderr
    loaded = {name.split(".")[0] for name in done.stderr.split()}
    assert not {"scipy", "zenoh", "rerun", "mcap", "rich", "psutil"} & loaded
