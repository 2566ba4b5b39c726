"""`convoy channel show` and `fit`, and the laws in `convoy check`."""

import json
import re
import shlex
import sys
import tomllib
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.definition.channel.presets import presets
from scenarios.definition.scenario import load_scenario
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from transport.links.laws.burst_losses import GilbertElliott

QUICK = ("--messages", "1000")


def convoy(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, [*map(str, arguments)], env={"COLUMNS": "80"})


def printed(*arguments: str | Path) -> str:
    result = convoy(*arguments)
    assert result.exit_code == 0, (result.output, result.exception)
    return result.stdout


def refused(*arguments: str | Path) -> str:
    result = convoy(*arguments)
    assert result.exit_code == 2, (result.output, result.exception)
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ")
    return line.removeprefix("error: ")


@pytest.fixture(scope="module")
def bursty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run over a bursty channel."""
    folder = tmp_path_factory.mktemp("runs") / "bursty"
    run_virtual(
        load_scenario("lane_change", ["links.preset=bursty", "duration_s=12"]), folder, Stop()
    )
    return folder


# ---- Help


@pytest.mark.parametrize("name", ["show", "fit"])
def test_examples_in_help_parse(name: str) -> None:
    group = cli.commands["channel"]
    assert isinstance(group, click.Group)
    command = group.commands[name]
    shown = re.findall(
        rf"^ +convoy channel {name} (.*)", printed("channel", name, "--help"), re.MULTILINE
    )
    assert shown
    for line in shown:
        with command.make_context(name, shlex.split(line)):
            pass
    options = [one for one in command.params if isinstance(one, click.Option)]
    assert all(one.help for one in options)


# ---- show


@pytest.mark.spread(5)
@pytest.mark.parametrize("name", presets())
def test_a_channel_is_shown_on_a_terminal(name: str) -> None:
    lines = printed("channel", "show", name, *QUICK).splitlines()
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert lines[0] == f"{name}, v1 → v4"
    assert "source: " in text
    assert "mean delay" in text
    assert ("received over" in text) == name.startswith(("ieee", "lte", "nlosv"))


def test_json_has_the_figures_of_law_and_sample() -> None:
    arguments = ("channel", "show", "bursty", "--link", "v2:v3", "--seed", "5", *QUICK)
    found = json.loads(printed(*arguments, "--json"))
    loss = next(one for one in found["figures"] if one["figure"] == "loss")
    assert loss["law"] == pytest.approx(0.2)
    assert (found["sender"], found["receiver"]) == ("v2", "v3")
    assert f"{100 * loss['sample']:.4g} %" in printed(*arguments)
    other = json.loads(printed(*arguments[:-3], "6", *QUICK, "--json"))
    assert other["figures"][0]["sample"] != loss["sample"]


def test_a_link_of_a_scenario_is_shown(tmp_path: Path) -> None:
    file = tmp_path / "my.toml"
    file.write_text('extends = "lane_change"\n[links]\nloss_ratio = 0.3\n', encoding="utf-8")
    found = json.loads(
        printed("channel", "show", file, "--set", "links.jitter_ms=9", *QUICK, "--json")
    )
    assert found["figures"][0]["law"] == 0.3
    assert found["figures"][2]["law"] == pytest.approx(24.5)


def test_json_has_finite_numbers_at_any_loss() -> None:
    for ratio in ("0.0", "1.0"):
        text = printed(
            "channel", "show", "clear", "--set", f"links.loss_ratio={ratio}", *QUICK, "--json"
        )
        assert "Infinity" not in text
        assert "NaN" not in text


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["bursti"], "did you mean bursty?"),
        (["nowhere.toml"], 'no preset or scenario "nowhere.toml", allowed bursty, clear'),
        (["bursty", "--link", "v1:v9"], '--link: given "v1:v9", allowed v2:v1, v3:v1, v1:v2'),
        (["bursty", "--link", "v1"], '--link: given "v1", allowed v2:v1'),
        (["bursty", "--set", "links.loss_ratio=2"], "links.loss_ratio: given 2"),
        (["lane_change", "--set", "convoy.vehicles=1"], "lane_change: has no links"),
    ],
)
def test_an_unknown_channel_or_link_is_refused_in_one_line(arguments: list[str], line: str) -> None:
    assert line in refused("channel", "show", *arguments)


@pytest.mark.parametrize("metres", ["0", "nan", "-3", "1e9"])
def test_distances_out_of_range_are_refused(metres: str) -> None:
    assert "--distance-m" in refused("channel", "show", "clear", "--distance-m", metres)


def test_too_few_messages_are_refused() -> None:
    assert convoy("channel", "show", "clear", "--messages", "0").exit_code == 2


def test_a_missing_extra_is_named_only_where_it_is_needed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "scipy", None)
    assert "loss" in printed("channel", "show", "lossy", *QUICK)
    assert "needs scipy" in refused("channel", "fit", "run.mcap")


# ---- fit


def test_a_scenario_accepts_a_fitted_block(bursty: Path, tmp_path: Path) -> None:
    text = printed("channel", "fit", bursty)
    entries = tomllib.loads(text)["link"]
    pairs = {(one["sender"], one["receiver"]) for one in entries}
    scenario = load_scenario("lane_change")
    assert pairs == {*scenario.links}
    file = tmp_path / "fitted.toml"
    file.write_text(f'extends = "lane_change"\n{text}', encoding="utf-8")
    assert isinstance(load_scenario(file).links["v1", "v3"].loss, GilbertElliott)


def test_one_link_is_written_to_a_file_or_printed_as_json(bursty: Path, tmp_path: Path) -> None:
    out = tmp_path / "v1-v3.toml"
    arguments = ("channel", "fit", bursty, "--link", "v1:v3")
    assert printed(*arguments, "-o", out) == f"written: {out}\n"
    assert out.read_text(encoding="utf-8") == printed(*arguments)
    assert refused(*arguments, "-o", out).endswith("file exists")
    (found,) = json.loads(printed(*arguments, "--json"))
    (entry,) = tomllib.loads(printed(*arguments))["link"]
    assert found["keys"] == {key: entry[key] for key in found["keys"]}
    assert all(one["key"] for one in found["estimates"])


def test_an_unknown_link_or_log_is_refused_in_one_line(bursty: Path, tmp_path: Path) -> None:
    assert '"v9:v1", allowed v2:v1' in refused("channel", "fit", bursty, "--link", "v9:v1")
    assert refused("channel", "fit", tmp_path / "run.mcap").endswith("No such file or directory")
    other = tmp_path / "other.mcap"
    other.write_text("not a log", encoding="utf-8")
    assert refused("channel", "fit", other)
