"""A configured gap equals the true and the estimated gap, from bumper to bumper."""

import pytest

from scenarios.definition.scenario import scenario_from_text
from scenarios.runs.virtual import run_unlogged

STRAIGHT = """
name = "straight"
duration_s = 2.5
[convoy]
vehicles = 3
[path]
kind = "segments"
segments = [{ length_m = 400.0 }]
[links]
latency_ms = 20.0
"""
SPEEDS_MPS = (5.0, 30.0)
LENGTHS = {
    "the usual car": (),
    "a short car": ("parameters.length_m=3.2",),
    "a lorry in the middle": ("vehicle.v2.parameters.length_m=12.0",),
    "axles far forward": ("vehicle.v3.parameters.front_axle_distance_m=1.8",),
}


@pytest.mark.parametrize("lengths", LENGTHS.values(), ids=LENGTHS)
@pytest.mark.parametrize("speed_mps", SPEEDS_MPS)
@pytest.mark.parametrize("followers", ["same", "gap"])
def test_configured_true_and_estimated_gaps_are_equal(
    followers: str, speed_mps: float, lengths: tuple[str, ...]
) -> None:
    headway_s = 0.3
    keys = {
        "same": ("convoy.gap_m=6.5",),
        "gap": (f"speed.gap.headway_s={headway_s}", "speed.gap.standstill_m=2.5"),
    }[followers]
    gap_m = 6.5 if followers == "same" else 2.5 + headway_s * speed_mps
    scenario = scenario_from_text(
        STRAIGHT,
        overrides=[f"speed.followers='{followers}'", f"speed.set_mps={speed_mps}", *keys, *lengths],
    )
    assert scenario.route.gaps[1:] == pytest.approx([gap_m, gap_m])
    for row in run_unlogged(scenario).vehicles[1:]:
        assert row.true_gap_m_min == pytest.approx(gap_m, abs=0.1)
        assert row.estimated_gap_m_min == pytest.approx(gap_m, abs=0.25)
