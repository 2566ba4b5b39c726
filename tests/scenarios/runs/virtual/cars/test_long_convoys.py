"""The error against the road along six cars does not grow: sixteen with `--campaign`."""

from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.scenario import scenario_from_text
from scenarios.results.vehicle_figures import VehicleSummary
from scenarios.runs.virtual import run_unlogged
from tests.made.scenarios.convoy_roads import ROADS, convoy_on_road

GROWTH_M = 0.02
JUMPS = """
name = "jumps"
[convoy]
vehicles = 5
[path]
kind = "trace"
file = "jumps.csv"
smoothing_m = 3.0
[speed]
lead = "recorded"
followers = "gap"
"""


def road_errors(name: str, seed: int, vehicles: int, *overrides: str) -> list[float]:
    """Largest error (m) of each vehicle against the road."""
    summary = run_unlogged(convoy_on_road(name, seed, vehicles, *overrides))
    return [row.road_error_m_max or 0.0 for row in summary.vehicles]


@pytest.mark.campaign(1, 5)
@pytest.mark.spread(1)
@pytest.mark.parametrize("name", ROADS)
def test_the_last_car_is_hardly_further_off_than_the_second(name: str, campaign: int) -> None:
    vehicles = 16 if campaign > 1 else 6
    errors = [road_errors(name, seed, vehicles) for seed in range(1, campaign + 1)]
    second, last = (max(of_seed[place] for of_seed in errors) for place in (1, -1))
    assert last <= second + GROWTH_M, errors


def test_it_grows_where_the_offset_of_the_predecessor_is_not_used() -> None:
    errors = road_errors(ROADS[0], 1, 6, "control.degradation.predecessor_path=driven")
    assert errors[-1] > errors[1] + GROWTH_M, errors


def behind_jumps(folder: Path, *overrides: str) -> tuple[VehicleSummary, ...]:
    """Four cars behind a lead whose recording jumps aside by 1.2 m twice, for 4 s, at 12 m/s."""
    times = 0.1 * np.arange(300)
    yaw = 0.3 * np.sin(12.0 * times / 90.0)
    aside = np.zeros(times.size)
    for at in (12.0, 20.0):
        aside += 1.2 * np.clip((times - at) / 0.3, 0.0, 1.0)
        aside -= 1.2 * np.clip((times - at - 4.0) / 0.3, 0.0, 1.0)
    east = 1.2 * np.cumsum(np.cos(yaw)) - aside * np.sin(yaw)
    north = 1.2 * np.cumsum(np.sin(yaw)) + aside * np.cos(yaw)
    rows = np.column_stack([times, east, north]).tolist()
    points = "\n".join(f"{t:.1f},{x:.3f},{y:.3f}" for t, x, y in rows)
    (folder / "jumps.csv").write_text(f"t_s,x_m,y_m\n{points}\n")
    return run_unlogged(scenario_from_text(JUMPS, folder=folder, overrides=overrides)).vehicles


def test_errors_behind_a_lead_that_swerves_do_not_grow(tmp_path: Path) -> None:
    lead, second, *others = behind_jumps(tmp_path)
    assert (lead.friction_ratio_max or 0.0) > 0.95  # its recording has bends of 5 m radius
    errors = [car.cross_track_error_m_max or 9.0 for car in others]
    assert max(errors) < (second.cross_track_error_m_max or 0.0) + 0.05
    assert max(car.friction_ratio_max or 9.0 for car in others) < 0.95


def test_errors_behind_a_lead_that_swerves_grow_without_these_limits(tmp_path: Path) -> None:
    without = (
        "speed.friction_ratio_max=inf",
        "control.degradation.predecessor_path=driven",
        "control.estimate_slip=false",
    )
    _, second, *others = behind_jumps(tmp_path, *without)
    errors = [car.cross_track_error_m_max or 0.0 for car in others]
    assert max(errors) > (second.cross_track_error_m_max or 9.0) + 0.05
