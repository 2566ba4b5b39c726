"""Shipped drills pass, and each of their limits is broken by a planted fault."""

import tomllib

import pytest

from scenarios.definition.check.findings import check
from scenarios.definition.library import DRILLS
from scenarios.definition.scenario import drills, library, load_scenario, scenario_from_text
from scenarios.studies.drills.drill import drill_variants, rows_of_drill, run_drill
from scenarios.studies.drills.worst import BurstLoss, SearchSpan, WorstSearch, base_variant
from scenarios.studies.engine.engine import Engine
from tests.made.many.engines import engine_here
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


WORST_AT_S, BURST = 8.219, BurstLoss(for_s=1.0)
SETTINGS = ("convoy.vehicles=3", "duration_s=12")


def search(engine: Engine, seeds: int = SEEDS) -> WorstSearch:
    """The search whose command is in the header of the file."""
    base = base_variant("lane_change", SETTINGS, None)
    return WorstSearch(base, BURST, "error_m", engine, seeds=seeds)


def test_the_burst_is_at_the_time_of_the_search() -> None:
    (cut,) = load_scenario("burst_worst").tables.change
    assert cut.model_dump() == {
        "kind": "cut",
        "at_s": WORST_AT_S,
        "for_s": BURST.for_s,
        "sender": "*",
        "receiver": "*",
    }
    with engine_here() as engine:
        variant = search(engine).variant(WORST_AT_S)
    found, shipped = variant.scenario, load_scenario("burst_worst")
    for key in ("change", "path", "convoy", "links", "gnss", "control", "speed", "seed"):
        assert getattr(found.tables, key) == getattr(shipped.tables, key), key


@pytest.mark.campaign(1, 2)
def test_the_burst_is_at_the_worst_time(case: int) -> None:
    """Worse than one second later; a campaign repeats the search."""
    if case:
        span = SearchSpan(from_s=3.0, to_s=10.0, step_s=0.5, finest_s=0.05)
        with engine_here() as engine:
            assert search(engine).run(span).at_s == WORST_AT_S
        return
    span = SearchSpan(from_s=WORST_AT_S, to_s=WORST_AT_S + 1.0, step_s=1.0, finest_s=1.0)
    with engine_here() as engine:
        found = search(engine, seeds=1).run(span)
    assert found.at_s == WORST_AT_S
    assert found.figure > 5.0 * found.figures[round(WORST_AT_S + 1.0, 3)]
