"""A follower whose known path ends at a hole."""

from collections.abc import Iterator
from math import isfinite

import pytest

from tests.made.convoys.driven import Driven, collisions, driven, errors, summary_of
from vehicles.driver.situation import CREEP_SPEED
from vehicles.driver.sources import Sources
from vehicles.driver.tracking import Rejoining
from vehicles.messages import Tracking, TruePose

NO_HISTORY = "sending.path_history_m=0"
LOOP = [
    "duration_s=34",
    "convoy.vehicles=3",
    "speed.profile=[{at_s=0.0, speed_mps=1.4}, {at_s=3.0, speed_mps=6.0}]",
    "change=[{kind='cut', at_s=20.27, for_s=7.04}]",
]
"""The lead drives round most of a car park's loop while nobody receives anything."""
CONTROL_S = 0.02


def cut(start: float, length: float, sender: str = "*") -> str:
    return f"change=[{{kind='cut', at_s={start}, for_s={length}, sender='{sender}'}}]"


@pytest.fixture(scope="module")
def before_hole() -> Driven:
    return driven("church_lot", *LOOP, NO_HISTORY, "speed.lead_keeps_gap=false")


def test_before_a_long_hole_it_stands_and_states_why(before_hole: Driven) -> None:
    assert max(before_hole.errors()) < 0.5
    last = before_hole.of("v2", Tracking)[-1]
    assert "hole" in last.reason
    assert last.known_m > 0.0
    assert before_hole.speeds("v2")[-1] < 0.01


def test_with_path_history_it_drives_on_along_the_path() -> None:
    run = driven("church_lot", *LOOP)
    assert max(run.errors()) < 0.5
    assert collisions(run.summary) == 0
    assert run.speeds("v2")[-1] > 1.0


def test_if_a_bridge_counted_as_known_it_would_leave_the_path(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Sources, "_find_hole", lambda *_: None)
    monkeypatch.setattr(Rejoining, "corrected", lambda _, __, errors, ___: errors)
    requested = *LOOP, NO_HISTORY, "speed.lead_keeps_gap=false"
    assert max(errors(summary_of("church_lot", *requested))) > 2.0


def creeping(rows: list[Tracking]) -> Iterator[Tracking]:
    return (row for row in rows if row.hazard and row.mode not in {"stop", "straight"})


def test_a_short_hole_on_a_gentle_road_is_crossed_at_walking_pace() -> None:
    run = driven("highway", "duration_s=40", NO_HISTORY, "convoy.vehicles=2", cut(12.0, 2.5))
    speeds = {pose.true_at_ns: pose.speed_mps for pose in run.of("v2", TruePose)}
    creeps = list(creeping(run.of("v2", Tracking)))
    inside = [speeds[row.decided_at_ns] for row in creeps if row.known_m < 0.0]
    assert inside
    braked = next(k for k, speed in enumerate(inside) if speed < 1.25 * CREEP_SPEED)
    assert sorted(inside[:braked], reverse=True) == inside[:braked]  # it comes from a blind stop
    assert max(inside[braked:]) < 1.25 * CREEP_SPEED
    assert max(run.errors()) < 0.5
    assert run.speeds("v2")[-1] > 5.0
    figures = run.summary.vehicles[1].reaction
    assert figures.blind_m > 1.0
    assert figures.predicted_blind_m_max is not None
    fast = (row for row in creeps if speeds[row.decided_at_ns] > max(inside[braked:]))
    blind = -min(row.known_m for row in fast)  # the rest of the hole is crossed at walking pace
    assert blind <= max(1.05 * figures.predicted_blind_m_max, 0.5)
    assert all(isfinite(row.blind_m) and row.blind_m > 0.0 for row in creeps)


@pytest.mark.spread(2)
@pytest.mark.parametrize("case", [(4.6, 4.0), (6.0, 5.0), (19.5, 4.0)])
def test_a_car_beside_the_path_returns_slowly(case: tuple[float, float]) -> None:
    """All links fail during a lane change at 30 m/s."""
    duration_s = min(sum(case) + 14.0, 34.0)
    run = driven("lane_change", f"duration_s={duration_s}", "convoy.vehicles=3", cut(*case))
    end_at = run.scenario.start_at_ns + round((case[0] + case[1]) * 1e9)
    for name in ("v2", "v3"):
        lateral = {row.decided_at_ns: row.lateral_error_m for row in run.of(name, Tracking)}
        heading = {row.decided_at_ns: row.heading_error_rad for row in run.of(name, Tracking)}
        for pose in run.of(name, TruePose):
            beside = abs(lateral.get(pose.true_at_ns, 0.0))
            if pose.true_at_ns > end_at and beside > 0.3:
                assert abs(heading[pose.true_at_ns]) < 0.25
                assert abs(pose.lateral_acceleration_mps2) < 3.5
        assert abs(lateral[max(lateral)]) < 0.3


@pytest.mark.spread(1)
@pytest.mark.parametrize("name", ["lane_change", "church_lot"])
def test_after_flapping_links_no_car_stands_for_long(name: str) -> None:
    cuts = ", ".join(f"{{kind='cut', at_s={8.0 + 2.2 * k:.1f}, for_s=1.2}}" for k in range(8))
    run = driven(name, "duration_s=32", "convoy.vehicles=3", f"change=[{cuts}]")
    for vehicle in ("v2", "v3"):
        speeds = {pose.true_at_ns: pose.speed_mps for pose in run.of(vehicle, TruePose)}
        standing = 0.0
        for row in run.of(vehicle, Tracking):
            received = min(row.lead_received_ratio, row.predecessor_received_ratio) >= 0.8
            free = row.estimated_gap_m > 6.0
            stands = speeds.get(row.decided_at_ns, 9.0) < 0.1
            standing = standing + CONTROL_S if received and free and stands else 0.0
            assert standing <= 3.0


def left_behind_m(*overrides: str) -> float:
    """How much less than the lead, which has no fix for 3 s, the last follower has driven."""
    change = "change=[{kind='gnss', at_s=8, vehicle='v1', fix='none', for_s=3}]"
    run = summary_of("highway", "duration_s=25", "convoy.vehicles=2", change, *overrides)
    assert max(errors(run)) < 0.2
    return run.vehicles[0].distance_m - run.vehicles[-1].distance_m


def test_a_lead_without_fixes_sends_where_it_drove_by_dead_reckoning() -> None:
    assert left_behind_m() < 0.7 * left_behind_m(NO_HISTORY)
