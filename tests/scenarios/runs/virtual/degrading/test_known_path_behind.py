"""Where a gap takes less time to drive than a message takes to come, a follower falls back."""

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.runs.virtual.unlogged_run import run_unlogged

SETTINGS = (
    *("convoy.vehicles=3", "gnss.rate_hz=10", "duration_s=11", "links.jitter_ms=0"),
    *("convoy.gap_m=3", "links.latency_ms=300"),
)
"""At 30 m/s the received path of a lead 8 m ahead ends a metre behind the first follower."""


@pytest.mark.parametrize(("loss_ratio", "seed"), [(0.0, 1), (0.2, 1), (0.2, 8), (0.2, 9)])
def test_a_follower_that_knows_only_road_behind_falls_back_and_then_follows(
    loss_ratio: float, seed: int
) -> None:
    scenario = load_scenario(
        "lossy_lane_change", (*SETTINGS, f"links.loss_ratio={loss_ratio}"), seed
    )
    summary = run_unlogged(scenario)
    first = summary.vehicles[1]
    assert first.ticks_by_mode["coast"] > 20
    assert first.ticks_by_mode["lead"] > 0.5 * first.ticks
    for row in summary.vehicles[1:]:
        assert row.cross_track_error_m_max is not None
        assert row.cross_track_error_m_max < 0.5, row.name  # it was up to 3.8 m
    assert not [event for event in summary.events if event.kind in ("lane_departure", "slide")]


def test_a_follower_that_knows_road_ahead_does_not_fall_back() -> None:
    requested = (*SETTINGS, "convoy.gap_m=10", "links.loss_ratio=0")
    summary = run_unlogged(load_scenario("lossy_lane_change", requested, 1))
    for row in summary.vehicles[1:]:
        assert "coast" not in row.ticks_by_mode
        assert row.cross_track_error_m_max is not None
        assert row.cross_track_error_m_max < 0.2
