"""Hardly a message at the start: what bridges the first gaps is no proof of good receivers."""

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.runs.virtual import run_unlogged


@pytest.mark.spread(2)
@pytest.mark.parametrize(
    ("loss_ratio", "seed"), [(0.8, 3), (0.8, 8), (0.8, 15), (0.9, 3), (0.9, 11), (0.9, 12)]
)
def test_a_car_with_few_messages_stays_on_the_straight_road(loss_ratio: float, seed: int) -> None:
    # A source that is lost later than this lets a car drive blindly for a second more.
    silence = "control.degradation.lost_s_max=0.5"
    requested = (f"links.loss_ratio={loss_ratio}", "convoy.gap_m=3", "duration_s=6", silence)
    for row in run_unlogged(load_scenario("lane_change", requested, seed)).vehicles[1:]:
        assert row.cross_track_error_m_max is not None
        assert row.cross_track_error_m_max < 0.45, row.name  # it was 0.55 to 4.9 m


@pytest.mark.spread(2)
@pytest.mark.parametrize(
    ("loss_ratio", "seed"),
    [(0.93, 106), (0.93, 107), (0.93, 115), (0.93, 128), (0.8, 114), (0.8, 137)],
)
def test_noise_of_few_samples_is_no_bend(loss_ratio: float, seed: int) -> None:
    requested = (f"links.loss_ratio={loss_ratio}", "duration_s=4")
    for row in run_unlogged(load_scenario("lossy_lane_change", requested, seed)).vehicles[1:]:
        assert row.cross_track_error_m_max is not None
        assert row.cross_track_error_m_max < 0.7, row.name  # it was up to 3.7 m


def test_a_start_into_a_bend_works_with_few_samples_of_a_slow_receiver() -> None:
    bend = "path.segments=[{length_m=2.0}, {length_m=60.0, radius_m=150.0, turn='right'}]"
    requested = (bend, "speed.set_mps=20", "gnss.rate_hz=5", "links.loss_ratio=0", "duration_s=2")
    for row in run_unlogged(load_scenario("lossy_lane_change", requested, 1)).vehicles[1:]:
        assert row.cross_track_error_m_max is not None
        assert row.cross_track_error_m_max < 0.3, row.name
