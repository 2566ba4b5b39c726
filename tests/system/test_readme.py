"""Every command of the README does what the README says, shortened where it drives for long."""

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import chdir
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from pydantic import BaseModel

from scenarios.cli.main import cli
from scenarios.definition.channel.presets import presets
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.definition.validation.model_fields import models_of
from scenarios.studies.channel import cost_drives
from scenarios.studies.cuts import campaign
from scenarios.studies.paper.experiments import RUNS_OF_CASE, Experiment
from scenarios.studies.paper.keys import BASE
from tests.made.many.known_runs import SETTINGS

README = Path(__file__).parents[2] / "README.md"
SHORT = ["--set", "duration_s=2"]
TWO_CARS = "--set duration_s=2.5 --set convoy.vehicles=2"
BEND = " ".join(f'--set "{one}"' for one in SETTINGS)
BISECT = f"{BEND} --precision 0.2 --out b"
NOT_HERE = {
    "--rerun spawn": "--rerun save=live.rrd --clock virtual",  # needs a display
    "run lossy_lane_change": "run lossy_lane_change --clock virtual",
    "review runs/first": "review runs/first --rerun save=again.rrd",
    "review runs/cut": "review runs/cut --rerun save=cut.rrd",
    "--at 12.4": "--at 1.4",  # within the two seconds
    "at_s=7, for_s=4": "at_s=1, for_s=0.5",
    "convoy gains": "convoy gains --speed 30",
    "convoy channel figure": "convoy channel figure --quick",
    "--cuts 20": "--cuts 2",
    "sweep lossy_lane_change": f"sweep lossy_lane_change {TWO_CARS}",
    "0.5:0.9:0.1": "0.5:0.9:0.4",
    "8,15,25,35 --seeds 10": "8,35 --seeds 1",
    "--limit lane --out many/boundary": f"--limit error_m=1 --seeds 4 {BISECT}",
    "risk lossy_lane_change": f"risk lossy_lane_change --runs 20 {TWO_CARS}",
    "blame runs/lossy": "blame runs/lossy --runs 12",
    "convoy drill": "convoy drill lead_lost",
    "convoy worst lane_change": f"convoy worst lane_change --from 1s --to 1.2s {TWO_CARS}",
    "convoy reproduce": "convoy reproduce --case base",  # all takes up to two minutes
}
"""What a test replaces, and by what."""


def indented_lines() -> list[str]:
    """Lines of the README's code blocks."""
    return [line[4:] for line in README.read_text().splitlines() if re.match(r"    \S", line)]


def commands() -> list[str]:
    """Commands of the section "What next", in order."""
    return [line for line in indented_lines() if line.startswith("convoy ")]


def block(language: str) -> str:
    """Text of the README's only fenced block in a language."""
    (found,) = re.findall(
        rf"^```{language}\n(.*?)^```$", README.read_text(), re.DOTALL | re.MULTILINE
    )
    return str(found)


@dataclass(frozen=True)
class Said:
    """How a command ended, and what it wrote."""

    exit_code: int
    stdout: str
    stderr: str


def convoy(folder: Path, arguments: Sequence[str]) -> Said:
    """Run `convoy` in `folder` as a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "scenarios.cli", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return Said(done.returncode, done.stdout, done.stderr)


def convoy_here(folder: Path, arguments: Sequence[str]) -> Said:
    """Run `convoy` in `folder` in this process, which has loaded all that it needs."""
    with chdir(folder):
        done = CliRunner().invoke(cli, list(arguments))
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return Said(done.exit_code, done.stdout, done.stderr)


def subcommand(arguments: Sequence[str]) -> str:
    """The command, with its part of a group."""
    return " ".join(arguments[: 2 if arguments[0] in {"channel", "reference"} else 1])


HERE = ("reproduce", "channel cuts", "channel figure")
"""Commands whose drives a test can only shorten in its own process."""


@pytest.fixture
def shorter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let those commands drive less: one run of the paper, a few short cuts, a few channels."""
    one = Experiment(overrides=("duration_s=26.0", "convoy.vehicles=2"), logged=True)
    monkeypatch.setitem(RUNS_OF_CASE, "base", {BASE: one})
    monkeypatch.setattr(campaign, "REACTIONS", campaign.REACTIONS[:2])
    monkeypatch.setattr(campaign, "CUT_AT_S", (3.0, 5.0))
    monkeypatch.setattr(campaign, "LONG_S", 4.0)
    few = replace(
        cost_drives.QUICK, gaps_m=(8.0,), loss_ratios=(0.0, 0.6), bursts_messages=(1.25,),
        map_seeds=1, burst_seeds=1,
    )  # fmt: skip
    monkeypatch.setattr(cost_drives, "QUICK", few)


def is_for_a_process(arguments: Sequence[str], before: Sequence[str]) -> bool:
    """Whether a command is run as users do: each for the first time, and where it matters."""
    own_module = any("mine." in one for one in arguments)  # is found in the working folder
    starts_others = arguments[0] == "run" and "virtual" not in arguments
    return own_module or starts_others or subcommand(arguments) not in (*before, *HERE)


def shortened(command: str) -> list[str]:
    """Arguments of a command as the test runs it."""
    for wanted, instead in NOT_HERE.items():
        command = command.replace(wanted, instead)
    arguments = shlex.split(command)[1:]
    return arguments + SHORT if arguments[0] == "run" else arguments


def test_the_two_commands_set_themselves_up() -> None:
    first, second = (line for line in indented_lines() if line.startswith("python3 -m venv"))
    assert "requirements.lock" in first
    assert first.endswith("convoy run")
    assert "pytest" in second


def test_the_command_that_compiles_is_there() -> None:
    """It takes minutes: `test_compiled` does what it does, with `--campaign`."""
    assert "CONVOY_COMPILE=1 pip install ." in indented_lines()


WHILE_DRIVING = tuple(
    f"convoy {name}" for name in ("status", "link", "cut", "heal", "gnss", "stall", "kill", "speed")
)
"""Commands that need a convoy that drives."""


@pytest.mark.long
@pytest.mark.usefixtures("shorter")
def test_commands_in_the_order_of_the_readme(tmp_path: Path) -> None:
    by_hand = ("convoy router", "convoy vehicle", "convoy record")
    left_out = (*by_hand, *WHILE_DRIVING)
    ran = [line for line in dict.fromkeys(commands()) if not line.startswith(left_out)]
    assert len(ran) >= 10
    (tmp_path / "mine.py").write_text(block("python"))
    said, before = {}, list[str]()
    for command in ran:
        arguments = shortened(command)
        of = convoy if is_for_a_process(arguments, before) else convoy_here
        done = of(tmp_path, arguments)
        assert done.exit_code == 0, f"{command}: {done.stderr}"
        said[command] = done.stdout
        before.append(subcommand(arguments))
    assert_sample_is_like(said["convoy run lossy_lane_change"])
    assert (tmp_path / "live.rrd").stat().st_size > 10_000
    assert (tmp_path / "again.rrd").stat().st_size > 10_000
    assert (tmp_path / "gains" / "gains.json").exists()
    assert (tmp_path / "paper" / "report.md").exists()
    assert (tmp_path / "cuts" / "cuts.png").exists()
    summary = json.loads((tmp_path / "runs" / "first" / "summary.json").read_text())
    assert summary["outcome"] == "completed"


def assert_sample_is_like(shown: str) -> None:
    """The README's table has the headings and the rows that such a run prints."""
    title, *sample = [line.split() for line in block("text").splitlines() if line.strip()]
    printed = [line.split() for line in shown.splitlines() if line.strip()]
    assert title[:-4] == printed[0][: len(title) - 4]  # up to clock and duration
    assert sample[:3] == printed[1:4]
    assert [row[0] for row in sample[4:]] == [row[0] for row in printed[5:9]]


def rows(heading: str) -> list[list[str]]:
    """Words in backticks of each row of the table with this heading, first column and others."""
    text = README.read_text(encoding="utf-8").split(f"| {heading} |\n", 1)[1]
    table = text.split("\n\n", 1)[0].splitlines()[1:]
    return [re.findall(r"`([^`]+)`", row) for row in table]


def test_every_channel_that_ships_is_in_the_table() -> None:
    named = [name for row in rows("preset | channel") for name in row]
    assert sorted(named) == sorted(presets())


def test_every_word_of_a_link_is_in_the_table() -> None:
    words = {word for row in rows("key | what it does") for word in row}
    keys = {*LinkTable.model_fields} - {"preset_source"}
    kinds = {
        str(one.model_fields["kind"].annotation)
        for field in LinkTable.model_fields.values()
        for one in tables_of(field.annotation)
        if "kind" in one.model_fields
    }
    kinds = {word for kind in kinds for word in re.findall(r"'(\w+)'", kind)}
    assert words == keys | kinds


def tables_of(annotation: object) -> Iterator[type[BaseModel]]:
    """Tables of a key, and those within them."""
    for one in models_of(annotation):
        yield one
        for field in one.model_fields.values():
            yield from tables_of(field.annotation)


@pytest.mark.parametrize("link", re.findall(r"\]\(([^)h][^)]*)\)", README.read_text()))
def test_pictures_of_the_readme_exist(link: str) -> None:
    assert (README.parent / link).is_file()
