"""Drives as receivers record them: each gives a drivable path with true figures, or one line."""

import re
from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.check.findings import report_of
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.definition.schema.path_tables import PointsPath
from tests.made.scenarios.rough_drives import (
    CASES,
    STRAIGHT,
    Expected,
    Rough,
    path_errors,
    scenario_of,
)

DRIVABLE = {name: case for name, case in CASES.items() if not case[1].refused}
REFUSED = {name: case for name, case in CASES.items() if case[1].refused}


def path_off_truth(scenario: Scenario, rough: Rough) -> float:
    """Largest distance (m) of the path, points and all between them, from the true course."""
    smoothed, table = scenario.route.smoothed, scenario.tables.path
    assert smoothed is not None
    assert isinstance(table, PointsPath)
    road = smoothed.path.station >= smoothed.start
    east, north = smoothed.path.east[road], smoothed.path.north[road]
    if not rough.is_geodetic:
        east = east + table.east_offset_m - rough.offset[0]
        north = north + table.north_offset_m - rough.offset[1]
    return float(np.max(path_errors(rough, east, north)))


@pytest.mark.parametrize(("rough", "expected"), DRIVABLE.values(), ids=DRIVABLE)
def test_the_path_is_where_the_car_was(tmp_path: Path, rough: Rough, expected: Expected) -> None:
    scenario = scenario_of(rough, tmp_path)
    report = report_of(scenario)
    assert path_off_truth(scenario, rough) <= expected.off
    path, road = scenario.tables.path, scenario.route.smoothed
    assert isinstance(path, PointsPath)
    assert road is not None
    assert len(road.holes) == expected.holes
    assert expected.jumps[0] <= path.jumping_points <= expected.jumps[1]
    assert path.standing_points > 20 * expected.stands or not expected.stands
    stands = re.compile("stands for|a pause of|first movement")
    assert sum(bool(stands.search(line)) for line in report.warnings) == expected.stands
    for pattern in expected.patterns:
        assert any(re.search(pattern, line) for line in report.warnings), (pattern, report.warnings)
    assert all(line.isprintable() for line in report.warnings)
    # The figures are those of the receiver: its noise across the path.
    if not rough.drift:
        assert road.deviation_rms == pytest.approx(rough.noise, rel=0.45)
        assert road.noise == pytest.approx(rough.noise, rel=0.25)
    # No car turns tighter, so a car can drive it.
    assert report.radius_m_min is not None
    assert report.radius_m_min > 6.0


@pytest.mark.parametrize(("rough", "expected"), REFUSED.values(), ids=REFUSED)
def test_what_no_car_drives_is_refused_with_place_and_time(
    tmp_path: Path, rough: Rough, expected: Expected
) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario_of(rough, tmp_path)
    (line,) = caught.value.lines
    assert rough.file_name in line
    assert re.search(expected.refused, line)
    assert line.isprintable()


def test_points_given_far_out_are_laid_near_the_origin_too() -> None:
    east = ", ".join(str(300_000.0 + 5.0 * k) for k in range(60))
    north = ", ".join("3900000.0" for _ in range(60))
    text = f'name = "a"\n[path]\nkind = "points"\neast_m = [{east}]\nnorth_m = [{north}]\n'
    scenario = scenario_from_text(text)
    table = scenario.tables.path
    assert isinstance(table, PointsPath)
    assert (table.east_m[0], table.east_m[1], table.north_m[0]) == (0.0, 5.0, 0.0)
    assert (table.east_offset_m, table.north_offset_m) == (300_000.0, 3_900_000.0)


def test_a_road_that_leaves_the_plane_is_refused_in_one_line() -> None:
    text = (
        'name = "a"\n[path]\nkind = "segments"\n'
        "segments = [{ length_m = 99500.0 }]\n[speed]\nset_mps = 50.0\n"
    )
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(text, label="a.toml")
    (line,) = caught.value.lines
    assert line.startswith(
        "a.toml: path: given 99.5 km from the origin of the plane, allowed at most 99 km: "
        "the lead gets there after 99000 m"
    )


def test_a_drive_from_standstill_starts_at_once(tmp_path: Path) -> None:
    route = scenario_of(CASES["standing start"][0], tmp_path).route
    assert route.smoothed is not None
    assert route.start == route.smoothed.start
    assert route.run_in == 0.0
    assert route.profile.time_to(5.0) < 3.0
    # 2 m/s² from the first half metre on: what was recorded, place by place.
    assert route.profile.at(3.0)[0] == pytest.approx(7.4, abs=0.3)


def test_a_stop_lasts_as_long_as_recorded(tmp_path: Path) -> None:
    rough = CASES["two stops"][0]
    scenario = scenario_of(rough, tmp_path)
    recorded = rough.points()[-1][0]
    assert scenario.duration_s == pytest.approx(recorded + scenario.route.run_in, abs=1.5)
    slow = [t for t in np.arange(0.0, recorded, 0.1) if scenario.route.profile.at(t)[0] < 0.3]
    assert len(slow) * 0.1 == pytest.approx(30.0, abs=3.0)


@pytest.mark.parametrize("form", ["csv", "timed"])
def test_where_nothing_was_recorded_the_car_brakes_stands_and_speeds_up(
    tmp_path: Path, form: str
) -> None:
    """A standstill without points, as in a tunnel with a queue."""
    rough = Rough(course=STRAIGHT, holes=((110.0, 60.0),), stands=((140.0, 40.0),), form=form)
    route = scenario_of(rough, tmp_path).route
    profile, smoothed = route.profile, route.smoothed
    assert smoothed is not None
    speeds = np.array(profile.speeds)
    changes = np.diff(speeds) / np.diff(profile.times)
    assert np.max(np.abs(changes)) < 3.0
    assert np.sum(np.diff(profile.times)[speeds[1:] < 0.1]) == pytest.approx(40.0, abs=3.0)
    driven = rough.points()[-1][1] + smoothed.start - route.start
    assert np.trapezoid(speeds, profile.times) == pytest.approx(driven, abs=1.0)
