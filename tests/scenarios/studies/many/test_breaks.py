"""A run that ends at the breach of a limit agrees with the summary of the whole run."""

import pytest

from scenarios.definition.run_limits import parsed_limit
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.limits import broken_by
from scenarios.runs.virtual import run_unlogged
from scenarios.studies.many.variant import Variant

SHORT = ["duration_s=2.5", "convoy.vehicles=3"]
RUNS = {
    "broken": [*SHORT, "links.loss_ratio=0.93", "control.degradation.reaction='extrapolate'",
               "path.segments=[{length_m=20.0}, {length_m=200.0, radius_m=500.0, turn='left'}]"],
    "held": [*SHORT, "links.loss_ratio=0.2"],
    "a collision ends it": [*SHORT, "links.loss_ratio=0.93", "convoy.gap_m=0.09",
                            "limits.collisions_max=0"],
    "a driver that fails": [*SHORT, "links.loss_ratio=1.0"],
}  # fmt: skip
LIMITS = (
    "lane", "error_m=0.3", "gap_m=2.5", "collision", "near_miss", "path_lost",
    "v2.lane", "v3.lane", "v2.error_m=0.3", "v3.error_m=0.3", "v2.gap_m=2.5", "v3.gap_m=2.5",
    "v1.collision", "v3.collision", "v3.path_lost", "stop", "v2.stop", "distrust",
    "road_error_m=0.3", "v1.road_error_m=0.001", "self_estimate_error_m=0.1",
    "v3.self_estimate_error_m=0.1", "blind_m=0.5", "v2.blind_m=0.5", "friction_ratio=0.1",
    "v1.friction_ratio=0.1",
)  # fmt: skip


def variant_of(scenario: Scenario) -> Variant:
    return Variant(text=scenario.text, name=scenario.name, seed=scenario.seed)


@pytest.mark.spread(3)
@pytest.mark.parametrize("run", RUNS)
def test_broken_limits_equal_those_of_the_summary(run: str) -> None:
    scenario = load_scenario("lossy_lane_change", RUNS[run])
    summary = run_unlogged(scenario)
    for text in LIMITS:
        limit = parsed_limit(text, scenario.vehicle_names)
        assert variant_of(scenario).breaks(limit) == broken_by(limit, summary), text


def test_a_gain_is_judged_at_the_end() -> None:
    overrides = [
        *RUNS["held"],
        "vehicle.v3.lateral_offset_m=0.4",
        "vehicle.v2.lateral_offset_m=0.2",
    ]
    scenario = load_scenario("lossy_lane_change", overrides)
    summary = run_unlogged(scenario)
    gain = summary.vehicles[2].string.lateral_gain_l2
    assert gain is not None
    for bound in (0.9 * gain, 1.1 * gain):
        limit = parsed_limit(f"v3.lateral_gain_l2={bound}", scenario.vehicle_names)
        assert variant_of(scenario).breaks(limit) == broken_by(limit, summary) == (gain > bound)
