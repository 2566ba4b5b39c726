"""Hints for keys and values whose intention is clear, and all mistakes reported at once."""

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario, scenario_from_text

HINTS = {
    "links.loss_ratio=40": "0.4",
    "links.loss_ratio=40%": "0.4",
    "links.loss_ratio=0,4": "0.4",
    "links.loss_ratio==0.4": "0.4",
    "links.loss=0.4": "links.loss_ratio",
    "links.loss_percent=40": "links.loss_ratio = 0.4",
    "links.latency_ms=20ms": "20",
    "links.latency_s=0.02": "links.latency_ms = 20",
    "links.loss-ratio=0.4": "links.loss_ratio",
    "link.loss_ratio=0.3": "links.loss_ratio",
    "Links.loss_ratio=0.4": "links.loss_ratio",
    "links.loss={kind='gilbert'}": '"gilbert_elliott"',
    "links.preset=burst": "bursty",
    "loss=0.4": "links.loss_ratio",
    "latency_ms=20": "links.latency_ms",
    "control.controller=stanly": "stanley",
    "control.controler=stanley": "control.controller",
    "controller=stanley": "control.controller",
    "conovy.gap_m=12": "convoy.gap_m",
    "conovy.gap=12": "convoy.gap_m",
    "gap=12": "convoy.gap_m",
    "vehicles=6": "convoy.vehicles",
    "vehicles.v2.gap_m=12": "vehicle.v2.gap_m",
    "vehicle.2.gap_m=12": "vehicle.v2",
    "convoy.vehicles=4.0": "4",
    "speed=20": "speed.set_mps",
    "speed_kmh=72": "speed.set_mps = 20",
    "speed.speed_kmh=72": "speed.set_mps = 20",
    "speed.set_mps=120": "33.3",
    "speed.set_mps=72km/h": "20",
    "speed.lead_mps=25": "speed.set_mps",
    "speed.lead_kmh=72": "speed.set_mps = 20",
    "duration_ms=30000": "duration_s = 30",
    "limits.error_m=0.5": "limits.cross_track_error_m_max",
    "limits.cross_track_error_cm_max=50": "limits.cross_track_error_m_max = 0.5",
    "speed.followers=gaps": '"gap"',
    "convoy.vehicles=6,gap_m=6": "--set convoy.vehicles=6 --set convoy.gap_m=6",
    "convoy.gap_m=6, seed=3": "--set convoy.gap_m=6 --set seed=3",
    "seed=3,links.loss_ratio=0.4": "--set seed=3 --set links.loss_ratio=0.4",
    "links.loss_ratio 0.4": "links.loss_ratio=0.4",
    "links.loss_ratio:0.4": "links.loss_ratio=0.4",
    "--links/loss_ratio=0.4": "links.loss_ratio=0.4",
}


def error_lines(*overrides: str) -> tuple[str, ...]:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("lane_change", overrides)
    return caught.value.lines


@pytest.mark.parametrize(("override", "hint"), HINTS.items())
def test_a_clear_intention_gets_a_hint(override: str, hint: str) -> None:
    (line,) = error_lines(override)
    assert f", did you mean {hint}" in line
    assert len(line) < 250


@pytest.mark.parametrize(
    ("table", "name"),
    [
        ("[link]\nsender = 'v1'\nreceiver = 'v2'\nloss_ratio = 0.3", "link"),
        ("[change]\nkind = 'cut'\nat_s = 7", "change"),
        ("[limits.modes]\nvehicle = 'v2'\nmode = 'stop'\nwithin_s = 1", "limits.modes"),
    ],
)
def test_a_table_in_place_of_a_list_of_tables_gets_double_brackets(table: str, name: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(f"extends = 'lane_change'\n{table}\n")
    assert f" {name}: " in str(caught.value)
    assert f"[[{name}]]" in str(caught.value)


def test_all_mistakes_are_reported_at_once() -> None:
    lines = error_lines(
        "path={kind='trace', file='nothing.csv'}",
        "vehicle.v2.replay=missing.gpx",
        "links.loss={kind='pattern', file='absent.csv'}",
        "links.loss_ratio=40",
        "convoy.gap=8",
        "link=[{sender='v1', receiver='v2', preset='burst'}]",
        "control.controller=stanly",
        "seed:3",
    )
    for fact in (
        "nothing.csv", "missing.gpx", "absent.csv", "0.4", "convoy.gap_m", "bursty", "stanley",
        "seed=3",
    ):  # fmt: skip
        assert sum(fact in line for line in lines) == 1, (fact, lines)
    assert len(lines) == 8
