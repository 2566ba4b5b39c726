"""Scenario files: what they resolve to."""

import tomllib
from dataclasses import replace
from typing import Any

import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.scenario import load_scenario, scenario_from_text
from tests.made.examples import examples
from tests.made.scenarios.messages import STRAIGHT
from vehicles.car.parameters import LINCOLN_MKZ, Gains

DEFAULT_CAR = replace(LINCOLN_MKZ, tyres="brush", steering_rate_limit=1.18)


def test_defaults_are_the_paper_s() -> None:
    scenario = scenario_from_text(STRAIGHT)
    assert scenario.vehicle_names == ("v1", "v2", "v3", "v4")
    assert scenario.route.gaps == (0.0, 10.0, 10.0, 10.0)
    assert (scenario.control_rate_hz, scenario.vehicle("v2").gnss.rate) == (50.0, 20.0)
    steering = scenario.vehicle("v3").steering
    gains = steering.gains
    assert (gains.lateral_rad_per_m, gains.heading_rad_per_rad, gains.yaw_rate_s) == (
        0.06,
        0.96,
        0.08,
    )
    assert (steering.alpha_ratio, steering.preview_s, steering.tolerance_m) == (0.5, 0.8, 0.1)
    assert scenario.vehicle("v4").parameters == DEFAULT_CAR
    assert scenario.start_at_ns == 1_767_225_600 * 10**9  # 2026-01-01, counted in days from 1970


def test_followers_receive_from_lead_and_predecessor_and_the_lead_from_all_but_the_last() -> None:
    scenario = scenario_from_text(STRAIGHT)
    sources = {name: scenario.vehicle(name).senders for name in scenario.vehicle_names}
    assert sources == {
        "v1": ("v2", "v3"), "v2": ("v1",), "v3": ("v1", "v2"), "v4": ("v1", "v3"),
    }  # fmt: skip
    assert scenario.vehicle("v3").predecessor == "v2"
    assert set(scenario.links) == {
        (sender, name) for name, senders in sources.items() for sender in senders
    }


def test_vehicles_start_behind_each_other_on_a_straight_through_the_origin() -> None:
    scenario = scenario_from_text(
        STRAIGHT, overrides=["vehicle.v3.gap_m=35.07", "convoy.gap_m=5.07", "path.heading_deg=0"]
    )
    places = [scenario.route.path.at(scenario.route.start_station(k)) for k in range(4)]
    assert [(round(p.east, 9), round(p.north, 9)) for p in places] == [
        (0.0, 0.0),
        (0.0, -10.0),
        (0.0, -50.0),
        (0.0, -60.0),
    ]


def test_one_vehicle_differs_only_in_the_keys_of_its_table() -> None:
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
    assert own.gains == Gains(lateral=0.1, heading=0.96, yaw_rate=0.2)
    assert own.parameters.mass == 2000.0 + 3 * 120.0
    assert own.assumed_parameters == own.parameters
    assert other.parameters.mass == LINCOLN_MKZ.mass + 2 * 120.0
    assert other.assumed_parameters == DEFAULT_CAR
    assert (own.gnss.position_noise, other.gnss.position_noise) == (0.5, 0.02)
    assert own.gnss.rate == 20.0


def test_the_most_specific_entry_about_a_link_wins_key_by_key() -> None:
    text = (
        STRAIGHT
        + """
[links]
latency_ms = 30.0
[[link]]
sender = "lead"
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
    first, both, other = (
        scenario.links[pair] for pair in (("v1", "v2"), ("v1", "v3"), ("v2", "v3"))
    )
    assert (first.loss_ratio, first.jitter_ms, first.latency_ms) == (0.5, 7.0, 30.0)
    assert (both.loss_ratio, both.jitter_ms) == (0.1, 7.0)
    assert (other.loss_ratio, other.jitter_ms, other.latency_ms) == (0.1, 0.0, 30.0)
    assert scenario.links["v3", "v4"].loss_ratio == 0.0


def test_the_seed_argument_wins_over_file_and_override() -> None:
    assert scenario_from_text(STRAIGHT, overrides=["seed=5"]).seed == 5
    assert scenario_from_text(STRAIGHT, overrides=["seed=5"], seed=7).seed == 7


def test_without_a_duration_the_lead_drives_its_whole_path() -> None:
    text = STRAIGHT.replace("duration_s = 20.0\n", "")
    assert scenario_from_text(text, overrides=["speed.set_mps=25"]).duration_s == 40.0


@examples(8, 50)
@given(
    description=st.text(st.characters(exclude_categories=["Cs"])),
    link=st.fixed_dictionaries(
        {"loss_ratio": st.floats(0, 1)}, optional={"rate_hz": st.floats(0.001, 1000)}
    ),
    offset=st.floats(-20, 20),
    lengths=st.lists(st.floats(500, 1000), min_size=1, max_size=5),
    names=st.lists(st.from_regex(r"\A[A-Za-z][A-Za-z0-9_-]{0,5}\Z"), min_size=3, max_size=3),
)
def test_every_kind_of_value_survives_the_text(
    description: str,
    link: dict[str, Any],
    offset: float,
    lengths: list[float],
    names: list[str],
) -> None:
    names = [f"{name}{place}" for place, name in enumerate(names)]
    tables = {
        "name": "whole",
        "description": description,
        "duration_s": 1.0,
        "convoy": {"names": names, "vehicles": 3},
        "path": {"kind": "segments", "segments": [{"length_m": length} for length in lengths]},
        "link": [{"sender": names[0], "receiver": names[2]} | link],
        "vehicle": {names[1]: {"lateral_offset_m": offset, "gnss": {"rate_hz": 5.0}}},
    }
    scenario = scenario_from_text(tomli_w.dumps(tables))
    assert scenario.tables.description == description
    again = scenario_from_text(scenario.text)
    assert again.tables == scenario.tables
    assert again.text == scenario.text
    assert again.links == scenario.links
    assert again.vehicle(names[1]) == scenario.vehicle(names[1])
    # What a file may say of a link or a vehicle is as it was given, without defaults.
    written = tomllib.loads(scenario.text)
    assert (written["link"], written["vehicle"]) == (tables["link"], tables["vehicle"])


def test_a_scenario_knows_its_overrides_from_its_own_text_and_adds_more() -> None:
    scenario = load_scenario("lane_change", ["convoy.gap_m=3"], seed=7)
    again = scenario_from_text(scenario.text)
    assert (again.title, again.slug, again.text) == (scenario.title, scenario.slug, scenario.text)
    more = scenario_from_text(scenario.text, overrides=["convoy.gap_m=4"])
    assert more.overrides == ("convoy.gap_m=3", "seed=7", "convoy.gap_m=4")
