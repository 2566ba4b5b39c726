"""Over links that lose in bursts, what a car makes of the road stays near the road.

A burst leaves a hole in what a car knows of its source's way. While the car drives through that
hole, the few samples behind it must not be extrapolated to where the car is.

`pytest --campaign` drives forty runs.
"""

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.runs.virtual import run_unlogged

WORST = {1: 14.0, 13: 35.0}
"""Seeds with which a car once thought itself 3.1 and 2.1 m off its path, and how long to drive."""


@pytest.mark.campaign(1, 40)
def test_a_gap_in_received_poses_causes_no_swerve(case: int) -> None:
    seed = (*WORST, *range(50, 90))[case]
    duration_s, vehicles = WORST.get(seed, 35.0), 6 if seed == 1 else 5
    requested = ["links.preset=bursty", f"convoy.vehicles={vehicles}", f"duration_s={duration_s}"]
    summary = run_unlogged(load_scenario("lossy_lane_change", requested, seed))
    for row in summary.vehicles[1:]:
        assert row.self_estimate_error_m_max is not None
        assert row.self_estimate_error_m_max < 0.5, row.name
        assert row.sliding_s == 0.0, row.name
    assert any(row.reaction.recoveries for row in summary.vehicles)
