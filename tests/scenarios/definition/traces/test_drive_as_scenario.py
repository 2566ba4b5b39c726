"""A recorded drive in place of a scenario: its path, its recorded speed, overrides, errors."""

from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.check.findings import report_of
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario, scenario_from_text
from scenarios.definition.schema.path_tables import PointsPath
from scenarios.studies.many.plan import planned
from scenarios.studies.many.variant import variant_of
from tests.made.scenarios.recorded_drives import (
    CSV,
    WRITERS,
    Drive,
    as_plane_csv,
    drive,
    driven,
    write_log,
)


def back_and_forth() -> Drive:
    """A drive that turns back on the spot after 20 s."""
    back = enumerate(drive()[:100][::-1])
    return [*drive(), *((20.1 + 0.1 * k, e, n, v) for k, (_, e, n, v) in back)]


@pytest.mark.parametrize("file", WRITERS)
def test_a_drive_is_driven_like_a_scenario_with_its_recorded_speed(
    tmp_path: Path, file: str
) -> None:
    path = tmp_path / file
    path.write_bytes(WRITERS[file](drive()))
    mine, written = load_scenario(path), driven(path, speed='lead = "recorded"')
    assert mine.name == Path(file).stem
    assert mine.tables.path == written.tables.path
    assert mine.tables.speed == written.tables.speed
    assert mine.duration_s == written.duration_s
    assert scenario_from_text(mine.text).tables == mine.tables


def test_the_speed_is_set_without_times_and_where_it_is_configured(tmp_path: Path) -> None:
    timed, still = tmp_path / "timed.csv", tmp_path / "still.csv"
    timed.write_bytes(as_plane_csv(drive()))
    still.write_text(CSV + "".join(f"{k},0\n" for k in range(100)))
    assert load_scenario(still).tables.speed.lead == "set"
    assert load_scenario(still, ["speed.set_mps=7"]).route.profile.at(0.0)[0] == 7.0
    assert load_scenario(timed).tables.speed.lead == "recorded"
    for override in ("speed.set_mps=7", 'speed.lead="set"'):
        assert load_scenario(timed, [override]).tables.speed.lead == "set"


def test_one_file_gives_lead_and_follower(tmp_path: Path) -> None:
    rows = "".join(f"{t},1,{e},{n}\n{t},2,{e - 20.0},{n}\n" for t, e, n, _ in drive()[:80])
    path = tmp_path / "two.csv"
    path.write_text(f"t_s,id,x_m,y_m\n{rows}")
    names = ["path.vehicle=1", f"vehicle.v2.replay={str(path)!r}", "vehicle.v2.replay_vehicle=2"]
    scenario = load_scenario(path, [*names, "convoy.vehicles=3"])
    table, second = scenario.tables.path, scenario.tables.vehicle["v2"].drive
    assert isinstance(table, PointsPath)
    assert second is not None
    assert np.subtract(table.east_m, second.east_m) == pytest.approx([20.0] * 80)


@pytest.mark.parametrize("speed", [8.0, 30.0])
def test_noise_of_the_points_is_no_bend_of_the_road(tmp_path: Path, speed: float) -> None:
    """Bends are no harder than the true 1.5 m/s² by more than half of it, at any speed."""
    times, radius = np.arange(0.0, 20.0, 0.05), speed**2 / 1.5
    noise = np.random.default_rng(1).normal(0.0, 0.02, (2, times.size))
    angles = speed * times / radius
    east, north = radius * np.sin(angles) + noise[0], radius * (1 - np.cos(angles)) + noise[1]
    path = tmp_path / "bend.csv"
    points = zip(times.tolist(), east.tolist(), north.tolist(), [speed] * times.size, strict=True)
    path.write_bytes(as_plane_csv([*points]))
    scenario = load_scenario(path)
    report, road = report_of(scenario), scenario.route.smoothed
    assert 1.4 < report.lateral_acceleration_mps2_max < 2.3
    assert road is not None
    assert road.deviation_max < 0.1


def test_keys_of_the_path_can_be_overridden(tmp_path: Path) -> None:
    path = tmp_path / "drive.csv"
    path.write_bytes(as_plane_csv(drive()))
    table = load_scenario(path, ["path.smoothing_m=12", "convoy.vehicles=3", "seed=5"]).tables
    assert isinstance(table.path, PointsPath)
    assert (table.path.smoothing_m, table.convoy.vehicles, table.seed) == (12.0, 3, 5)


def test_a_log_and_its_folder_are_drives_of_the_lead_or_another_vehicle(tmp_path: Path) -> None:
    folder = tmp_path / "20260101-my run"
    folder.mkdir()
    write_log(folder / "run.mcap", drive())
    for given in (folder, folder / "run.mcap"):
        scenario = load_scenario(given)
        assert scenario.name == "drive_20260101-my_run"
        assert scenario.tables.speed.lead == "recorded"
        assert scenario.route.smoothed is not None
        assert scenario.route.smoothed.lap_length == pytest.approx(240.0, abs=0.1)
    lead, second = (load_scenario(folder, [f"path.vehicle={name}"]) for name in ("v1", "v2"))
    assert lead.origin != second.origin


def test_studies_take_a_drive_with_the_overrides_that_select_a_part(tmp_path: Path) -> None:
    path = tmp_path / "back.csv"
    path.write_bytes(as_plane_csv(back_and_forth()))
    overrides = ("convoy.vehicles=2", "path.to_s=8", "speed.set_mps=7")
    variant = variant_of(str(path), overrides)
    assert variant.scenario.tables.convoy.vehicles == 2
    assert variant.scenario.route.profile.at(0.0)[0] == 7.0
    assert set(variant.scenario.overrides) == {*overrides, "seed=1"}
    assert variant.command.endswith(
        "--set=convoy.vehicles=2 --set=path.to_s=8 --set=speed.set_mps=7 --seed 1 --clock virtual"
    )
    assert variant.scenario.duration_s == load_scenario(path, overrides).duration_s
    plan = planned(str(path), vary=["path.smoothing_m=5,9"], seeds=1, sets=overrides)
    paths = [plan.variants(cell)[0].scenario.tables.path for cell in plan.cells]
    assert [getattr(table, "smoothing_m", 0.0) for table in paths] == [5.0, 9.0]


def test_a_refused_drive_has_one_line_that_begins_with_its_file(tmp_path: Path) -> None:
    for name, content, why in (
        ("nothing.csv", "x_m,y_m\n", "no"),
        ("still.csv", CSV + "0,0\n0.1,0\n" * 10, "all "),
        ("back.csv", as_plane_csv(back_and_forth()).decode(), "line "),
    ):
        path = tmp_path / name
        path.write_text(content)
        with pytest.raises(ScenarioError) as caught:
            load_scenario(path)
        (line,) = caught.value.lines
        assert line.startswith(f"{path}: {why}")
        assert line.count(name) == 1
