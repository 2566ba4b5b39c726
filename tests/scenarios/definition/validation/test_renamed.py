"""Old names of keys and values: refused with the new one in a file, translated in a log."""

from math import inf
from typing import Any

import pytest
import tomli_w

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario, scenario_from_text

DEGRADATION = "control.degradation"
OUTAGE = "{kind='stretch', from_m=1, to_m=2, who='both'}"
OLD = {
    "convoy.when_a_vehicle_dies=go_on": 'convoy.on_vehicle_failure = "continue"',
    "convoy.on_vehicle_failure=go_on": '"continue"',
    "limits.after_collision=go_on": '"continue"',
    f"{DEGRADATION}.predecessor_path=meant": '"intended"',
    f"{DEGRADATION}.hardest_mps2=5.0": f"{DEGRADATION}.emergency_mps2",
    f"{DEGRADATION}.hardest_jerk_mps3=5.0": f"{DEGRADATION}.emergency_jerk_mps3",
    f"{DEGRADATION}.trusted_share_ratio=0.5": f"{DEGRADATION}.probation_delivery_ratio",
    f"vehicle.v2.{DEGRADATION}.forgiven_after_s=5.0": f"{DEGRADATION}.probation_halving_s",
    "limits.v2.believed_minus_true_error_m_max=1.0": "limits.v2.self_estimate_error_m_max",
    f"links.outages=[{OUTAGE}]": "links.outages[0].vehicle",
    f"link=[{{sender='v1', receiver='v2', outages=[{OUTAGE}]}}]": "link[0].outages[0].vehicle",
}
RECORDED: dict[str, Any] = {
    "name": "old",
    "duration_s": 1.0,
    "convoy": {"when_a_vehicle_dies": "go_on"},
    "control": {"degradation": {"hardest_mps2": 5.0, "predecessor_path": "meant"}},
    "vehicle": {"v2": {"control": {"degradation": {"forgiven_after_s": 5.0}}}},
    "limits": {"after_collision": "go_on", "v2": {"believed_minus_true_error_m_max": 1.0}},
    "links": {"outages": [{"kind": "stretch", "from_m": 1.0, "to_m": 2.0, "who": "both"}]},
    "path": {
        "kind": "points",
        "east_m": [10.0 * step for step in range(20)],
        "north_m": [0.0] * 20,
        "place_word": "line",
        "place_numbers": list(range(20)),
        "began_at_s": 7.0,
    },
}


@pytest.mark.parametrize(("override", "new"), OLD.items())
def test_an_old_name_is_refused_with_the_new_one(override: str, new: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("lane_change", [override])
    (line,) = caught.value.lines
    assert line.startswith("--set: ")
    assert new in line


def test_a_recorded_scenario_is_translated() -> None:
    text = tomli_w.dumps(RECORDED)
    with pytest.raises(ScenarioError):
        scenario_from_text(text)
    scenario = scenario_from_text(text, recorded=True)
    tables, own = scenario.tables, scenario.tables.vehicle["v2"].control
    assert scenario.continues_without_failed
    assert tables.limits.after_collision == "continue"
    assert tables.limits.of_vehicles["v2"].self_estimate_error_m_max == 1.0
    settings = tables.control.degradation.value
    assert (settings.emergency.deceleration, settings.predecessor_path) == (5.0, "intended")
    assert own is not None
    assert own.degradation.value.probation_halving == 5.0
    assert tables.links.outages is not None
    assert tables.links.outages[0].vehicle == "both"  # type: ignore[union-attr]
    assert tables.path.kind == "points"
    assert (tables.path.source_unit, tables.path.source_numbers) == ("line", tuple(range(20)))
    assert tables.path.epoch_s == 7.0
    assert scenario_from_text(scenario.text).text == scenario.text


def test_a_recorded_scenario_without_later_keys_drives_as_then() -> None:
    own = {"v2": {"sending": {"kind": "fixed", "rate_hz": 5.0}}}
    text = tomli_w.dumps(RECORDED | {"vehicle": own})
    scenario = scenario_from_text(text, recorded=True)
    assert {scenario.vehicle(name).sending.path_history for name in ("v1", "v2")} == {0.0}
    assert scenario.tables.speed.friction_ratio_max == inf
    assert scenario.vehicle("v1").degradation.lateral_deviation_max == 1000.0
    again = scenario_from_text(scenario.text, recorded=True)
    assert again.text == scenario.text


def test_a_recorded_scenario_keeps_its_own_keys() -> None:
    recorded = scenario_from_text(load_scenario("lane_change").text, recorded=True)
    assert recorded.vehicle("v1").sending.path_history == 300.0
    assert recorded.tables.speed.friction_ratio_max == 0.8
