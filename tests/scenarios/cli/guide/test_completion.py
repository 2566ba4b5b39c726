"""Shell completion, and its speed."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete

from scenarios.cli.main import EXAMPLES, cli
from scenarios.definition.library import library


def offered(*words: str) -> list[str]:
    *before, begun = words
    shell = ShellComplete(cli, {}, "convoy", "_CONVOY_COMPLETE")
    return [item.value for item in shell.get_completions(before, begun) if item.type == "plain"]


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.toml").touch()
    (tmp_path / "ride.gpx").touch()
    (tmp_path / "notes.md").touch()
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("command", ["run", "check", "record", "vehicle"])
def test_shipped_scenarios_and_files_are_offered(command: str) -> None:
    assert offered(command, "") == [*library(), "mine.toml", "ride.gpx"]
    assert offered(command, "lo") == ["lossy_lane_change"]


BASH = """
{line}
press() {{ COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)) COMPREPLY=(); _convoy_completion convoy; }}
press convoy chan; echo "${{COMPREPLY[@]}}"
press convoy run --clock virtual --sa; echo "${{COMPREPLY[@]}}"
press convoy run lo; echo "${{COMPREPLY[@]}}"
"""


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
        "channel",
        "--save",
        "lossy_lane_change",
    ], done.stderr


@pytest.mark.spread(1)
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_a_shell_loads_no_simulation(shell: str) -> None:
    code = "import sys; from scenarios.cli.main import cli\ntry: cli(prog_name='convoy')\n"
    code += "finally: print(*sys.modules, file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {
            "_CONVOY_COMPLETE": f"{shell}_complete",
            "COMP_WORDS": "convoy run lo",
            "COMP_CWORD": "lo" if shell == "fish" else "2",
        },
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "lossy_lane_change" in done.stdout, done.stderr
    loaded = {name.split(".")[0] for name in done.stderr.split()}
    assert not {"scipy", "zenoh", "rerun", "mcap", "rich", "psutil"} & loaded
