"""Every command of the README runs, and prints what the README shows."""

import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from click.testing import CliRunner

from scenarios.cli.main import cli
from scenarios.cli.pages import LISTENER
from scenarios.studies.many import boundary
from tests.system.processes import start, until

README = Path(__file__).parents[2] / "README.md"
LONGEST_LINES = 250
ELSEWHERE = ("convoy router", "convoy vehicle", "convoy record", "convoy cut", "convoy link",
             "convoy status", "docker compose")  # fmt: skip
"""Commands for several machines and for a running convoy: other tests run them."""
SHORTER = {
    "review runs/first": "review runs/first --save first.rrd",  # needs no display
    "run --out runs/live": "run --out runs/live --clock virtual --duration 3",
    "run session.toml": "run session.toml --duration 3",
    "run my.toml": "run my.toml --duration 5",
    "run my.gpx": "run my.gpx --duration 5",
    "--out runs/first": "--out runs/first --duration 14",
    "--out runs/cut": "--out runs/cut --duration 12",
    "--out runs/perfect": "--out runs/perfect --duration 5",
    "=mine.PurePursuit": "=mine.PurePursuit --duration 5",
    "0.3:0.9 --precision 0.05": "0.5:1 --precision 0.12 --duration 9 --runs 18 --workers 0",
    "--seeds 5 --junit": "--seeds 1 --junit",
    "import convoy": "import scenarios.api as convoy",  # its name in a checkout
    '"links.loss_ratio": 0.4': '"links.loss_ratio": 0.4, "duration_s": 3',
    "flow, seeds=5": "flow, seeds=2, set={'duration_s': 1}",
    "reach_m=60}'": "reach_m=60}' --duration 5",
    "run plexe_sinusoidal": "run plexe_sinusoidal --duration 5",
    "--seeds 3 --duration 16": "--seeds 1 --duration 0.3 --workers 0",
}
"""What the test replaces: a display, real time, and minutes of processor time."""


@dataclass(frozen=True)
class Block:
    """A fenced block: language, text, and the name of the file to save it as, if there is one."""

    language: str
    text: str
    file: str


def blocks() -> Iterator[Block]:
    """Fenced blocks of the README, in order."""
    before = ""
    for part in re.split(r"^(```.*?^```$)", README.read_text(), flags=re.DOTALL | re.MULTILINE):
        if fenced := re.fullmatch(r"```(\w*)\n(.*)```", part, re.DOTALL):
            names = re.findall(r"ave\s+as `([\w.]+)`", before.rsplit("\n#", 1)[-1])
            yield Block(fenced[1], fenced[2], names[-1] if names else "")
        before = part


def commands(text: str) -> list[str]:
    return [
        part
        for line in text.splitlines()
        for part in line.split(" && ")
        if part.startswith("convoy ")
    ]


def convoy(command: str) -> str:
    """Run a command in this process and working folder."""
    arguments = shlex.split(shorter(command), comments=True)[1:]
    done = CliRunner().invoke(cli, arguments)
    assert done.exit_code == int(arguments[0] == "compare"), f"{arguments}: {done.output}"
    return done.stdout


def shorter(text: str) -> str:
    for shown, instead in SHORTER.items():
        text = text.replace(shown, instead)
    return text


def without_numbers(text: str) -> set[str]:
    """Lines with their words and no numbers, rules or blanks."""
    lines = (
        re.sub(r"[-+]?\d[\d.]*|[─━]+|^\s*-\s*$", "", line).split() for line in text.splitlines()
    )
    return {" ".join(words) for words in lines if words}


def write_files(folder: Path) -> None:
    """Save the files that the README asks for, and a recorded drive."""
    for block in blocks():
        if block.file:
            (folder / block.file).write_text(block.text)
    points = "".join(
        f'<trkpt lat="{48 + second * 1e-4:.6f}" lon="11.0">'
        f"<time>2026-01-01T10:00:{second:02d}Z</time></trkpt>"
        for second in range(40)
    )
    (folder / "my.gpx").write_text(
        f'<gpx version="1.1" creator="test"><trk><trkseg>{points}</trkseg></trk></gpx>'
    )


def test_the_readme_is_short_enough_to_read() -> None:
    assert len(README.read_text().splitlines()) <= LONGEST_LINES


def test_the_two_commands_set_themselves_up() -> None:
    first, second = re.findall(r"^python3 -m venv .*$", README.read_text(), re.MULTILINE)
    assert "requirements.lock" in first
    assert first.endswith("convoy run")
    assert "pytest" in second


@pytest.mark.long
def test_commands_in_the_order_of_the_readme(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(boundary, "EVENTS", 5)  # a wide interval will do
    monkeypatch.syspath_prepend(tmp_path)  # for the user's controller
    printed, ran = "", 0
    for block in blocks():
        if block.language == "text":
            lines = without_numbers(printed)
            for line in without_numbers(block.text):  # "…" stands for the rest of a line
                assert any(one.startswith(line.removesuffix("…")) for one in lines), (line, printed)
        if block.text.startswith("import convoy"):
            (tmp_path / "study.py").write_text(shorter(block.text))
            runpy.run_path("study.py")
            printed = capsys.readouterr().out
        for command in commands(block.text) if block.language == "sh" else ():
            if not command.startswith(ELSEWHERE):
                printed = convoy(command)
                ran += 1
    assert ran >= 14


def test_another_program_reads_the_poses_of_a_running_convoy(tmp_path: Path) -> None:
    (tmp_path / "listen.py").write_text(LISTENER)
    with start("run", "lane_change", "--set=duration_s=5", "--out=run", folder=tmp_path) as run:
        run.await_start()
        assert until(lambda: "tcp/127.0.0.1:" in run.out + run.err)
        endpoint = re.findall(r"tcp/127\.0\.0\.1:\d+", run.out + run.err)[0]
        listener = subprocess.run(
            [sys.executable, "listen.py", endpoint],
            cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False,
        )  # fmt: skip
        assert run.wait() == 0
    vehicles = {line.split()[0] for line in listener.stdout.splitlines()}
    assert vehicles == {"v1", "v2", "v3", "v4"}, listener.stderr


@pytest.mark.parametrize("link", re.findall(r"\]\(([^)h][^)]*)\)", README.read_text()))
def test_pictures_of_the_readme_exist(link: str) -> None:
    assert (README.parent / link).is_file()
