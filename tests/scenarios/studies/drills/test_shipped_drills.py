"""Shipped drills pass, and each of their limits is broken by a planted fault."""

import tomllib
from dataclasses import replace

import pytest

from scenarios.definition.check.findings import check
from scenarios.definition.library import DRILLS
from scenarios.definition.scenario import drills, library, load_scenario, scenario_from_text
from scenarios.studies.drill import drill_variants, rows_of_drill, run_drill
from scenarios.studies.many.variant import variant_of
from tests.scenarios.studies.drills.planted_faults import PLANTS

EXPECTED = {
    "lead_lost",
    "predecessor_lost",
    "both_lost",
    "burst_worst",
    "tunnel",
    "frozen_transmitter",
    "ghost_vehicle",
    "overconfident_gnss",
    "rtk_lost",
    "drifting_receiver",
    "clock_off",
    "restarted_follower",
    "late_joiner",
    "congested_channel",
    "persistent_collisions",
    "router_restarted",
    "emergency_braking",
    "hard_braking",
    "host_cut",
    "guessed_road",
    "flapping_links",
    "lapped_convoy",
}
SEEDS = 5
CASES = [(name, seed) for seed in range(1, SEEDS + 1) for name in drills()]


def test_the_expected_drills_exist_and_are_not_scenarios() -> None:
    assert set(drills()) == EXPECTED
    assert not set(drills()) & set(library())


@pytest.mark.parametrize("name", drills())
def test_a_drill_is_a_short_commented_valid_file(name: str) -> None:
    text = (DRILLS / f"{name}.toml").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 50
    assert text.startswith("# ")
    assert tomllib.loads(text)["extends"] in library()
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.fingerprint == ""  # shipped, so its name identifies it
    assert scenario.duration_s <= 20.0
    assert len(scenario.vehicle_names) <= 4
    assert check(name).description
    assert scenario_from_text(scenario.text).tables == scenario.tables


@pytest.mark.parametrize("name", drills())
def test_each_limit_has_a_planted_fault(name: str) -> None:
    limits = load_scenario(name).tables.limits
    given = {
        *(key for key in limits.model_fields_set if key.endswith(("_max", "_min"))),
        *(
            f"{kind}[{place}]"
            for kind in ("modes", "sources", "recovery")
            for place in range(len(getattr(limits, kind)))
        ),
    }
    assert given
    assert given == {limit for one in PLANTS if one.drill == name for limit in one.breaks}


@pytest.mark.campaign(1, len(CASES))
def test_a_drill_passes(case: int) -> None:
    name, seed = CASES[case]
    (variant,) = drill_variants(name, seeds=(seed,))
    rows = list(rows_of_drill([run_drill(variant)]))
    assert rows
    assert [row.message for row in rows if not row.passed] == []


@pytest.mark.campaign(3, len(PLANTS))
def test_planted_faults_break_their_limits(case: int, monkeypatch: pytest.MonkeyPatch) -> None:
    plant = PLANTS[case]
    if plant.fault is not None:
        monkeypatch.setattr(plant.fault.place, plant.fault.by)
    (variant,) = drill_variants(plant.drill, plant.overrides)
    rows = list(rows_of_drill([run_drill(variant)]))
    broken = {row.limit for row in rows if not row.passed}
    assert set(plant.breaks) <= broken, plant


def test_the_burst_is_worse_than_one_second_later() -> None:
    variant = variant_of("burst_worst")
    (cut,) = variant.scenario.tables.change

    def error(at_s: float) -> float:
        summary = replace(variant, overrides=(f"change.0.at_s={at_s}",)).run()
        return max(row.cross_track_error_m_max or 0.0 for row in summary.vehicles)

    assert error(cut.at_s) > 5.0 * error(cut.at_s + 1.0)
