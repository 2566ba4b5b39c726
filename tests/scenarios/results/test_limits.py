from typing import Any

import pytest

from scenarios.definition.schema.links import LinkTable
from scenarios.definition.schema.limits import LimitsTable
from scenarios.results.events import RunEvent
from scenarios.results.limits import broken_limits, collision_ends_run, why_failed
from scenarios.results.metrics import Metrics
from tests.made.scenarios.messages import start, truth

EVENTS = (
    RunEvent(kind="path_lost", at_s=1.0, vehicles=("v2",), figures={"duration_s": 2.0}),
    RunEvent(kind="collision", at_s=3.0, vehicles=("v1", "v2"), figures={"closing_speed_mps": 4.0}),
    RunEvent(kind="path_lost", at_s=5.0, vehicles=("v3",), figures={"duration_s": 2.0}),
)


def broken(**limits: Any) -> list[str]:
    metrics = Metrics(("v1", "v2"), {("v1", "v2"): LinkTable()})
    metrics.add(start())
    for seq in range(100):
        metrics.add(truth("v1", seq, 0.6 * seq, 0.0))
        metrics.add(truth("v2", seq, 0.6 * seq - (11.93 if seq == 50 else 14.93), 0.004 * seq))
    return broken_limits(LimitsTable(**limits), EVENTS, metrics.vehicle_summaries())


def test_without_limits_nothing_is_broken() -> None:
    assert broken() == []


@pytest.mark.parametrize(
    ("limits", "lines"),
    [
        (
            {"collisions_max": 0},
            [
                "limits.collisions_max = 0: collision: v2 and v1, closing at 4.0 m/s, "
                "3.00 s after the start"
            ],
        ),
        ({"collisions_max": 1}, []),
        (
            {"paths_lost_max": 1},
            [
                "limits.paths_lost_max = 1: path lost: v3 receives too little to steer along, "
                "5.00 s after the start"
            ],
        ),
        ({"near_misses_max": 0, "lane_departures_max": 0}, []),
        (
            {"cross_track_error_m_max": 0.3},
            [
                "limits.cross_track_error_m_max = 0.3: v2 was 0.40 m off the lead's path, "
                "1.98 s after the start"
            ],
        ),
        ({"cross_track_error_m_max": 0.5, "true_gap_m_min": 6.9}, []),
        (
            {"true_gap_m_min": 7.5},
            [
                "limits.true_gap_m_min = 7.5: v2 was 7.00 m from the vehicle ahead, "
                "1.00 s after the start"
            ],
        ),
        (
            {"after_collision": "end"},
            [
                'limits.after_collision = "end": collision: v2 and v1, closing at 4.0 m/s, '
                "3.00 s after the start"
            ],
        ),
    ],
)
def test_a_broken_limit_is_named_with_its_figure_and_instant(
    limits: dict[str, Any], lines: list[str]
) -> None:
    assert broken(**limits) == lines


@pytest.mark.parametrize(
    ("limits", "ends_at"),
    [
        ({}, None),
        ({"collisions_max": 0}, 1),
        ({"collisions_max": 2}, 3),
        ({"collisions_max": 0, "after_collision": "go_on"}, None),
        ({"after_collision": "end"}, 1),
        ({"collisions_max": 1, "after_collision": "end"}, 2),
    ],
)
def test_a_run_ends_at_the_collision_that_breaks_its_limit(
    limits: dict[str, Any], ends_at: int | None
) -> None:
    ends = [count for count in range(5) if collision_ends_run(LimitsTable(**limits), count)]
    assert ends == ([] if ends_at is None else list(range(ends_at, 5)))


def test_why_a_run_ended_comes_first_and_nothing_twice() -> None:
    assert why_failed("", []) == ""
    assert why_failed("v2 died", ["a", "b"]) == "v2 died; a; b"
    assert why_failed("a", ["a", "b"]) == "a; b"
