"""Warnings of settings that hardly anybody means."""

from math import pi

import pytest

from scenarios.definition.check import unusual
from scenarios.definition.check.findings import report_of
from scenarios.definition.check.unusual import unusual_settings
from scenarios.definition.scenario import load_scenario

LOOP = (
    "path={kind='segments', laps=3, segments=[{length_m=157.08, radius_m=25.0, turn='left'}]}",
    "speed.set_mps=5",
    "duration_s=60",
    "convoy.gap_m=20",
)
LOOP_M = 1.5 * pi * 8.0
EIGHT = (
    f"path={{kind='segments', segments=[{{length_m=8}}, {{length_m={LOOP_M}, radius_m=8, "
    f"turn='left'}}, {{length_m=16}}, {{length_m={LOOP_M}, radius_m=8, turn='right'}}]}}",
    "convoy.vehicles=3",
    "convoy.gap_m=22",
    "duration_s=14",
    "speed.set_mps=5",
    "speed.lateral_acceleration_mps2_max=4",
    "control.gains={lateral_rad_per_m=0.25, heading_rad_per_rad=1.4, yaw_rate_s=0.04}",
)
"""It crosses its first straight after 8 m of it, 54 m later."""
UNUSUAL = {
    "one vehicle": ("lane_change", ("convoy.vehicles=1",), "convoy.vehicles = 1", False),
    "church_lot": ("church_lot", ("convoy.vehicles=20",), "lap 82 m", False),
    "a circle": ("lane_change", (*LOOP, "convoy.vehicles=10"), "lap 157 m", False),
    "a crossing": ("lane_change", EIGHT, "or another vehicle can run into", False),
    "microseconds": ("lane_change", ("links.latency_ms=0.02",), "did you mean 20?", True),
    "no latency": ("lane_change", ("links.latency_ms=0",), "latency_ms = 0", True),
    "one link": (
        "lane_change", ("link=[{sender='v1', receiver='v3', latency_ms=0.5}]",), "v1 → v3", True,
    ),
    "too many for real time": ("lane_change", ("convoy.vehicles=200",), "200 vehicles", True),
}  # fmt: skip


@pytest.mark.parametrize(("name", "overrides", "fact", "only_wall"), UNUSUAL.values(), ids=UNUSUAL)
def test_an_unusual_setting_has_a_warning(
    name: str,
    overrides: tuple[str, ...],
    fact: str,
    only_wall: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(unusual, "_cores", lambda: 4)
    scenario = load_scenario(name, overrides)
    (line,) = unusual_settings(scenario, wall_clock=True)
    assert fact in line
    assert (line in unusual_settings(scenario, wall_clock=False)) == (not only_wall)
    assert line in report_of(scenario).warnings


def test_a_virtual_run_warns_of_seconds_in_place_of_milliseconds() -> None:
    scenario = load_scenario("lane_change", ["links.latency_ms=0.02"])
    (line,) = unusual_settings(scenario, wall_clock=False)
    assert "did you mean 20?" in line
    without = load_scenario("lane_change", ["links.latency_ms=0"])
    assert not list(unusual_settings(without, wall_clock=False))
