from dataclasses import replace
from typing import Any

import pytest

from scenarios.definition.schema.limit_tables import LimitsTable
from scenarios.results.deadlines import DeadlineFigure
from scenarios.results.limits import (
    collision_ends_run,
    failure_reason,
    limit_figures,
)
from scenarios.results.reaction import ReactionSummary
from scenarios.results.run_event import RunEvent
from scenarios.results.summary import LimitFigure
from scenarios.results.vehicle_figures import VehicleSummary, vehicle_summaries
from tests.made.scenarios.messages import truth
from tests.made.scenarios.tables import run_of

EVENTS = (
    RunEvent(kind="path_lost", at_s=1.0, vehicles=("v2",), figures={"duration_s": 2.0}),
    RunEvent(kind="collision", at_s=3.0, vehicles=("v1", "v2"), figures={"closing_speed_mps": 4.0}),
    RunEvent(kind="path_lost", at_s=5.0, vehicles=("v3",), figures={"duration_s": 2.0}),
)


def broken(**limits: Any) -> list[str]:
    poses = []
    for seq in range(100):
        poses.append(truth("v1", seq, 0.6 * seq, 0.0))
        behind = 12.0 if seq == 50 else 15.0
        poses.append(truth("v2", seq, 0.6 * seq - behind, 0.004 * seq))
    vehicles = vehicle_summaries(run_of(*poses, count=2), {})
    return [
        result.message
        for result in limit_figures(LimitsTable(**limits), EVENTS, vehicles)
        if result.broken
    ]


def row(name: str, **figures: Any) -> VehicleSummary:
    """The summary of a vehicle with other figures than those of one that never moved."""
    return replace(vehicle_summaries(run_of(count=2), {})[0], name=name, **figures)


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
                "limits.paths_lost_max = 1: path lost: v3 has no known path to steer along, "
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
        ({"collisions_max": 0, "after_collision": "continue"}, None),
        ({"after_collision": "end"}, 1),
        ({"collisions_max": 1, "after_collision": "end"}, 2),
    ],
)
def test_a_run_ends_at_the_collision_that_breaks_its_limit(
    limits: dict[str, Any], ends_at: int | None
) -> None:
    ends = [count for count in range(5) if collision_ends_run(LimitsTable(**limits), count)]
    assert ends == ([] if ends_at is None else list(range(ends_at, 5)))


FOLLOWER = row(
    "v3",
    role="follower",
    self_estimate_error_m_max=0.4,
    friction_ratio_max=0.7,
    reaction=ReactionSummary(blind_m=6.0),
    cross_track_error_m_max=0.2,
    cross_track_error_max_at_s=1.5,
    true_gap_m_min=4.0,
    true_gap_min_at_s=2.5,
)
LEAD = row("v1", friction_ratio_max=0.8, cross_track_error_m_max=None, true_gap_m_min=None)
FIGURES = {
    "self_estimate_error_m_max": (0.4, 0.39, "v3 was 0.40 m wrong about its error"),
    "blind_m_max": (6.0, 5.9, "v3 drove 6.00 m beyond its known path"),
    "cross_track_error_m_max": (
        0.2,
        0.19,
        "v3 was 0.20 m off the lead's path, 1.50 s after the start",
    ),
    "true_gap_m_min": (4.0, 4.1, "v3 was 4.00 m from the vehicle ahead, 2.50 s after the start"),
}


@pytest.mark.parametrize("key", FIGURES)
def test_a_value_at_the_bound_keeps_the_limit_and_one_beyond_breaks_it(key: str) -> None:
    at_bound, beyond, reported = FIGURES[key]
    for bound, line in ((at_bound, ""), (beyond, f"limits.{key} = {beyond:g}: {reported}")):
        (found,) = limit_figures(LimitsTable.model_validate({key: bound}), (), (LEAD, FOLLOWER))
        assert found == LimitFigure(
            limit=key, bound=bound, value=at_bound, vehicle="v3", message=line
        )


@pytest.mark.parametrize(
    ("took_s", "is_over", "line"),
    [
        (0.6, True, ""),
        (0.7, True, "limits.modes[0].within_s = 0.6: v3: in mode lead: after 0.70 s"),
        (None, True, "limits.modes[0].within_s = 0.6: v3: in mode lead: did not happen"),
        (None, False, ""),
    ],
)
def test_deadlines_are_kept_or_broken(took_s: float | None, is_over: bool, line: str) -> None:
    deadline = DeadlineFigure(
        key="modes[0]",
        vehicle="v3",
        action="in mode lead",
        within_s=0.6,
        took_s=took_s,
        is_over=is_over,
    )
    (found,) = limit_figures(LimitsTable(), (), (), [deadline])
    assert found == LimitFigure(
        limit="modes[0]", bound=0.6, value=took_s, vehicle="v3", action="in mode lead", message=line
    )
    assert [result.message for result in limit_figures(LimitsTable(), (), (), [deadline])] == [line]


def test_why_a_run_ended_comes_first_and_nothing_twice() -> None:
    assert failure_reason("", []) == ""
    assert failure_reason("v2 failed", ["x", "y"]) == "v2 failed; x; y"
    assert failure_reason("a", ["a", "b"]) == "a; b"


def test_a_vehicle_s_own_bound_replaces_that_of_the_convoy() -> None:
    other = replace(FOLLOWER, name="v2")
    limits = LimitsTable.model_validate(
        {"cross_track_error_m_max": 0.1, "v3": {"cross_track_error_m_max": 0.15}}
    )
    found = limit_figures(limits, (), (LEAD, other, FOLLOWER))
    assert [(one.limit, one.vehicle, one.bound, one.broken) for one in found] == [
        ("cross_track_error_m_max", "v2", 0.1, True),
        ("v3.cross_track_error_m_max", "v3", 0.15, True),
    ]
    assert found[1].message == (
        "limits.v3.cross_track_error_m_max = 0.15: v3 was 0.20 m off the lead's path, "
        "1.50 s after the start"
    )


def test_events_of_a_vehicle_are_those_that_involve_it() -> None:
    limits = LimitsTable.model_validate(
        {"collisions_max": 1, "v1": {"collisions_max": 0}, "v3": {"collisions_max": 0}}
    )
    found = limit_figures(limits, EVENTS, ())
    assert [(one.limit, one.vehicle, one.value, one.broken) for one in found] == [
        ("collisions_max", "", 1, False),
        ("v1.collisions_max", "v1", 1, True),
        ("v3.collisions_max", "v3", 0, False),
    ]
    assert found[1].message.startswith("limits.v1.collisions_max = 0: collision: v2 and v1")
