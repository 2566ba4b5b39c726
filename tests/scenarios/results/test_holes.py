"""What was not recorded is named, and makes no figure."""

from collections.abc import Sequence
from math import cos, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenarios.results.holes import (
    RecordedSeries,
    RecordHole,
    expected_poses,
    hole_lines,
)
from scenarios.results.metrics import Metrics

from scenarios.definition.schema.link_tables import LinkTable
from scenarios.results.vehicle_figures import VehicleSummary
from tests.made.scenarios.messages import START, gps, health, start, truth
from vehicles.messages import GpsPose, Message
from vehicles.schedule import SECOND, instants, nanoseconds


@given(ran=st.integers(0, 3 * SECOND), rate_hz=st.sampled_from([7.0, 12.5, 20.0, 60.0]))
def test_a_schedule_has_the_instants_before_its_end(ran: int, rate_hz: float) -> None:
    assert expected_poses(ran, rate_hz) == len(list(instants(0, ran, rate_hz)))


def run_of(messages: Sequence[Message], ran_s: float) -> tuple[VehicleSummary, list[RecordHole]]:
    metrics = Metrics(("v1", "v2"), {("v1", "v2"): LinkTable()}, rates_hz={"v1": 20.0, "v2": 10.0})
    metrics.listen(0, start())
    for message in messages:
        metrics.listen(0, message)
    ran_ns = nanoseconds(ran_s)
    return metrics.vehicle_summaries(ran_ns)[0], list(metrics.holes(ran_ns))


def poses(seconds: float) -> list[GpsPose]:
    return [gps("v1", seq) for seq in range(round(seconds * 20))]


def test_a_hole_is_named_by_instants_number_and_vehicle() -> None:
    kept = [one for one in poses(10.0) if not 40 <= one.seq < 135]
    row, holes = run_of([*kept, health("v1", seconds=10.0, final=True)], 10.0)
    assert holes == [RecordHole(vehicle="v1", from_s=2.0, to_s=6.7, poses=95)]
    assert list(hole_lines(holes, 1)) == [
        "not recorded: 95 poses of v1, 2.00 to 6.70 s after the start"
    ]
    assert (row.missing_poses, row.silent_from_s) == (95, None)


def test_the_tail_is_a_hole_of_a_vehicle_that_stayed_to_the_end() -> None:
    row, holes = run_of([*poses(8.0), health("v1", seconds=10.0, final=True)], 10.0)
    assert holes == [RecordHole(vehicle="v1", from_s=8.0, to_s=9.95, poses=40)]
    assert row.missing_poses == 40


def test_a_vehicle_that_left_early_is_reported_and_has_no_hole() -> None:
    row, holes = run_of([*poses(4.0), health("v1", seconds=4.0, final=True)], 10.0)
    assert (row.missing_poses, row.silent_from_s, row.finished, holes) == (0, 4.0, True, [])


def bend(seq: int, behind: float, vehicle: str) -> Message:
    """On a circle of 100 m radius at 20 m/s."""
    turned = (0.4 * seq - behind) / 100.0
    return truth(vehicle, seq, 100 * sin(turned), 100 * (1 - cos(turned)), yaw=turned, distance=1.0)


def test_beside_a_hole_in_the_lead_s_path_there_is_no_error() -> None:
    """A straight line across 5 s of a bend would lie 12 m beside the road."""
    kept = [bend(seq, 0.0, "v1") for seq in range(1000) if not 300 <= seq < 550]
    metrics = Metrics(("v1", "v2"), {("v1", "v2"): LinkTable()})
    for message in (*kept, *(bend(seq, 15.0, "v2") for seq in range(40, 1000))):
        metrics.listen(0, message)
    row = metrics.vehicle_summaries()[1]
    assert row.cross_track_error_m_max == pytest.approx(0.0, abs=0.01)
    assert metrics.events.events() == ()


def test_true_poses_that_are_missing_alone_are_named_too() -> None:
    """A router that drops what is not urgent keeps the poses; the figures lack those instants."""
    kept = [truth("v1", seq, 0.6 * seq, 0.0) for seq in range(500) if seq not in {53, 54}]
    row, holes = run_of([*poses(10.0), *kept, health("v1", seconds=10.0, final=True)], 10.0)
    assert row.missing_poses == 0
    lost = RecordHole(vehicle="v1", from_s=1.06, to_s=1.08, poses=2, kind="true pose")
    assert [hole for hole in holes if hole.vehicle == "v1"] == [lost]
    assert list(hole_lines([lost], 1)) == [
        "not recorded: 2 true poses of v1, 1.06 to 1.08 s after the start"
    ]


@given(
    order=st.permutations(range(25)), kept=st.integers(0, 25), gaps=st.lists(
        st.integers(1, 2000), min_size=25, max_size=25
    )
)  # fmt: skip
def test_without_a_schedule_a_hole_lies_between_the_poses_beside_it(
    order: list[int], kept: int, gaps: list[int]
) -> None:
    """In whatever order they came; what was sent last may be missing without a trace."""
    sent_at = [START + sum(gaps[: k + 1]) * SECOND // 1000 for k in range(25)]
    series = RecordedSeries()
    for number in order[:kept]:
        series.add(number, sent_at[number])
    known = sorted(order[:kept])
    expected = [
        RecordHole(
            vehicle="v1",
            from_s=(sent_at[one] - START) / SECOND if one >= 0 else 0.0,
            to_s=(sent_at[other] - START) / SECOND,
            poses=other - one - 1,
        )
        for one, other in zip([-1, *known], known, strict=False)
        if other - one > 1
    ]
    assert list(series.unscheduled_holes("v1", START)) == expected
