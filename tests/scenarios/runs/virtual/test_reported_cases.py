"""Reported runs in which cars left the road or collided; each input is a copy."""

import pytest

from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text
from scenarios.results.summary import RunSummary
from scenarios.runs.virtual import run_unlogged

BRAKE = """
extends = "lane_change"
name = "brake"
duration_s = 10.0
[convoy]
gap_m = 8.0
[path]
kind = "segments"
segments = [{ length_m = 900.0 }]
[speed]
lead = "profile"
followers = "gap"
braking_mps2_max = 6.0
profile = [
    { at_s = 0.0, speed_mps = 30.0 },
    { at_s = 3.0, speed_mps = 30.0 },
    { at_s = 8.0, speed_mps = 0.0 },
]
[speed.gap]
standstill_m = 8.0
headway_s = 0.0
"""
CUT_AT_S = (20.0, 26.0, 32.0)
OFF_M = 0.5
"""Largest distance from the path of the lead after a cut."""


def church_lot(at_s: float, for_s: float = 7.0) -> Scenario:
    cut = f"change=[{{kind='cut', at_s={at_s}, for_s={for_s}}}]"
    duration = f"duration_s={at_s + for_s + 12.0}"
    return load_scenario("church_lot", [cut, duration, "convoy.vehicles=3"])


def collisions(summary: RunSummary) -> int:
    return sum(event.kind == "collision" for event in summary.events)


def largest_error(summary: RunSummary) -> float:
    return max(vehicle.cross_track_error_m_max or 0.0 for vehicle in summary.vehicles)


@pytest.mark.campaign(0, len(CUT_AT_S))
def test_a_follower_does_not_leave_the_path_at_a_hole_in_it(case: int) -> None:
    """It follows the path history of another car, or stands before the hole.

    `test_end_of_the_known_path` has a shorter such run.
    """
    scenario = church_lot(CUT_AT_S[case])
    summary = run_unlogged(scenario)
    assert largest_error(summary) <= OFF_M
    assert collisions(summary) == 0


@pytest.mark.parametrize("latency_ms", [20, 100])
def test_nobody_is_hit_if_the_lead_brakes_at_6_mps2(latency_ms: int) -> None:
    scenario = scenario_from_text(f"{BRAKE}[links]\nlatency_ms = {latency_ms}.0\n", label="brake")
    assert collisions(run_unlogged(scenario)) == 0


@pytest.mark.spread(1)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_convoy_longer_than_its_lap_does_not_drive_into_itself(seed: int) -> None:
    """Without links to the members ahead, the lead hits the last car after 17 s."""
    profile = "[{at_s=0.0, speed_mps=2.0}, {at_s=4.0, speed_mps=12.0}]"
    overrides = (
        "convoy.vehicles=6",
        "links.preset=bursty",
        "duration_s=19.0",
        f"speed.profile={profile}",
    )
    assert collisions(run_unlogged(load_scenario("church_lot", overrides, seed))) == 0
