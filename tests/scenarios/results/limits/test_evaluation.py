from dataclasses import replace
from typing import Any

import pytest

from scenarios.definition.schema.limit_tables import LimitsTable
from scenarios.results.limits import (
    collision_ends_run,
    failure_reason,
    limit_figures,
)
from scenarios.results.reaction import ReactionSummary
from scenarios.results.run_event import RunEvent
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
    ("limits", "figures"),
    [
        ({"collisions_max": 0}, ["3.00 s"]),
        ({"collisions_max": 1}, []),
        ({"paths_lost_max": 1}, ["5.00 s"]),
        ({"near_misses_max": 0, "lane_departures_max": 0}, []),
        ({"cross_track_error_m_max": 0.3}, ["0.40 m", "1.98 s"]),
        ({"cross_track_error_m_max": 0.5, "true_gap_m_min": 6.9}, []),
        ({"true_gap_m_min": 7.5}, ["7.00 m", "1.00 s"]),
        ({"after_collision": "end"}, ["3.00 s"]),
    ],
)
def test_a_broken_limit_is_named_with_its_figure_and_instant(
    limits: dict[str, Any], figures: list[str]
) -> None:
    lines = broken(**limits)
    assert len(lines) == bool(figures)
    for line in lines:
        (key,) = limits
        assert f"limits.{key} = " in line
        assert all(figure in line for figure in figures)


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


@pytest.mark.parametrize(
    ("key", "at_bound", "beyond"),
    [
        ("self_estimate_error_m_max", 0.4, 0.39),
        ("blind_m_max", 6.0, 5.9),
        ("cross_track_error_m_max", 0.2, 0.19),
        ("true_gap_m_min", 4.0, 4.1),
    ],
)
def test_a_value_at_the_bound_keeps_the_limit_and_one_beyond_breaks_it(
    key: str, at_bound: float, beyond: float
) -> None:
    for bound in (at_bound, beyond):
        (found,) = limit_figures(LimitsTable.model_validate({key: bound}), (), (LEAD, FOLLOWER))
        assert (found.limit, found.value, found.vehicle) == (key, at_bound, "v3")
        assert found.broken == (bound == beyond)


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
