"""The scenarios that ship, and the commented one that a new scenario starts from."""

import math
import re
import tomllib
from dataclasses import replace
from typing import Any

import pytest
from pydantic import TypeAdapter

from scenarios.definition.check.findings import check
from scenarios.definition.library import template
from scenarios.definition.scenario import library, load_scenario, scenario_from_text
from scenarios.definition.schema.path_tables import PathTable
from scenarios.definition.schema.scenario_tables import ParametersTable, ScenarioTables
from scenarios.definition.vehicle_setup import vehicle_setup
from vehicles.car.parameters import LINCOLN_MKZ

EXAMPLES = {"name", "path"}


def uncommented(text: str) -> dict[str, Any]:
    """The template with all commented keys, except paths."""
    text = re.sub(r"^# \[path\]\n(?:# .*\n)+", "", text, flags=re.MULTILINE)
    return tomllib.loads(
        re.sub(r"^# (?=\[+[\w.]+\]+$|\w+ = |    \{|\]$)", "", text, flags=re.MULTILINE)
    )


def path_examples(text: str) -> list[dict[str, Any]]:
    """The paths in comments."""
    blocks = re.findall(r"^# \[path\]\n((?:# .*\n)+)", text, re.MULTILINE)
    return [tomllib.loads(re.sub(r"^# ", "", block, flags=re.MULTILINE)) for block in blocks]


def test_the_library_has_the_promised_scenarios() -> None:
    assert set(library()) >= {"lane_change", "church_lot", "highway", "lossy_lane_change"}
    assert not any(name.startswith("_") for name in library())


@pytest.mark.parametrize("name", library())
def test_a_shipped_scenario_is_valid_and_gives_no_undue_warning(name: str) -> None:
    report = check(name)
    assert report.name == name
    assert report.description
    if name == "lossy_lane_change":  # made to hurt: small gaps, late and lost poses
        assert all("poses of" in warning or "known" in warning for warning in report.warnings)
    else:
        assert report.warnings == ()


@pytest.mark.parametrize("name", library())
def test_a_shipped_scenario_reads_back_from_its_own_text(name: str) -> None:
    scenario = load_scenario(name)
    again = scenario_from_text(scenario.text)
    assert again.tables == scenario.tables
    assert again.text == scenario.text
    assert again.duration_s == scenario.duration_s
    assert again.route.profile == scenario.route.profile


def test_the_lane_change_is_the_paper_s() -> None:
    scenario = load_scenario("lane_change")
    path, start = scenario.route.path, scenario.route.start
    report = check("lane_change")
    assert (len(report.vehicles), report.gaps_m) == (4, (10.0, 10.0, 10.0))
    assert report.speed_mps_min == report.speed_mps_max == 30.0
    assert report.duration_s == pytest.approx(35.0)
    for name in report.vehicles:  # one passenger in front, three in the rear: 4 x (70 + 50) kg
        setup = scenario.vehicle(name)
        assert setup.parameters.mass == LINCOLN_MKZ.mass + 480.0
        assert setup.assumed_parameters == replace(
            LINCOLN_MKZ, tyres="brush", steering_rate_limit=1.18
        )
        assert setup.steering.alpha_ratio == 0.5

    def aside(seconds: float) -> float:
        return path.at(start + 30.0 * seconds).north  # the road runs east

    # Right at 5 s and back at 20 s, a lane's width, each done within 5 s for the last car too.
    last_car_behind = 45.0 / 30.0
    assert aside(5.0) == pytest.approx(0.0, abs=1e-9)
    assert aside(10.0 - last_car_behind) == pytest.approx(-3.6, abs=0.01)
    assert aside(20.0) == pytest.approx(-3.6, abs=0.01)
    assert aside(25.0 - last_car_behind) == pytest.approx(0.0, abs=0.01)
    assert path.at(start + 30.0 * 25.0).yaw == pytest.approx(0.0, abs=1e-9)


def test_the_car_park_is_driven_three_times_from_walking_pace() -> None:
    scenario, report = load_scenario("church_lot"), check("church_lot")
    smoothed = scenario.route.smoothed
    assert smoothed is not None
    assert report.driven_m > 2.9 * smoothed.lap_length
    assert report.speed_mps_min < 1.5
    assert report.speed_mps_max > 6.0
    assert report.lateral_acceleration_mps2_max == pytest.approx(2.0, abs=0.01)
    assert smoothed.deviation_max < 0.2


def test_the_motorway_is_driven_as_it_was_recorded() -> None:
    scenario, report = load_scenario("highway"), check("highway")
    rows = (
        scenario.tables.path.model_dump()["time_s"],
        scenario.tables.path.model_dump()["speed_mps"],
    )
    route = scenario.route
    assert route.smoothed is not None
    run_in = route.profile.times[1]
    off = [route.profile.at(run_in + time)[0] - speed for time, speed in zip(*rows, strict=True)]
    assert sum(error * error for error in off) / len(off) < 0.15**2  # a second's mean against it
    assert max(map(abs, off)) < 0.8
    assert route.speed_ratio == pytest.approx(1.0, abs=0.002)
    # 59.95 s on record and the run-in; the lead reaches the end of the road with the record's.
    assert report.duration_s == pytest.approx(run_in + 59.9, abs=0.2)


def test_the_template_is_a_scenario() -> None:
    scenario = scenario_from_text(template())
    assert scenario.duration_s == pytest.approx(40.0, abs=0.1)  # 800 m at 20 m/s


def test_the_template_sets_the_defaults() -> None:
    given = tomllib.loads(template())
    tables = ScenarioTables.model_validate(given)
    defaults = ScenarioTables.model_validate({k: given[k] for k in EXAMPLES})
    assert tables == defaults
    default_car = vehicle_setup(defaults, "v1").parameters
    assert replace(default_car, steering_rate_limit=math.inf, tyres="linear") == LINCOLN_MKZ


def test_the_documented_parameters_are_those_of_the_default_car() -> None:
    text = ParametersTable.__doc__ or ""
    documented = [float(number) for number in re.findall(r"default ([\d.]+)$", text, re.MULTILINE)]
    fields = list(LINCOLN_MKZ.__dataclass_fields__)[: len(documented)]
    assert documented == [getattr(LINCOLN_MKZ, field) for field in fields]
    assert len(documented) == 11


def test_commented_keys_of_the_template_are_valid() -> None:
    whole = uncommented(template())
    tables = ScenarioTables.model_validate(whole)
    assert tables.speed.profile
    assert tables.link
    assert set(tables.vehicle["v3"].model_fields_set) >= {"control", "gnss", "loading", "gap_m"}
    kinds = [TypeAdapter(PathTable).validate_python(path) for path in path_examples(template())]
    assert [path.kind for path in kinds] == ["trace"]
