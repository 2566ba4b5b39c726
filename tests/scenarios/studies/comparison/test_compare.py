"""`convoy compare`: settings, metrics, noise over seeds, a planted offset, damage, pictures."""

import json
from dataclasses import replace
from math import cos, sin
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.definition.scenario import load_scenario
from scenarios.results.log_summary import scenario_of, summary_of
from scenarios.results.summary import RunSummary
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from scenarios.studies.comparison.figure import comparison_figure
from scenarios.studies.comparison.metrics import metric_differences
from scenarios.studies.comparison.runs import compare_runs, logs_of
from tests.made.transport.changed_logs import changed_log
from transport.log.errors import LogError
from transport.log.mcap_file import McapFile
from vehicles.geometry.driven_path import PathWalk
from vehicles.messages import Message, TruePose

PLANTED_M, FROM_M = 0.5, 300.0


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    settings = ["duration_s=13.0", "convoy.vehicles=3", "speed.set_mps=30"]
    run_virtual(load_scenario("lane_change", settings), folder, Stop())
    return folder / "run.mcap"


@pytest.fixture(scope="module")
def shifted(whole: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    scenario = scenario_of(whole)
    start = scenario.route.start - scenario.route.start_station(2)

    def shift(message: Message) -> Message:
        if not (isinstance(message, TruePose) and message.vehicle == "v3"):
            return message
        if message.distance_m - start < FROM_M:
            return message
        east = message.east_m - PLANTED_M * sin(message.yaw_rad)
        north = message.north_m + PLANTED_M * cos(message.yaw_rad)
        return replace(message, east_m=east, north_m=north)

    return changed_log(whole, tmp_path_factory.mktemp("shifted") / "run.mcap", shift)


def compare(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["compare", *map(str, arguments)])


def test_a_planted_offset_is_found_within_a_metre(whole: Path, shifted: Path) -> None:
    result = compare(whole, shifted, "--json")
    assert result.exit_code == 1
    found = json.loads(result.stdout)
    assert (found["metrics"], found["settings"]) == ([], {})
    rows = {row["vehicle"]: row for row in found["positions"]}
    assert rows["v3"]["label"] == "B"
    assert rows["v3"]["parts_at_m"] == pytest.approx(FROM_M, abs=1.0)
    assert rows["v3"]["difference_m_max"] == pytest.approx(PLANTED_M, abs=0.01)
    for name in ("v1", "v2"):
        assert (rows[name]["parts_at_m"], rows[name]["difference_m_max"]) == (None, 0.0)
    assert found["sentence"].endswith("m to the left")
    assert compare(whole, shifted, "--apart", "0.6").exit_code == 0


def test_equal_runs_do_not_differ(whole: Path) -> None:
    result = compare(whole, whole)
    assert result.exit_code == 0
    assert result.output.splitlines()[-1].startswith("equal: no difference in ")


def test_damage_of_either_log_is_named(whole: Path, tmp_path: Path) -> None:
    data = bytearray(whole.read_bytes())
    chunks = McapFile(whole).chunks
    middle = chunks[len(chunks) // 2]
    data[(middle.start + middle.end) // 2] ^= 1
    damaged = tmp_path / "run.mcap"
    damaged.write_bytes(data)
    for pair in ((whole, damaged), (damaged, whole)):
        result = compare(*pair, "--json")
        (fault,) = json.loads(result.stdout)["log_faults"]
        assert str(damaged) in fault
        assert fault in result.stderr
        assert result.exit_code == 1


def test_settings_and_metrics_that_differ_are_listed(tmp_path: Path) -> None:
    for name, gap in (("a", 10), ("b", 12), ("c", 12.3)):
        scenario = load_scenario("lane_change", ["duration_s=0.2", f"convoy.gap_m={gap}"])
        run_virtual(scenario, tmp_path / name, Stop())
    runs = [tmp_path / name for name in "abc"]
    found = json.loads(compare(*runs, "--json").stdout)
    assert found["settings"] == {"convoy.gap_m": ["10.0", "12.0", "12.3"]}
    (metric,) = (
        row for row in found["metrics"] if (row["label"], row["name"]) == ("C", "v2.true_gap_m_min")
    )
    assert metric["difference"] == pytest.approx(2.3, abs=0.01)
    assert compare(*runs[:2]).exit_code == 1
    assert compare(*runs[:1]).exit_code == 2
    results = [compare(*runs[1:], "--tolerance", ratio) for ratio in ("1e-9", "1")]
    assert [result.exit_code for result in results] == [1, 0]


def test_times_and_counters_of_processes_are_no_differences(whole: Path) -> None:
    summary = summary_of(whole)
    vehicles = [
        replace(row, late_ticks=3, lateness_ms_max=9.0, memory_bytes_max=10**7, cpu_ratio=0.1)
        for row in summary.vehicles
    ]
    links = [replace(row, transport_ms_mean=2.0, late=1) for row in summary.links]
    live = replace(summary, vehicles=tuple(vehicles), links=tuple(links))
    compared, differing = metric_differences("B", [summary], [live], 1e-9)
    assert compared > 100
    assert differing == []


def with_error(summary: RunSummary, seed: int, error: float) -> RunSummary:
    vehicles = [
        replace(row, cross_track_error_m_max=error) if row.name == "v2" else row
        for row in summary.vehicles
    ]
    identity = replace(summary.identity, seed=seed)
    return replace(summary, identity=identity, vehicles=tuple(vehicles))


@pytest.mark.parametrize(("shift", "differs"), [(0.0, False), (0.001, False), (0.05, True)])
def test_a_shift_beyond_the_noise_over_seeds_is_marked(
    whole: Path, shift: float, differs: bool
) -> None:
    summary = summary_of(whole)
    errors = (0.05, 0.06, 0.055, 0.052, 0.058)
    noise = (0.002, -0.003, 0.001, -0.001, 0.002)
    a = [with_error(summary, seed, error) for seed, error in enumerate(errors)]
    for first_seed in (0, 100):  # paired, and independent
        b = [
            with_error(summary, first_seed + n, errors[n] + noise[n] + shift)
            for n in range(len(errors))
        ]
        _, (metric,) = metric_differences("B", a, b, 1e-9)
        assert metric.name == "v2.cross_track_error_m_max"
        assert metric.paired == (first_seed == 0)
        assert metric.differs is differs


def test_a_folder_of_runs_and_a_pattern_name_all_runs(whole: Path, tmp_path: Path) -> None:
    for name in ("one-a", "one-b", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.mcap").symlink_to(whole)
    assert len(logs_of(tmp_path)) == 3
    assert [log.parent.name for log in logs_of(tmp_path / "one-*")] == ["one-a", "one-b"]
    with pytest.raises(LogError):
        logs_of(tmp_path / "three-*")
    assert compare(tmp_path, tmp_path / "two").exit_code == 2  # one run has no noise
    assert compare(tmp_path / "one-*", tmp_path / "one-*").exit_code == 0


def test_runs_that_differ_in_the_seed_are_one_group(tmp_path: Path) -> None:
    for gap in (10, 12):
        for seed in (1, 2):
            settings = ["duration_s=0.2", f"convoy.gap_m={gap}"]
            scenario = load_scenario("lane_change", settings, seed)
            run_virtual(scenario, tmp_path / f"{gap}-{seed}", Stop())
    runs = [tmp_path / f"{gap}-{seed}" for gap in (10, 12) for seed in (1, 2)]
    groups = compare_runs(runs).groups
    assert [[run.record.log.parent.name for run in group.runs] for group in groups] == [
        ["10-1", "10-2"], ["12-1", "12-2"],
    ]  # fmt: skip
    assert len(compare_runs(runs[:2]).groups) == 2  # one setting: seeds are compared


def test_the_offset_at_a_place_does_not_depend_on_the_time(tmp_path: Path) -> None:
    for name, speed in (("a", 20), ("b", 10)):
        settings = ["duration_s=8.0", "convoy.vehicles=1", f"speed.set_mps={speed}"]
        settings.append("vehicle.v1.lateral_offset_m=0.0")
        run_virtual(load_scenario("lane_change", settings), tmp_path / name, Stop())
    comparison = compare_runs([tmp_path / "a", tmp_path / "b"])
    (difference,) = comparison.positions
    assert difference.station_m[-1] == pytest.approx(80.0, abs=1.0)
    assert difference.at_s[-1] == pytest.approx(8.0, abs=0.1)
    assert comparison.first is None


def test_positions_of_another_origin_are_moved(tmp_path: Path) -> None:
    settings = ["duration_s=3.0", "convoy.vehicles=1"]
    moved = [*settings, "origin.latitude_deg=30.639"]  # 111 m to the north
    for name, overrides in (("a", settings), ("b", moved)):
        run_virtual(load_scenario("lane_change", overrides), tmp_path / name, Stop())
    comparison = compare_runs([tmp_path / "a", tmp_path / "b"])
    one = comparison.groups[1].vehicles["v1"]
    assert float(one.north_m[0]) == pytest.approx(110.9, abs=0.2)
    assert np.isnan(one.offset_m).all()  # another road
    assert comparison.positions[0].offset_m.size == 0
    assert comparison_figure(comparison).axes


def test_a_drive_that_crosses_itself_stays_on_its_branch() -> None:
    path = load_scenario("church_lot").route.path
    station = np.arange(path.station[0], path.station[-1], 0.6)
    points = np.stack(
        (np.interp(station, path.station, path.east), np.interp(station, path.station, path.north))
    )
    feet = PathWalk(path, float(station[0])).feet(points, 1.02 * (station - station[0]))
    assert np.abs(feet[0] - station).max() < 0.1
    assert np.abs(feet[1]).max() < 0.1


def test_a_figure_is_written_once(whole: Path, shifted: Path, tmp_path: Path) -> None:
    out = tmp_path / "both.svg"
    unknown = compare(whole, shifted, "-o", out, "--vehicles", "v2,v9")
    assert unknown.exit_code == 2
    assert unknown.stderr.endswith("run.mcap: holds no vehicle v9; it has v1, v2, v3\n")
    assert compare(whole, shifted, "-o", out).exit_code == 1
    assert out.read_bytes().startswith(b"<?xml")
    assert compare(whole, shifted, "-o", out).exit_code == 2
    assert compare(whole, shifted, "-o", tmp_path / "both.gif").exit_code == 2


def test_a_recording_has_the_vehicles_of_both_runs(
    whole: Path, shifted: Path, tmp_path: Path
) -> None:
    chunk = pytest.importorskip("rerun.chunk")
    out = tmp_path / "both.rrd"
    assert compare(whole, shifted, "--save", out).exit_code == 1
    drawn = {str(one.entity_path).strip("/") for one in chunk.RrdReader(out).stream()}
    for entity in ("plots/cross_track/v3", "mode/v2", "world/cars/v1"):
        assert {f"{entity}_A", f"{entity}_B"} <= drawn, entity
    assert "world/events/change" in drawn  # the first divergence
