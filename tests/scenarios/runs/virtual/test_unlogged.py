"""A run without a log has the summary of the run with one, to the last byte."""

from pathlib import Path

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.results.summary import to_json
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_unlogged, run_virtual

SHORT, LONGER = "duration_s=4.0", "duration_s=8.0"
CASES = {
    "clean": ("lane_change", [SHORT]),
    "lossy": ("lossy_lane_change", [SHORT]),
    "ends at a collision": (
        "lane_change",
        [LONGER, "links.loss_ratio=0.95", "limits.collisions_max=0", "convoy.gap_m=1"],
    ),
    "breaks a limit": ("lossy_lane_change", [SHORT, "limits.cross_track_error_m_max=0.001"]),
    "links that are silent": (
        "lane_change",
        [SHORT, "vehicle.v1.transmitter_off=[{from_s=0.0, to_s=8.0}]", "limits.true_gap_m_min=1.0"],
    ),
}


@pytest.mark.spread(3)
@pytest.mark.parametrize("case", CASES)
def test_the_summary_is_that_of_the_logged_run(case: str, tmp_path: Path) -> None:
    name, overrides = CASES[case]
    scenario = load_scenario(name, overrides)
    logged = run_virtual(scenario, tmp_path, Stop())
    assert to_json(run_unlogged(scenario)) == to_json(logged)
