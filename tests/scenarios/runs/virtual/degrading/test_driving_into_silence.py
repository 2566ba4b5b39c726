"""Cars that fall silent one after the other stop one behind the other, not in one place."""

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.results.summary import RunSummary
from scenarios.runs.virtual import run_unlogged
from vehicles.driver.sources import Sources

LANE_M = 3.6
GUARD_MARGIN_M = 1.0
"""Who sees the one ahead stand far off drives up to it this close."""


def driven(preset: str, gap_m: float, seed: int, *more: str) -> RunSummary:
    """Five cars at 30 m/s, past the instants at which the last of them has come to a stand."""
    requested = ("convoy.vehicles=5", "duration_s=21", f"links.preset={preset}")
    return run_unlogged(
        load_scenario("lane_change", (*requested, f"convoy.gap_m={gap_m}", *more), seed)
    )


def least_gap_m(summary: RunSummary) -> float:
    return min(row.true_gap_m_min for row in summary.vehicles if row.true_gap_m_min is not None)


def largest_error_m(summary: RunSummary) -> float:
    return max(row.cross_track_error_m_max or 0.0 for row in summary.vehicles)


def collisions(summary: RunSummary) -> int:
    return sum(event.kind == "collision" for event in summary.events)


@pytest.mark.campaign(1, 50)
@pytest.mark.spread(2)
@pytest.mark.parametrize(
    ("preset", "gap_m", "rate_hz"),
    [("tunnel", 3, 20), ("tunnel", 10, 20), ("tunnel", 10, 10), ("lead_lost", 3, 20)],
)
def test_no_vehicle_hits_its_predecessor(
    preset: str, gap_m: float, rate_hz: int, case: int
) -> None:
    summary = driven(preset, gap_m, case + 1, f"gnss.rate_hz={rate_hz}")
    assert any("stop" in row.ticks_by_mode for row in summary.vehicles)
    assert collisions(summary) == 0
    # 80 m blind, along a straight known from few samples.
    assert largest_error_m(summary) < LANE_M * 20 / rate_hz
    assert least_gap_m(summary) > min(0.5 * gap_m, 0.8 * GUARD_MARGIN_M)


@pytest.mark.campaign(1, 50)
def test_one_link_lost_stops_the_whole_convoy_at_once(case: int) -> None:
    lost = "change=[{kind='link', sender='v1', receiver='v2', loss_ratio=1.0, at_s=12}]"
    summary = driven("clear", 3.07, case + 1, lost)
    assert "stop" in summary.vehicles[1].ticks_by_mode
    assert collisions(summary) == 0
    assert least_gap_m(summary) > 2.0  # of 3 m; it was 0, with a collision for each car


def test_if_none_announced_its_stop_some_would(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Sources, "stops_at", lambda *_: 0)
    assert collisions(driven("tunnel", 3.07, 1)) > 0


def test_a_vehicle_that_brakes_for_lack_of_messages_is_not_hit() -> None:
    """Shadowed links in a dense convoy: each at its own time, for one to three seconds."""
    assert collisions(driven("lte_v2x_dense", 3.07, 1, "duration_s=24")) == 0
