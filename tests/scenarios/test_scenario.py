"""Scenario files: what they resolve to, how overrides act, and how broken ones are refused."""

import math
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.check import CheckReport, check, report_of, warnings
from scenarios.errors import ScenarioError
from scenarios.scenario import load_scenario, scenario_from_text
from scenarios.toml_text import override, parse_override, to_toml
from vehicles.parameters import LINCOLN_MKZ

STRAIGHT = """
name = "straight"
duration_s = 20.0
[path]
kind = "segments"
segments = [{ length_m = 1000.0 }]
"""

COORDINATES = "t_s,x_m,y_m\n" + "".join(f"{k},{10 * k},0\n" for k in range(20))


def refused(text: str, *overrides: str, folder: Path | None = None) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(text, label="a.toml", overrides=overrides, folder=folder)
    return list(caught.value.lines)


# --- What a scenario resolves to


def test_defaults_are_the_paper_s() -> None:
    scenario = scenario_from_text(STRAIGHT)
    assert scenario.vehicle_names == ("v1", "v2", "v3", "v4")
    assert scenario.route.gaps == (0.0, 15.0, 15.0, 15.0)
    assert (scenario.control_rate_hz, scenario.vehicle("v2").gnss.rate_hz) == (50.0, 20.0)
    steering = scenario.vehicle("v3").steering
    gains = steering.gains
    assert (gains.lateral_rad_per_m, gains.heading_rad_per_rad, gains.yaw_rate_s) == (
        0.06,
        0.96,
        0.08,
    )
    assert (steering.alpha_ratio, steering.preview_s, steering.tolerance_m) == (0.5, 0.8, 0.1)
    assert scenario.vehicle("v4").parameters == LINCOLN_MKZ
    assert scenario.start_at_ns == 1_767_225_600 * 10**9  # 2026-01-01, counted in days from 1970


def test_followers_hear_the_lead_and_the_vehicle_ahead() -> None:
    scenario = scenario_from_text(STRAIGHT)
    hears = {name: scenario.vehicle(name).hears for name in scenario.vehicle_names}
    assert hears == {"v1": (), "v2": ("v1",), "v3": ("v1", "v2"), "v4": ("v1", "v3")}
    assert scenario.vehicle("v3").predecessor == "v2"
    assert {name: set(scenario.links_into(name)) for name in hears} == {
        name: set(heard) for name, heard in hears.items()
    }


def test_vehicles_start_behind_each_other_on_a_straight_through_the_origin() -> None:
    scenario = scenario_from_text(
        STRAIGHT, overrides=["vehicle.v3.gap_m=40", "convoy.gap_m=10", "path.heading_deg=0"]
    )
    places = [scenario.route.path.at(scenario.route.start_station(k)) for k in range(4)]
    assert [(round(p.east, 9), round(p.north, 9)) for p in places] == [
        (0.0, 0.0),
        (0.0, -10.0),
        (0.0, -50.0),
        (0.0, -60.0),
    ]


def test_one_vehicle_differs_only_in_what_its_table_says() -> None:
    text = (
        STRAIGHT
        + """
[control]
preview_s = 1.0
[control.gains]
lateral_rad_per_m = 0.1
[loading]
rear_passengers = 2
[vehicle.v2.control]
alpha_ratio = 0.25
knows_loading = true
[vehicle.v2.control.gains]
yaw_rate_s = 0.2
[vehicle.v2.loading]
front_passengers = 1
[vehicle.v2.parameters]
mass_kg = 2000.0
[vehicle.v2.gnss]
position_noise_m = 0.5
"""
    )
    scenario = scenario_from_text(text)
    other, own = scenario.vehicle("v3"), scenario.vehicle("v2")
    assert (own.steering.alpha_ratio, other.steering.alpha_ratio) == (0.25, 0.5)
    assert own.steering.preview_s == other.steering.preview_s == 1.0
    assert own.steering.gains.model_dump() == {
        "lateral_rad_per_m": 0.1,
        "heading_rad_per_rad": 0.96,
        "yaw_rate_s": 0.2,
    }
    assert own.parameters.mass == 2000.0 + 3 * 120.0
    assert own.assumed_parameters == own.parameters
    assert other.parameters.mass == LINCOLN_MKZ.mass + 2 * 120.0
    assert other.assumed_parameters == LINCOLN_MKZ
    assert (own.gnss.position_noise_m, other.gnss.position_noise_m) == (0.5, 0.02)
    assert own.gnss.rate_hz == 20.0


def test_the_last_entry_that_fits_a_link_wins_key_by_key() -> None:
    text = (
        STRAIGHT
        + """
[links]
latency_ms = 30.0
[[link]]
sender = "v1"
receiver = "*"
loss_ratio = 0.5
jitter_ms = 7.0
[[link]]
sender = "*"
receiver = "v3"
loss_ratio = 0.1
"""
    )
    scenario = scenario_from_text(text)
    v2, v3 = scenario.links_into("v2"), scenario.links_into("v3")
    assert (v2["v1"].loss_ratio, v2["v1"].jitter_ms, v2["v1"].latency_ms) == (0.5, 7.0, 30.0)
    assert (v3["v1"].loss_ratio, v3["v1"].jitter_ms) == (0.1, 7.0)
    assert (v3["v2"].loss_ratio, v3["v2"].jitter_ms, v3["v2"].latency_ms) == (0.1, 0.0, 30.0)
    assert scenario.links_into("v4")["v3"].loss_ratio == 0.0


def test_a_scenario_s_text_holds_all_of_it(tmp_path: Path) -> None:
    (tmp_path / "drive.csv").write_text(COORDINATES + "13,nonsense,0\n")
    text = """
name = "whole"
[path]
kind = "trace"
file = "drive.csv"
[speed]
lead = "recorded"
[[link]]
sender = "*"
receiver = "v2"
loss_ratio = 0.25
[vehicle.v3.control]
alpha_ratio = 1.0
"""
    scenario = scenario_from_text(text, folder=tmp_path)
    (tmp_path / "drive.csv").unlink()
    again = scenario_from_text(scenario.text, folder=tmp_path)
    assert again.tables == scenario.tables
    assert again.duration_s == scenario.duration_s
    assert again.links_into("v2") == scenario.links_into("v2")
    assert again.vehicle("v3") == scenario.vehicle("v3")
    assert warnings(again) == warnings(scenario)
    assert "drive.csv: 1 bad line skipped" in warnings(again)[0]


def test_the_seed_argument_wins_over_file_and_override() -> None:
    assert scenario_from_text(STRAIGHT, overrides=["seed=5"]).seed == 5
    assert scenario_from_text(STRAIGHT, overrides=["seed=5"], seed=7).seed == 7


def test_without_a_duration_the_lead_drives_its_whole_path() -> None:
    text = STRAIGHT.replace("duration_s = 20.0\n", "")
    assert scenario_from_text(text, overrides=["speed.set_mps=25"]).duration_s == 40.0


# --- Overrides


@settings(max_examples=50)
@given(
    key=st.lists(st.from_regex(r"\A[a-z_]{1,8}\Z"), min_size=1, max_size=4),
    value=st.one_of(
        st.integers(-(2**62), 2**62),
        st.floats(allow_nan=False),
        st.booleans(),
        st.lists(st.floats(-1e3, 1e3), max_size=3),
        st.text(st.characters(exclude_categories=["Cs"]), max_size=12),
    ),
)
def test_an_override_sets_just_the_value_that_it_gives(key: list[str], value: Any) -> None:
    written = to_toml({"x": value}).removeprefix("x = ").rstrip("\n")
    parts, parsed = parse_override(f"{'.'.join(key)}={written}")
    table: dict[str, Any] = {"untouched": 1, key[0]: {}} if key[0] != "untouched" else {}
    override(table, parts, parsed)
    found: Any = table
    for part in key:
        found = found[part]
    assert found == value
    assert type(found) is type(value)


@settings(max_examples=50)
@given(alpha=st.floats(0, 1), latency=st.floats(0, 1000), seed=st.integers(0, 2**63 - 1))
def test_overrides_arrive_in_the_scenario_and_survive_its_text(
    alpha: float, latency: float, seed: int
) -> None:
    scenario = scenario_from_text(
        STRAIGHT,
        overrides=[
            f"control.alpha_ratio={alpha!r}",
            f"links.latency_ms={latency!r}",
            f"seed={seed}",
        ],
    )
    assert scenario.vehicle("v3").steering.alpha_ratio == alpha
    assert scenario.links_into("v3")["v2"].latency_ms == latency
    assert scenario.seed == seed
    assert scenario_from_text(scenario.text).tables == scenario.tables


@settings(max_examples=50)
@given(
    st.recursive(
        st.one_of(
            st.integers(-(2**62), 2**62),
            st.floats(allow_nan=False),
            st.booleans(),
            st.text(st.characters(exclude_categories=["Cs"])),
            st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=3),
        ),
        lambda inner: st.dictionaries(st.text(st.characters(exclude_categories=["Cs"])), inner),
        max_leaves=12,
    ).filter(lambda value: isinstance(value, dict))
)
def test_written_toml_reads_back_equal(table: dict[str, Any]) -> None:
    assert tomllib.loads(to_toml(table)) == table


def test_an_override_may_be_written_without_quotes_and_with_indices() -> None:
    scenario = scenario_from_text(
        STRAIGHT,
        overrides=[
            "control.fusion=predecessor",
            "path.segments.0.length_m=500",
            "path.segments[1].length_m=700",
            "link.0={sender='*', receiver='v2', loss_ratio=0.5}",
        ],
    )
    assert scenario.vehicle("v2").steering.fusion == "predecessor"
    assert scenario.route.length == pytest.approx(1200.0)
    assert scenario.links_into("v2")["v1"].loss_ratio == 0.5


# --- Broken scenarios: one clear line each, with file, key, what was given, what is allowed

BROKEN_BY_OVERRIDE = {
    "wrong type": ("duration_s='long'", "duration_s", 'given "long"', "a number"),
    "boolean for a number": ("speed.set_mps=true", "speed.set_mps", "given true", "a number"),
    "fraction of a vehicle": ("convoy.vehicles=2.5", "convoy.vehicles", "2.5", "a whole number"),
    "text for a list": ("path.segments='x'", "path.segments", 'given "x"', "a list"),
    "value for a table": ("control=3", "control", "given 3", "a table"),
    "wrong unit": ("links.latency_s=0.02", "links.latency_s", "unknown", "links.latency_ms?"),
    "per cent": ("links.loss_percent=5", "links.loss_percent", "unknown", "links.loss_ratio?"),
    "misspelt key": ("convoy.vehicels=3", "convoy.vehicels", "unknown", "convoy.vehicles?"),
    "key of another table": ("alpha_ratio=1", "alpha_ratio", "unknown", "control.alpha_ratio?"),
    "negative rate": ("control.rate_hz=-50", "control.rate_hz", "given -50", "5 to 500"),
    "no rate": ("gnss.rate_hz=0", "gnss.rate_hz", "given 0", "more than 0, at most 100"),
    "too much loss": ("links.loss_ratio=1.5", "links.loss_ratio", "given 1.5", "0 to 1"),
    "negative latency": ("links.latency_ms=-1", "links.latency_ms", "given -1", "0 to 60000"),
    "not a number": ("speed.set_mps=nan", "speed.set_mps", "given nan", "a finite number"),
    "infinity": ("convoy.gap_m=inf", "convoy.gap_m", "given inf", "a finite number"),
    "unknown choice": ("control.fusion='both'", "control.fusion", '"both"', '"composite"'),
    "unknown path": ("path.kind='road'", "path.kind", 'given "road"', '"segments", "trace"'),
    "local time": ("start_at=2026-01-01T00:00:00", "start_at", "2026", "with its zone"),
    "empty road": ("path.segments=[]", "path.segments", "given []", "at least one entry"),
    "impossible name": ("convoy.names=['a/b']", "convoy.names[0]", '"a/b"', "a letter first"),
    "two of one name": ("convoy.names=['a','b','a']", "convoy.names[2]", 'given "a"', "names[0]"),
    "the launcher's name": ("convoy.names=['run']", "convoy.names[0]", 'given "run"', "launcher"),
    "unknown vehicle": ("vehicle.v9.gap_m=8", "vehicle.v9", "no such", "v1, v2, v3, v4"),
    "gap of the lead": ("vehicle.v1.gap_m=8", "vehicle.v1.gap_m", "lead", "nobody ahead"),
    "link to nobody": (
        "link=[{sender='v1', receiver='v7'}]",
        "link[0].receiver",
        'given "v7"',
        '"v4", "*"',
    ),
    "link that nobody hears": ("link=[{sender='v3', receiver='v2'}]", "link[0]", "v3", "listens"),
    "touching bumpers": ("convoy.gap_m=4", "convoy.gap_m", "given 4", "more than 4.93"),
    "path too short": ("duration_s=51", "duration_s", "given 51", "at most 50"),
    "profile without points": ("speed.lead='profile'", "speed.profile", "missing", "profile"),
    "nothing recorded": ("speed.lead='recorded'", "speed.lead", "recorded", "a trace with times"),
    "radius without turn": (
        "path.segments.0.radius_m=50",
        "path.segments[0].turn",
        "missing",
        "radius_m",
    ),
    "unknown controller": ("control.controller='pid'", "control.controller", "pid", '"stanley"'),
    "not an override": ("seed", "seed", "given", "key=value"),
    "key below a value": ("duration_s.x=1", "duration_s", "is a value", "no key x"),
    "entry too far": ("path.segments.7.length_m=1", "path.segments", "index 7", "0 to 1"),
}


@pytest.mark.parametrize(
    ("change", "key", "given_", "allowed"), BROKEN_BY_OVERRIDE.values(), ids=BROKEN_BY_OVERRIDE
)
def test_a_broken_value_is_refused_in_one_line(
    change: str, key: str, given_: str, allowed: str
) -> None:
    (line,) = refused(STRAIGHT, change)
    assert line.startswith(("--set", "a.toml: "))
    assert key in line
    assert given_ in line
    assert allowed in line
    assert "\n" not in line
    assert len(line) < 250


BROKEN_TEXT = {
    "not TOML": ("name = \n", "not valid TOML", "line 1"),
    "a key twice": ("name = 'a'\nname = 'b'\n", "not valid TOML", "line 2"),
    "no path": ("name = 'a'\n", "path", "missing"),
    "no kind of path": ("name = 'a'\n[path]\nfile = 'x.csv'\n", "path.kind", "missing"),
    "no name": (STRAIGHT.replace('name = "straight"', ""), "name", "missing"),
    "unequal lists": (
        "name = 'a'\n[path]\nkind = 'points'\neast_m = [0, 1]\nnorth_m = [0]\n",
        "path.north_m",
        "allowed 2",
    ),
    "laps of an open drive": (
        "name = 'a'\n[path]\nkind = 'trace'\nfile = 'x.csv'\nlaps = 2\n",
        "path.laps",
        "path.closed = true",
    ),
    "profile out of order": (
        STRAIGHT
        + "[speed]\nlead = 'profile'\n"
        + "profile = [{at_s = 1.0, speed_mps = 5.0}, {at_s = 1.0, speed_mps = 6.0}]\n",
        "speed.profile[1].at_s",
        "allowed more than 1",
    ),
    "a lead that never arrives": (
        STRAIGHT.replace("duration_s = 20.0\n", "")
        + "[speed]\nlead = 'profile'\nprofile = [{at_s = 0.0, speed_mps = 0.0}]\n",
        "duration_s",
        "does not reach the end",
    ),
    "trace that is not there": (
        "name = 'a'\n[path]\nkind = 'trace'\nfile = 'missing.csv'\n",
        "path.file",
        "no such file",
    ),
}


@pytest.mark.parametrize(("text", "key", "why"), BROKEN_TEXT.values(), ids=BROKEN_TEXT)
def test_a_broken_file_is_refused_in_one_line(text: str, key: str, why: str) -> None:
    (line,) = refused(text)
    assert line.startswith("a.toml: ")
    assert key in line
    assert why in line


@settings(max_examples=200)
@given(
    key=st.sampled_from(
        [
            *("name", "seed", "duration_s", "start_at", "origin.latitude_deg", "control.rate_hz"),
            *("convoy.vehicles", "convoy.names", "convoy.gap_m", "control.controller", "gnss"),
            *("speed.lead", "speed.set_mps", "speed.profile", "speed.followers", "links.rate_hz"),
            *("path", "path.kind", "path.laps", "path.segments.0.length_m", "link", "vehicle.v2"),
            *("vehicle.v1.control", "parameters.length_m", "loading.rear_passengers"),
        ]
    ),
    value=st.sampled_from(
        [
            *("0", "-1", "1", "7", "1e308", "1e-308", "nan", "inf", "true", "'x'", "'*'", "'gap'"),
            *("'profile'", "[]", "[{}]", "{}", "{a=1}", "[{at_s=0.0, speed_mps=0.0}]"),
            *("['a', 'b']", "0001-01-01T00:00:00Z", "9999-12-31T23:59:59Z", "1979-05-27"),
        ]
    ),
)
def test_no_value_of_any_key_gives_anything_but_a_scenario_or_clear_lines(
    key: str, value: str
) -> None:
    lines: tuple[str, ...] = ()
    try:
        scenario = scenario_from_text(STRAIGHT, overrides=[f"{key}={value}"])
        assert scenario_from_text(scenario.text).tables == scenario.tables
    except ScenarioError as error:
        lines = error.lines or ("",)
    assert all(line and line.isprintable() and len(line) < 300 for line in lines)


def test_every_problem_of_a_file_has_its_line() -> None:
    text = STRAIGHT + "[convoy]\nvehicles = 0\ngap = 3.0\n[links]\nloss_ratio = 2\n"
    lines = refused(text, "seed=-1")
    assert len(lines) == 4
    assert [line.split(":")[0] for line in lines] == ["--set", "a.toml", "a.toml", "a.toml"]


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("missing.toml", None, "no such file"),
        ("empty.toml", b" \n", "empty file"),
        ("binary.toml", bytes(range(128, 256)), "not a text file, byte 0 is not UTF-8"),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_in_one_line(
    tmp_path: Path, name: str, content: bytes | None, why: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(tmp_path / name)
    (line,) = caught.value.lines
    assert name in line
    assert why in line


def test_a_folder_and_a_misspelt_name_are_refused_helpfully(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="is a directory"):
        load_scenario(tmp_path)
    with pytest.raises(
        ScenarioError, match=r"lane_chagne: no such file, did you mean lane_change\?"
    ):
        load_scenario("lane_chagne")
    with pytest.raises(ScenarioError, match='no vehicle "v5", allowed v1, v2, v3, v4'):
        load_scenario("lane_change").vehicle("v5")


# --- The lead's speed


def test_a_set_speed_is_lowered_for_a_curve_and_taken_up_again() -> None:
    text = STRAIGHT.replace(
        "{ length_m = 1000.0 }",
        "{ length_m = 200.0 }, { length_m = 60.0, radius_m = 50.0, turn = 'left' }, "
        "{ length_m = 400.0 }",
    ).replace("duration_s = 20.0\n", "")
    report = check_text(text)
    assert report.lateral_acceleration_mps2_max == pytest.approx(3.0, rel=2e-3)
    assert report.speed_mps_min == pytest.approx((3.0 * 50.0) ** 0.5, rel=1e-3)
    assert report.braking_mps2_max == pytest.approx(2.5, rel=0.02)
    assert report.acceleration_mps2_max == pytest.approx(1.5, rel=0.02)
    assert report.speed_mps_max == 20.0
    assert any("lowered to 12.2 m/s" in warning for warning in report.warnings)


def test_a_profile_is_driven_exactly_where_no_curve_asks_for_less() -> None:
    text = STRAIGHT + (
        "[speed]\nlead = 'profile'\n"
        "profile = [{at_s = 2.0, speed_mps = 10.0}, {at_s = 12.0, speed_mps = 30.0}]\n"
    )
    route = scenario_from_text(text).route
    assert [route.profile.at(t)[0] for t in (0.0, 2.0, 7.0, 12.0, 99.0)] == [10, 10, 20, 30, 30]
    # 20 m, then 10 s at a mean of 20 m/s, then 8 s at 30 m/s
    assert route.plan.distance(20.0) == pytest.approx(20.0 + 200.0 + 240.0)
    assert route.plan.time_to(220.0) == pytest.approx(12.0)
    assert route.plan.time_to(100.0) == pytest.approx(2.0 + _time_for(80.0))


def _time_for(way: float) -> float:
    """Time to cover `way` from 10 m/s at 2 m/s²."""
    return (math.sqrt(100.0 + 4.0 * way) - 10.0) / 2.0


def test_gap_keeping_vehicles_start_at_the_gap_that_they_keep() -> None:
    scenario = scenario_from_text(
        STRAIGHT,
        overrides=[
            "speed.followers='gap'",
            "speed.gap.standstill_m=6",
            "speed.gap.headway_s=0.8",
            "speed.set_mps=10",
        ],
    )
    assert scenario.route.gaps == (0.0, 14.0, 14.0, 14.0)
    assert scenario.gap_policy.desired(10.0) == 14.0


def check_text(text: str) -> CheckReport:
    return report_of(scenario_from_text(text))


def test_check_warns_of_what_may_surprise() -> None:
    assert check("lane_change").warnings == ()
    fast = check("lane_change", ["gnss.rate_hz=50"]).warnings
    assert len(fast) == 4
    assert "v1 measures at 50 Hz" in fast[0]
    tight = STRAIGHT.replace(
        "{ length_m = 1000.0 }", "{ length_m = 5.0, radius_m = 4.0, turn = 'right' }"
    ).replace("duration_s = 20.0\n", "")
    assert any("radius of 4.0 m" in warning for warning in check_text(tight).warnings)
