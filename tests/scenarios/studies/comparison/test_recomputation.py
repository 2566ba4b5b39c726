"""Recorded decisions computed again: equal to the bit with the same software, else compared."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from scenarios.cli.main import cli
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario
from scenarios.results.files import LOG_NAME
from scenarios.results.log_queries.session import replayed_session
from scenarios.runs.stop import Stop
from scenarios.runs.virtual.logged_run import run_virtual
from scenarios.studies.comparison.recomputation import recompute
from tests.made.transport.changed_logs import changed_log
from tests.made.transport.recording import columns
from tests.scenarios.runs.simulation.network import NetworkSettings
from tests.scenarios.runs.simulation.plan import Plan
from tests.scenarios.runs.simulation.world import World
from transport.log.reader import LogReader
from transport.log.records import LogError
from vehicles.messages import Command, LinkVerdict, Message

SHORT = ("duration_s=1.6", "convoy.vehicles=3")
LOSSY = (
    *SHORT,
    "links.loss={kind='gilbert_elliott',loss_ratio=0.3,burst_messages_mean=3}",
    "links.latency_ms=50",
    "links.jitter_ms=30",
    "vehicle.v3.clock.offset_ms=4",
    "change=[{kind='stall',vehicle='v3',at_s=0.7,for_s=0.2},{kind='cut',at_s=1.1,for_s=0.2}]",
)
RADIO = (
    *SHORT,
    "links.preset=ieee80211p_dense",
    "gnss.latency_ms=30",
    "speed.followers=gap",
    "links.content={duplicate_ratio=0.1}",
    "control.longitudinal=acc",
    "gap_sensor={range_m=100,rate_hz=30}",
)


def run(overrides: tuple[str, ...], folder: Path, seed: int = 2) -> Path:
    run_virtual(load_scenario("lane_change", overrides, seed), folder, Stop())
    return folder / LOG_NAME


@pytest.fixture(scope="module")
def lossy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(LOSSY, tmp_path_factory.mktemp("lossy"))


def commands(log: Path, vehicle: str) -> list[Command]:
    rows = LogReader(log).messages(("command",), (vehicle,))
    return [message for _, _, message in rows if isinstance(message, Command)]


@pytest.mark.parametrize("vehicle", ["v1", "v2", "v3"])
def test_the_same_software_repeats_its_decisions_to_the_bit(lossy: Path, vehicle: str) -> None:
    result = recompute(lossy, vehicle)
    recorded = commands(lossy, vehicle)
    assert len(result.at_s) == len(recorded) == (70 if vehicle == "v3" else 80)
    assert result.recomputed["steering_rad"].tolist() == [one.steering_rad for one in recorded]
    assert result.recomputed["acceleration_mps2"].tolist() == [
        one.acceleration_mps2 for one in recorded
    ]
    assert result.is_equal
    assert result.warnings == ()
    assert all(one.first_at_s is None and one.largest == 0.0 for one in result.differences)


def test_links_that_alter_and_repeat_messages_are_repeated(tmp_path: Path) -> None:
    result = recompute(run(RADIO, tmp_path), "v3")
    assert result.is_equal
    assert result.judged > 20
    assert result.warnings == ()


def test_a_run_in_real_time_with_late_messages_is_repeated(tmp_path: Path) -> None:
    network = NetworkSettings(delay=60_000_000, jitter=100_000_000)
    variant = ("convoy.clock_uncertainty_ms_max=500", "links.loss_ratio=0.2")
    plan = Plan(seed=3, vehicles=3, network=network, variant=variant)
    world = World(plan, tmp_path)
    world.run()
    log = world.folder / LOG_NAME
    rows = LogReader(log).messages(("verdict",))
    assert any(m.late for _, _, m in rows if isinstance(m, LinkVerdict))
    for vehicle in ("v2", "v3"):
        result = recompute(log, vehicle)
        assert result.is_equal, result.sentence
        assert result.warnings == ()


def test_another_controller_decides_on_the_same_inputs(lossy: Path, tmp_path: Path) -> None:
    result = recompute(lossy, "v2", controller="stanley")
    other = run((*LOSSY, "vehicle.v2.control.controller=stanley"), tmp_path)
    # Before its car has reacted, a live vehicle has the same inputs.
    assert result.recomputed["steering_rad"][0] == commands(other, "v2")[0].steering_rad
    assert result.recorded["steering_rad"].tolist() == [
        one.steering_rad for one in commands(lossy, "v2")
    ]
    assert not result.is_equal
    assert result.warnings == ()  # its car moved as recorded
    steering = result.differences[0]
    error = result.recomputed["steering_rad"] - result.recorded["steering_rad"]
    assert steering.rms == pytest.approx(float(np.sqrt(np.mean(error**2))))
    assert steering.largest == np.abs(error).max()
    assert steering.largest_at_s == result.at_s[np.abs(error).argmax()]
    assert steering.first_at_s == result.at_s[np.flatnonzero(error)[0]]
    assert steering.count == np.count_nonzero(error)


def test_another_fusion_has_other_modes(lossy: Path) -> None:
    result = recompute(lossy, "v3", overrides=("information_flow.lateral=predecessor",))
    assert result.other_modes > 20
    assert result.settings == ("vehicle.v3.information_flow.lateral=predecessor",)


def test_messages_that_other_settings_do_not_use_are_no_fault_of_the_log(lossy: Path) -> None:
    alone = [f"information_flow.{one}=predecessor" for one in ("lateral", "longitudinal")]
    result = recompute(lossy, "v3", overrides=alone)
    assert result.warnings == ()
    assert result.inputs_are_exact
    assert 0 < result.judged < recompute(lossy, "v3").judged


def test_a_changed_command_is_found_where_it_is(lossy: Path, tmp_path: Path) -> None:
    def change(message: Message) -> Message:
        if isinstance(message, Command) and (message.vehicle, message.seq) == ("v2", 40):
            return replace(message, steering_rad=message.steering_rad + 1e-3)
        return message

    result = recompute(changed_log(lossy, tmp_path / "changed.mcap", change), "v2")
    steering = result.differences[0]
    assert steering.first_at_s == steering.largest_at_s == 0.8
    assert steering.largest == pytest.approx(1e-3, abs=1e-4)
    assert "from 0.800 s on, where steering_rad is" in result.sentence
    assert 0.0 < result.car_off_m_max < 0.1
    assert "off its recorded position" in result.warnings[0]


def test_a_log_without_its_inputs_is_refused(lossy: Path, tmp_path: Path) -> None:
    def lose(message: Message) -> Message | None:
        is_lost = isinstance(message, LinkVerdict) and message.seq in range(3, 6)
        return None if is_lost else message

    holed = changed_log(lossy, tmp_path / "holed.mcap", lose)
    with pytest.raises(LogError, match=r"6 of \d+ verdict messages are missing; use the rest"):
        recompute(holed, "v3")
    result = recompute(holed, "v3", partial=True)
    assert "verdict messages are missing" in result.warnings[0]
    thinned = run((*SHORT, "log.command_rate_hz=5"), tmp_path / "thinned")
    with pytest.raises(LogError, match="at most 5 messages per second of topic command"):
        recompute(thinned, "v3")
    replayed = tmp_path / "replayed"
    run_virtual(
        replayed_session(lossy, ("v1", "v2"), ("duration_s=0.5", "change=[]")), replayed, Stop()
    )
    with pytest.raises(LogError, match="holds no commands of 'v2', but of v3"):
        recompute(replayed / LOG_NAME, "v2")


@pytest.mark.parametrize("text", ["links.loss_ratio=0", "control.rate_hz=20", "gnss.noise_m=1"])
def test_settings_that_change_the_inputs_are_refused(lossy: Path, text: str) -> None:
    key = text.partition("=")[0]
    with pytest.raises(ScenarioError, match=f"--set: {key}: allowed keys of"):
        recompute(lossy, "v3", overrides=(text,))


def test_the_command_prints_a_table_and_draws(lossy: Path, tmp_path: Path) -> None:
    picture = tmp_path / "v2.svg"
    line = ["recompute", str(lossy), "--vehicle", "v2", "--controller", "stanley"]
    printed = CliRunner().invoke(cli, [*line, "-o", str(picture)])
    assert printed.exit_code == 0
    assert "steering_rad" in printed.output
    assert "v2: decisions differ from 0.000 s on" in printed.output
    assert "<svg" in picture.read_text(encoding="utf-8")
    content = json.loads(CliRunner().invoke(cli, [*line, "--json"]).stdout)
    assert content["settings"] == ["vehicle.v2.control.controller=stanley"]
    assert content["decisions"] == 80
    assert content["differences"][0]["field"] == "steering_rad"
    equal = CliRunner().invoke(cli, line[:4])
    assert "v2: all 80 recomputed decisions equal the recorded ones" in equal.output


def test_the_picture_in_rerun_has_both_commands(lossy: Path, tmp_path: Path) -> None:
    saved = tmp_path / "v2.rrd"
    line = ["recompute", str(lossy), "--vehicle", "v2", "--controller", "stanley"]
    assert CliRunner().invoke(cli, [*line, "--rerun", f"save={saved}"]).exit_code == 0
    table = columns(saved)
    result = recompute(lossy, "v2", controller="stanley")
    for name, values in (("recorded", result.recorded), ("recomputed", result.recomputed)):
        curve = table[f"/plots/steering_rad/{name}"]
        rows = [k for k, at in enumerate(curve["run_time"]) if at >= 0]
        shown = [curve["Scalars:scalars"][k][0] for k in rows]
        assert np.radians(shown) == pytest.approx(values["steering_rad"])
        assert curve["run_time"][rows[-1]] == 1_580_000_000
