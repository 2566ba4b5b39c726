"""Errors against the road beside those against the path that the lead drove."""

from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text
from scenarios.results.vehicle_figures import VehicleSummary
from scenarios.runs.virtual import run_unlogged
from tests.made.scenarios.rough_drives import truth

BEND = ((60.0, 1 / 60.0), (80.0, 0.0), (60.0, -1 / 60.0), (100.0, 0.0))
FROM_S = 6.0
"""The lead starts in the middle of the first bend."""


def summaries(scenario: Scenario) -> tuple[VehicleSummary, ...]:
    return run_unlogged(scenario).vehicles


def test_a_wobbling_lead_differs_from_a_convoy_that_follows_badly() -> None:
    wobbling = "vehicle.v1.gnss.position_noise_m=0.4"
    badly = "control.controller=pure_pursuit"
    short = ("duration_s=12", "convoy.vehicles=3")
    lead, second, _ = summaries(load_scenario("lane_change", [*short, wobbling]))
    assert (lead.road_error_m_max or 0.0) > 0.07
    assert (second.road_error_m_max or 0.0) > 0.08
    own = "vehicle.v1.control.controller=slip_compensated"
    lead, second, third = summaries(load_scenario("lane_change", [*short, badly, own]))
    assert (lead.road_error_m_max or 1.0) < 0.03
    assert min(second.road_error_m_max or 0.0, third.road_error_m_max or 0.0) > 0.06
    assert second.road_error_m_max == pytest.approx(second.cross_track_error_m_max, abs=0.03)
    assert second.road_error_max_at_s is not None


def two_drives(folder: Path) -> Scenario:
    """A lead that is cut to a part of its drive, and a car that drove the whole 2 s later."""
    for name, later in (("lead", 0.0), ("second", 2.0)):
        rows = ["t_s,x_m,y_m"]
        stations = 2.0 * np.arange(150.0)
        east, north = truth(BEND, stations)
        rows += [
            f"{later + 0.2 * k:.2f},{x:.4f},{y:.4f}"
            for k, (x, y) in enumerate(zip(east.tolist(), north.tolist(), strict=True))
        ]
        (folder / f"{name}.csv").write_text("\n".join(rows))
    return scenario_from_text(
        f"""name = "two"
[path]
kind = "trace"
file = "lead.csv"
from_s = {FROM_S}
[convoy]
vehicles = 2
[speed]
lead = "recorded"
[vehicle.v2]
replay = "second.csv"
""",
        label="two.toml",
        folder=folder,
    )


def test_a_replayed_car_on_the_road_of_a_lead_that_was_cut_leaves_no_lane(tmp_path: Path) -> None:
    summary = run_unlogged(two_drives(tmp_path))
    _, replayed = summary.vehicles
    assert replayed.road_error_m_max == pytest.approx(0.0, abs=2e-3)
    assert (replayed.cross_track_error_m_max or 9.0) < 0.2
    assert not [event for event in summary.events if event.kind == "lane_departure"]


def test_a_broken_limit_of_the_road_names_the_vehicle_and_the_instant() -> None:
    limits = ["vehicle.v1.lateral_offset_m=0.5", "duration_s=1", "limits.road_error_m_max=0.2"]
    summary = run_unlogged(load_scenario("lane_change", limits))
    assert summary.outcome == "failed"
    broken = {limit.vehicle: limit.value for limit in summary.limits if limit.broken}
    assert broken["v1"] == pytest.approx(0.5, abs=0.01)
