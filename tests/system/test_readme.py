"""Every command of the README does what the README says, shortened where it drives for long."""

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

README = Path(__file__).parents[2] / "README.md"
SHORT = ["--set", "duration_s=2"]
NOT_HERE = {
    "--rerun spawn": "--rerun save=live.rrd",  # needs a display
    "review runs/first": "review runs/first --rerun save=again.rrd",
    "convoy reproduce": "convoy reproduce --case base",  # all of it takes up to two minutes
}
"""What a test replaces, and by what."""


def indented_lines() -> list[str]:
    """Lines of the README's code blocks."""
    return [line[4:] for line in README.read_text().splitlines() if re.match(r"    \S", line)]


def commands() -> list[str]:
    """Commands of the section "What next", in order."""
    return [line for line in indented_lines() if line.startswith("convoy ")]


def convoy(folder: Path, arguments: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    """Run `convoy` in `folder`."""
    return subprocess.run(
        [sys.executable, "-m", "scenarios.cli", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


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


def test_commands_in_the_order_of_the_readme(tmp_path: Path) -> None:
    by_hand = ("convoy router", "convoy vehicle", "convoy record")
    ran = [line for line in commands() if not line.startswith(by_hand)]
    assert len(ran) >= 10
    for command in ran:
        done = convoy(tmp_path, shortened(command))
        assert done.returncode == 0, f"{command}: {done.stderr}"
    assert (tmp_path / "live.rrd").stat().st_size > 10_000
    assert (tmp_path / "again.rrd").stat().st_size > 10_000
    assert (tmp_path / "gains" / "gains.json").exists()
    assert (tmp_path / "paper" / "report.md").exists()
    summary = json.loads((tmp_path / "runs" / "first" / "summary.json").read_text())
    assert summary["outcome"] == "completed"


def test_the_summary_s_fields_are_those_documented(tmp_path: Path) -> None:
    arguments = ["run", "lane_change", "--clock", "virtual", "--quiet", "--out", "run", *SHORT]
    assert convoy(tmp_path, arguments).returncode == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    text = README.read_text()
    for part in ("vehicles", "links"):
        for field in summary[part][0]:
            stem = re.sub(r"_rms$|_max$", "", field)
            assert stem in text or field in {"name", "role", "distance_m", "ticks"}, field
    for field in ("outcome", "reason", "duration_s", "ran_s", "recorder_rejected_messages"):
        assert field in summary
        assert f"`{field}`" in text


@pytest.mark.parametrize("link", re.findall(r"\]\(([^)h][^)]*)\)", README.read_text()))
def test_pictures_of_the_readme_exist(link: str) -> None:
    assert (README.parent / link).is_file()
