"""Every file call of every command fails once: nothing incomplete passes as done.

By default a few calls of each command; `pytest --campaign` lets each call fail in each way.
"""

import json
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import pytest
import rerun
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.definition.scenario import load_scenario
from scenarios.results.log_summary import summary_of
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.failing_calls import FAULTS, Fault, failing_calls
from tests.made.scenarios.recorded_drives import as_plane_csv, drive
from transport.log.errors import LogError
from transport.log.mcap_file import McapFile

SHORT = "--set convoy.vehicles=2 --set duration_s=0.2"
HERE = f"{SHORT} --workers 0"
SWEEP = f"sweep lane_change --vary convoy.gap_m=3,10 --seeds 1 {HERE} --out out"
SWEPT = "sweep.csv runs.csv sweep.json"
SMALL_DRILL = """
extends = "lane_change"
duration_s = 0.2
convoy.vehicles = 2
limits.cross_track_error_m_max = 9.0
"""
LOG = "inputs/run/run.mcap"


@dataclass(frozen=True)
class Command:
    line: str
    files: str
    repeated: bool = False
    """Run after a run without faults, whose files must stay complete."""
    slow: bool = False

    @property
    def promised(self) -> Sequence[str]:
        return self.files.split()


COMMANDS = {
    "run": Command(f"run lane_change --clock virtual {SHORT} --out out", "run.mcap summary.json"),
    "sweep": Command(f"{SWEEP} -o out/sweep.svg", f"{SWEPT} sweep.svg", slow=True),
    "sweep again": Command(SWEEP, SWEPT, repeated=True),
    "scenario-from": Command(f"scenario-from {LOG} -o out/again.toml", "again.toml"),
    "channel fit": Command(f"channel fit {LOG} -o out/links.toml", "links.toml"),
    "export": Command(
        f"export {LOG} --format csv --format parquet --format gpx --out out",
        "vehicles.csv links.csv vehicles.parquet links.parquet v1.gpx v2.gpx",
    ),
    "compare": Command(f"compare {LOG} {LOG} -o out/both.svg", "both.svg"),
    "check": Command("check inputs/drive.csv --out out/drive.png", "drive.png"),
    "new": Command("new out/my.toml", "my.toml"),
    "drill": Command(
        "drill inputs/small.toml --workers 0 --out out --junit out/junit.xml",
        "drills.json junit.xml",
        slow=True,
    ),
    "bisect": Command(
        "bisect lane_change convoy.gap_m --range 3:10 --precision 1.7 --runs 40 "
        f"--limit gap_m=6 {HERE} --out out",
        "bisect.json",
        slow=True,
    ),
}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    run_virtual(
        load_scenario("lossy_lane_change", ["duration_s=2", "convoy.vehicles=2"]),
        folder / "run",
        Stop(),
    )
    (folder / "small.toml").write_text(SMALL_DRILL, encoding="utf-8")
    (folder / "drive.csv").write_bytes(as_plane_csv(drive()))
    return folder


@dataclass(frozen=True)
class Ended:
    result: Result
    made: list[tuple[str, str]]
    files: dict[str, bytes]

    @property
    def printed(self) -> str:
        return self.result.stdout + self.result.stderr


Ending = Callable[[str, Command, int | None, Fault], Ended]


@pytest.fixture
def ended(inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Ending:

    def run(name: str, command: Command, number: int | None, fault: Fault) -> Ended:
        folder = tmp_path / f"{name}-{fault}-{number}"
        (folder / "out").mkdir(parents=True)
        (folder / "inputs").symlink_to(inputs)
        monkeypatch.chdir(folder)
        if command.repeated:
            CliRunner().invoke(cli, command.line.split())
        with failing_calls(folder, number, fault) as calls:
            result = CliRunner().invoke(cli, command.line.split())
        out = folder / "out"
        files = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
        if number is not None:
            shutil.rmtree(folder)
        return Ended(result, calls.made, files)

    return run


@pytest.mark.campaign(1, 10_000)
@pytest.mark.parametrize("name", COMMANDS)
def test_promised_files_are_on_the_disk_or_the_command_fails(
    name: str, campaign: int, ended: Ending
) -> None:
    command = COMMANDS[name]
    if command.slow and campaign < len(COMMANDS):
        pytest.skip("simulates for minutes; use --campaign")
    whole = ended(name, command, None, "ENOSPC")
    assert whole.result.exit_code == 0, whole.printed
    assert set(command.promised) <= whole.files.keys()
    faults = [
        (number, fault)
        for number, (kind, _) in enumerate(whole.made)
        for fault in FAULTS
        if kind == "write" or fault in {"ENOSPC", "EIO"}
    ]
    wrong = [
        f"{fault} at call {number}, {whole.made[number]}: {fact}"
        for number, fault in evenly_spaced(faults, campaign)
        for fact in faults_of(command, whole, ended(name, command, number, fault))
    ]
    assert wrong == []


def evenly_spaced(faults: Sequence[Any], count: int) -> Sequence[Any]:
    total = len(faults)
    places = (range(total // (2 * count), total, max(1, total // count)))[:count]
    return [faults[place] for place in places]


def faults_of(command: Command, whole: Ended, failed: Ended) -> Iterator[str]:
    error, code = failed.result.exception, failed.result.exit_code
    if error is not None and not isinstance(error, SystemExit):
        yield repr(error)
    lacking = [
        name
        for name in command.promised
        if without_times(failed.files.get(name)) != without_times(whole.files[name])
    ]
    if code != (1 if lacking else 0) and not (code == 1 and not lacking):
        yield f"exit code {code}, {lacking} are incomplete"
    if code and not any("out" in line for line in failed.printed.splitlines() if ": " in line):
        yield f"no file is named: {failed.printed}"
    if lacking == ["summary.json"] and "summary.json" in failed.files:
        yield "the summary contradicts that in the log"
    if command.repeated and lacking:
        yield f"{lacking} were destroyed"
    for name, data in failed.files.items():
        yield from unreadable(name, data, is_whole=name not in lacking)
        if name in lacking and name not in OF_FAILED_RUNS:
            yield f"{name} is not whole"


def without_times(data: bytes | None) -> bytes | None:
    """Leave out the durations in a JUnit file."""
    return data and re.sub(rb'time="[0-9.]+"', b"", data)


OF_FAILED_RUNS = {"run.mcap", "summary.json"}
"""Files that a failed run leaves: other than those of a whole one, but readable."""


def unreadable(name: str, data: bytes, *, is_whole: bool) -> Iterator[str]:
    if name.endswith((".part", ".repaired")):
        yield f"{name} is left"
    elif name.endswith(".json"):
        json.loads(data)
    elif name == "run.mcap":
        with NamedTemporaryFile() as file:
            file.write(data)
            file.flush()
            yield from log_faults(Path(file.name), is_whole=is_whole)


def log_faults(log: Path, *, is_whole: bool) -> Iterator[str]:
    if damage := McapFile(log).damage:
        yield damage
    with suppress(LogError):  # no message was written
        if not is_whole and summary_of(log).outcome == "completed":
            yield "the log states a completed run"


@pytest.mark.parametrize("command", ["run", "review", "compare"])
def test_a_recording_that_cannot_be_written_fails_the_command(
    command: str, inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:

    def fail(_recording: rerun.RecordingStream, **_: object) -> None:
        raise RuntimeError("File-writer thread shut down prematurely")

    monkeypatch.setattr(rerun.RecordingStream, "flush", fail)
    log, file = str(inputs / "run" / "run.mcap"), tmp_path / "run.rrd"
    lines = {
        "run": f"run lane_change --clock virtual {SHORT} --out {tmp_path / 'run'}".split(),
        "review": ["review", log],
        "compare": ["compare", log, log],
    }
    done = CliRunner().invoke(cli, [*lines[command], "--save", str(file)])
    assert done.exit_code == 1
    assert any(line.startswith(f"error: {file}: ") for line in done.stderr.splitlines())
    if command == "run":
        assert "OK: 2 vehicles" in done.stdout
