"""Every command that reads a log names its damage and holes, in one line and in its JSON."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.definition.check.findings import warnings
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text
from scenarios.runs.node.recorded_vehicle import read_recorded_vehicle
from tests.made.scenarios.shipped import whole_run
from transport.links.laws.recorded_losses import EarlierRun
from transport.log.errors import LogError
from transport.log.mcap_file import McapFile, repair
from transport.log.reader import LogReader
from transport.log.writer import LogWriter
from vehicles.messages import LinkVerdict


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return whole_run("lossy_lane_change", tmp_path_factory) / "run.mcap"


@pytest.fixture
def damaged(whole: Path, tmp_path: Path) -> Path:
    return with_damaged_chunk(whole, tmp_path / "damaged", len(McapFile(whole).chunks) // 2)


def with_damaged_chunk(whole: Path, folder: Path, place: int) -> Path:
    log = folder / "run.mcap"
    log.parent.mkdir()
    data = bytearray(whole.read_bytes())
    chunk = McapFile(whole).chunks[place]
    data[(chunk.start + chunk.end) // 2] ^= 1
    log.write_bytes(data)
    return log


@pytest.fixture
def interrupted(whole: Path, tmp_path: Path) -> Path:
    log = tmp_path / "interrupted" / "run.mcap"
    log.parent.mkdir()
    chunks = McapFile(whole).chunks
    end = chunks[2 * len(chunks) // 3].start + 100
    log.write_bytes(whole.read_bytes()[:end])
    assert repair(log)
    return log


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def test_faults_count_the_missing_messages_of_each_topic(whole: Path, damaged: Path) -> None:
    before, after = LogReader(whole), LogReader(damaged)
    for key, count in before.counts.items():
        gone = count - after.counts.get(key, 0)
        assert after.missing.get(key, (0, count)) == (gone, count)
    gone = sum(lost for (_, topic), (lost, _) in after.missing.items() if topic == "verdict")
    total = sum(count for (_, topic), count in before.counts.items() if topic == "verdict")
    assert f"{gone} of {total} verdict messages are missing" in after.faults
    assert "\n" not in after.faults


COMMANDS = {
    "report": ["--json"],
    "explain": ["--vehicle", "v3", "--at", "2", "--json"],
    "channel fit": ["--partial", "--json"],
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("fault", ["damaged", "interrupted"])
def test_commands_name_faults_in_a_line_and_in_their_json(
    command: str, fault: str, request: pytest.FixtureRequest
) -> None:
    log: Path = request.getfixturevalue(fault)
    done = run(*command.split(), log, *COMMANDS[command])
    (line,) = [line for line in done.stderr.splitlines() if line.startswith(f"warning: {log}: ")]
    faults = line.removeprefix("warning: ")
    assert "damaged" in faults or "not completed" in faults
    found = json.loads(done.stdout)
    for entry in found if isinstance(found, list) else [found]:
        assert entry["log_faults"] == faults


@pytest.mark.parametrize("command", ["scenario-from", "channel fit"])
def test_files_made_of_a_damaged_log_name_its_damage(command: str, damaged: Path) -> None:
    done = run(*command.split(), damaged, "--partial")
    assert done.exit_code == 0
    (warning,) = done.stderr.splitlines()
    faults = warning.removeprefix("warning: ")
    assert faults.startswith(f"{damaged}: damaged, ")
    assert done.stdout.startswith(f"# {faults}\n")


@pytest.mark.parametrize("fault", ["damaged", "interrupted"])
@pytest.mark.parametrize("command", ["scenario-from", "channel fit"])
def test_a_part_of_a_log_makes_no_scenario_unless_requested(
    command: str, fault: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    log: Path = request.getfixturevalue(fault)
    done = run(*command.split(), log, "-o", tmp_path / "made.toml")
    assert (done.exit_code, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"error: {log}: ")
    assert not (tmp_path / "made.toml").exists()


@pytest.mark.parametrize("fault", ["damaged", "interrupted"])
def test_a_part_of_a_log_replays_no_vehicle(fault: str, request: pytest.FixtureRequest) -> None:
    log: Path = request.getfixturevalue(fault)
    with pytest.raises(LogError, match=r"damaged|not completed"):
        read_recorded_vehicle(log, "v1")


def test_blame_refuses_a_damaged_log(damaged: Path, tmp_path: Path) -> None:
    assert run("blame", damaged, "--limit", "error_m=0.5", "--out", tmp_path / "why").exit_code == 2


@pytest.mark.parametrize("copies", [0, 2])
def test_a_chunk_that_was_cut_out_or_copied_is_damage(
    copies: int, whole: Path, tmp_path: Path
) -> None:
    data = whole.read_bytes()
    first, second = (chunk.start for chunk in McapFile(whole).chunks[3:5])
    log = tmp_path / "run.mcap"
    log.write_bytes(data[:first] + copies * data[first:second] + data[second:])
    assert LogReader(log).damage


# ---- Logs as channels


def as_channel(log: Path, *, partial: bool = True) -> Scenario:
    loss = f'{{kind="log", file="{log}", partial={str(partial).lower()}}}'
    return load_scenario("lane_change", [f"links.loss={loss}"])


def losses(scenario: Scenario) -> dict[tuple[str, str], int]:
    laws = {pair: link.loss for pair, link in scenario.links.items()}
    return {pair: len(law.lost) for pair, law in laws.items() if isinstance(law, EarlierRun)}


@pytest.mark.parametrize("place", [1, 6, 7, 17])
def test_holes_of_a_damaged_log_are_no_losses(whole: Path, tmp_path: Path, place: int) -> None:
    damaged = with_damaged_chunk(whole, tmp_path / "damaged", place)
    remaining: dict[tuple[str, str], int] = {}
    for _, receiver, message in LogReader(damaged).messages(("verdict",)):
        assert isinstance(message, LinkVerdict)
        pair = message.sender, receiver
        remaining[pair] = remaining.get(pair, 0) + bool(message.reason)
    assert losses(as_channel(damaged)) == remaining
    assert sum(remaining.values()) < sum(losses(as_channel(whole)).values())


@pytest.mark.parametrize("fault", ["damaged", "interrupted"])
def test_a_part_of_a_log_is_no_channel_unless_requested(
    fault: str, request: pytest.FixtureRequest
) -> None:
    log: Path = request.getfixturevalue(fault)
    with pytest.raises(ScenarioError) as refused:
        as_channel(log, partial=False)
    (line,) = str(refused.value).splitlines()
    assert f"links.loss.file: {log}: " in line


def test_messages_that_never_arrived_stay_losses(whole: Path, tmp_path: Path) -> None:
    found = {}
    for shift in (0, 10):
        log = tmp_path / f"{shift}.mcap"
        with LogWriter(log) as writer:
            for at, receiver, message in LogReader(whole).messages(("verdict",)):
                assert isinstance(message, LinkVerdict)
                if receiver != "v2" or 20 <= message.seq < 30:
                    continue
                seq = message.seq - shift * (message.seq >= 30)
                one = replace(message, seq=seq, outcome="delivered", reason="")
                writer.write(at, one)
        scenario = load_scenario(
            "lane_change",
            ["convoy.vehicles=2", f'links.loss={{kind="log", file="{log}", partial=true}}'],
        )
        found[shift] = losses(scenario)["v1", "v2"]
    assert found == {0: 0, 10: 10}


def test_two_logs_in_one_file_are_damage(whole: Path, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    log.write_bytes(2 * whole.read_bytes())
    assert run("channel", "fit", log).exit_code == 2
    assert f"warning: {log}: damaged, " in run("report", log).stderr


def test_a_damaged_log_as_a_channel_is_named(whole: Path, damaged: Path) -> None:
    assert warnings(as_channel(whole)) == ()
    (line,) = warnings(as_channel(damaged))
    assert re.search(r"damaged.*verdict messages are missing.*of unknown fate", line)
    again = scenario_from_text(as_channel(damaged).text)
    assert losses(again) == losses(as_channel(damaged))
