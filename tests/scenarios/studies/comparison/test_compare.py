"""`convoy compare`: a planted offset, equal runs, other origins, and its pictures."""

import json
from collections.abc import Mapping
from dataclasses import replace
from math import cos, sin
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.definition.scenario import load_scenario
from scenarios.results.log_summary import scenario_of, summary_of
from scenarios.results.vehicle_figures import string_errors
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from scenarios.studies.comparison.run_comparison import compare_runs
from tests.made.transport.changed_logs import changed_log
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
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    (divergence,) = found["divergences"]
    assert (divergence["label"], divergence["vehicle"]) == ("B", "v3")
    assert divergence["station_m"] == pytest.approx(FROM_M, abs=1.0)
    assert divergence["offset_m"] == pytest.approx(PLANTED_M, abs=0.01)
    assert found["first"]["sentence"]
    largest = {row["vehicle"]: row["offset_m_max"] for row in found["differences"]}
    assert largest["v3"] == pytest.approx(PLANTED_M, abs=0.01)
    assert largest["v1"] == largest["v2"] == 0.0


def test_equal_runs_do_not_diverge(whole: Path) -> None:
    comparison = compare_runs([whole, whole])
    assert comparison.divergences == ()
    assert all(one.largest[0] == 0.0 for one in comparison.differences)


def test_the_offset_at_a_place_does_not_depend_on_the_time(tmp_path: Path) -> None:
    for name, speed in (("a", 20), ("b", 10)):
        settings = ["duration_s=8.0", "convoy.vehicles=1", f"speed.set_mps={speed}"]
        settings.append("vehicle.v1.lateral_offset_m=0.0")
        run_virtual(load_scenario("lane_change", settings), tmp_path / name, Stop())
    comparison = compare_runs([tmp_path / "a", tmp_path / "b"])
    (difference,) = comparison.differences
    assert difference.station_m[-1] == pytest.approx(80.0, abs=1.0)
    assert difference.at_s[-1] == pytest.approx(8.0, abs=0.1)
    assert comparison.first is None


def test_positions_of_another_origin_are_moved(tmp_path: Path) -> None:
    settings = ["duration_s=3.0", "convoy.vehicles=1"]
    moved = [*settings, "origin.latitude_deg=30.639"]  # 111 m to the north
    for name, overrides in (("a", settings), ("b", moved)):
        run_virtual(load_scenario("lane_change", overrides), tmp_path / name, Stop())
    comparison = compare_runs([tmp_path / "a", tmp_path / "b"])
    one = comparison.runs[1].vehicles["v1"]
    assert float(one.north_m[0]) == pytest.approx(110.9, abs=0.2)
    assert np.isnan(one.offset_m).all()  # another road
    assert comparison.differences[0].offset_m.size == 0


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
    assert compare(whole, shifted, "-o", out).exit_code == 0
    assert out.read_bytes().startswith(b"<?xml")
    assert compare(whole, shifted, "-o", out).exit_code == 2
    assert compare(whole, shifted, "-o", tmp_path / "both.gif").exit_code == 2


def test_a_recording_has_both_timelines(whole: Path, shifted: Path, tmp_path: Path) -> None:
    chunk = pytest.importorskip("rerun.chunk")
    out = tmp_path / "both.rrd"
    assert compare(whole, shifted, "--save", out).exit_code == 0
    timelines: dict[str, set[str]] = {}
    for one in chunk.RrdReader(out).stream():
        entity = str(one.entity_path).strip("/")
        names = one.to_record_batch().schema.names
        timelines.setdefault(entity, set()).update(names)
    for entity in ("plots/error/v3/A", "plots/difference/v3/B", "mode/v2_B", "world/cars/A/v1"):
        assert {"run_time", "path_m"} <= timelines[entity], entity


def test_errors_along_the_string_are_those_of_the_summary(whole: Path) -> None:
    summary = summary_of(whole)
    rows: Mapping[str, float | None]
    rows = {row.name: row.cross_track_error_m_max for row in summary.vehicles}
    first, second = string_errors(summary.vehicles)
    assert (first.error_m_max, second.error_m_max) == (rows["v2"], rows["v3"])
    assert second.figures == summary.vehicles[2].string
