"""Warning of a lead that meets the last vehicle of its own convoy on a closed path."""

import re
from math import pi

import pytest

from scenarios.definition.check.findings import warnings
from scenarios.definition.check.unusual import lap_warnings
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.virtual import run_unlogged
from vehicles.car.parameters import least_spacing

RADIUS_M, FASTEST_MPS, STANDSTILL_M = 30.0, 7.0, 2.0
LAP_M = 2.0 * pi * RADIUS_M


def loop(*, vehicles: int, headway_s: float, duration_s: float = 60.0, more: str = "") -> Scenario:
    """A convoy that keeps a time gap on a circle."""
    circle = f"{{length_m={LAP_M}, radius_m={RADIUS_M}, turn='left'}}"
    overrides = (
        f"path={{kind='segments', laps=4, segments=[{circle}]}}",
        f"convoy.vehicles={vehicles}",
        f"duration_s={duration_s}",
        f"speed.set_mps={FASTEST_MPS}",
        "speed.followers=gap",
        f"speed.gap.standstill_m={STANDSTILL_M}",
        f"speed.gap.headway_s={headway_s}",
        *([more] if more else []),
    )
    return load_scenario("lane_change", overrides)


def speed_on_full_lap(scenario: Scenario, headway_s: float) -> float:
    """Speed (m/s) at which all cars and gaps fill the lap: n (l + s + h v) = lap."""
    car = scenario.vehicle("v1").parameters
    each = LAP_M / len(scenario.vehicle_names)
    return (each - least_spacing(car, car) - STANDSTILL_M) / headway_s


@pytest.mark.parametrize(("vehicles", "headway_s"), [(6, 4.0), (8, 2.5), (10, 2.0)])
def test_the_predicted_speed_fills_the_lap(vehicles: int, headway_s: float) -> None:
    scenario = loop(vehicles=vehicles, headway_s=headway_s)
    expected = speed_on_full_lap(scenario, headway_s)
    assert 0.0 < expected < FASTEST_MPS
    (line,) = lap_warnings(scenario)
    numbers = [float(text) for text in re.findall(r"(\d+(?:\.\d+)?) m/s", line)]
    assert numbers == pytest.approx([FASTEST_MPS, expected], abs=0.06)
    assert f"v{vehicles}" in line
    assert line in warnings(scenario)


def test_the_lead_of_a_full_lap_drives_the_predicted_speed() -> None:
    """A convoy that fills the lap from the start drives on without a contact."""
    vehicles, headway_s, duration_s = 4, 7.0, 25.0
    scenario = loop(vehicles=vehicles, headway_s=headway_s)
    expected = speed_on_full_lap(scenario, headway_s)
    full = f"convoy.gap_m={STANDSTILL_M + headway_s * expected}"
    summary = run_unlogged(
        loop(vehicles=vehicles, headway_s=headway_s, duration_s=duration_s, more=full)
    )
    assert summary.vehicles[0].distance_m / duration_s == pytest.approx(expected, rel=0.025)
    assert not [event for event in summary.events if event.kind == "collision"]
