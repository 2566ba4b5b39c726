"""The lead of a convoy that is longer than its lap does not drive into its own last cars."""

import pytest

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.virtual import run_unlogged
from tests.made.convoys.driven import collisions, driven, summary_of
from tests.scenarios.studies.drills.planted_faults import IGNORES_CONVOY
from vehicles.messages import Tracking, TruePose

SEEDS = 5
CASES = [(vehicles, seed) for vehicles in range(3, 9) for seed in range(1, SEEDS + 1)]


def hits_of_lead(scenario: Scenario) -> int:
    events = run_unlogged(scenario).events
    return len([one for one in events if one.kind == "collision" and "v1" in one.vehicles])


def test_the_lead_stops_behind_its_last_car() -> None:
    longer = "change=[{kind='cut', at_s=4.5, for_s=16, receiver='v3'}]"
    run = driven("lapped_convoy", longer, "duration_s=24")
    assert collisions(run.summary) == 0
    assert any("v3" in one.reason for one in run.of("v1", Tracking))
    speeds = run.speeds("v1")
    assert min(speeds[len(speeds) // 2 :]) < 0.5


def test_the_lead_stands_behind_a_silent_car_and_the_summary_lists_it() -> None:
    silent = "change=[{kind='cut', at_s=0, sender='v2'}]"
    more = ("convoy.vehicles=2", "duration_s=16", silent)
    (stop,) = summary_of("lapped_convoy", *more).events
    assert (stop.kind, stop.vehicles) == ("stop", ("v1",))


def test_a_lead_that_ignores_its_followers_collides(monkeypatch: pytest.MonkeyPatch) -> None:
    assert hits_of_lead(load_scenario("lapped_convoy", ["speed.lead_keeps_gap=false"])) > 0
    monkeypatch.setattr(IGNORES_CONVOY.place, IGNORES_CONVOY.by)
    assert hits_of_lead(load_scenario("lapped_convoy")) > 0


@pytest.mark.campaign(0, len(CASES))
def test_the_lead_touches_nobody(case: int) -> None:
    vehicles, seed = CASES[case]
    overrides = (f"convoy.vehicles={vehicles}", 'links.preset="bursty"')
    assert hits_of_lead(load_scenario("church_lot", overrides, seed)) == 0


def test_on_an_open_path_nobody_drives_differently() -> None:
    usual, asked = (
        driven("lane_change", "duration_s=6", "convoy.vehicles=3", *more)
        for more in ((), ("speed.lead_keeps_gap=true",))
    )
    for name in usual.scenario.vehicle_names:
        assert asked.of(name, TruePose) == usual.of(name, TruePose)
