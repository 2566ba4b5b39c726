import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.results.link_account import accounts
from scenarios.results.links import LinkSummary, link_summaries
from scenarios.results.run_event import run_events
from scenarios.results.tables import common
from scenarios.results.vehicle_figures import VehicleSummary, vehicle_summaries
from tests.made.examples import examples
from tests.made.scenarios.messages import gps, health, tracking, truth, verdict
from tests.made.scenarios.tables import run_of
from vehicles.messages import Message, TruePose


class Figures(NamedTuple):
    vehicles: tuple[VehicleSummary, ...]
    links: tuple[LinkSummary, ...]


def figures_of(*messages: Message) -> Figures:
    run = run_of(*messages)
    return Figures(vehicle_summaries(run, {}), link_summaries(run, accounts(run)))


def vehicle(name: str, *messages: Message) -> VehicleSummary:
    return next(row for row in figures_of(*messages).vehicles if row.name == name)


@given(st.lists(st.lists(st.integers(0, 20), max_size=20), min_size=1, max_size=3))
def test_common_instants_are_found_in_any_order(columns: list[list[int]]) -> None:
    at, rows = common(*(np.array(column, np.int64) for column in columns))
    assert at.tolist() == sorted(set.intersection(*map(set, columns)))
    for column, places in zip(columns, rows, strict=True):
        assert places.tolist() == [column.index(instant) for instant in at.tolist()]


@given(values=st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=30))
@examples(8, 50)
def test_extremes_are_those_of_the_values(values: list[float]) -> None:
    """NaN is no value."""
    known = [*values, math.nan]
    row = vehicle(
        "v2", *(tracking("v2", seq, lateral_error_m=error) for seq, error in enumerate(known))
    )
    assert row.lateral_error_m_max == max(map(abs, values))
    assert row.lateral_error_m_rms == pytest.approx(math.sqrt(np.square(values).mean()))


def cornering(seq: int, across: float, front: float, rear: float, share: float) -> TruePose:
    return replace(
        truth("v2", seq, float(seq), 0.0), lateral_acceleration_mps2=across, front_slip_rad=front,
        rear_slip_rad=rear, friction_ratio=share,
    )  # fmt: skip


def test_tyre_figures_are_summarised() -> None:
    poses = [
        cornering(0, 1.0, -0.004, -0.003, 0.2), cornering(1, -8.5, 0.06, 0.05, 1.0),
        cornering(2, 4.0, -0.02, -0.08, 0.995), cornering(3, 0.0, 0.0, 0.0, 0.98),
    ]  # fmt: skip
    row = vehicle("v2", *poses)
    assert (row.lateral_acceleration_mps2_max, row.friction_ratio_max) == (8.5, 1.0)
    assert (row.front_slip_rad_max, row.rear_slip_rad_max) == (0.06, 0.08)
    assert row.sliding_s == pytest.approx(2 / 50)
    untold = vehicle("v3", *poses)
    assert untold.lateral_acceleration_mps2_max is None
    assert untold.sliding_s is None


def test_tracking_errors_are_summed_up() -> None:
    errors = [(0.1, 0.01), (-0.4, 0.03), (0.2, -0.05), (0.2, 0.0)]
    row = vehicle(
        "v2",
        *(
            tracking("v2", seq, lateral_error_m=lateral, heading_error_rad=heading)
            for seq, (lateral, heading) in enumerate(errors)
        ),
        tracking("v3", 0, lateral_error_m=9.0),
    )
    assert row.lateral_error_m_max == 0.4
    assert row.lateral_error_m_rms == pytest.approx(0.25)
    assert row.heading_error_rad_max == 0.05


def test_modes_are_counted_and_the_extreme_gaps_kept() -> None:
    modes_and_gaps = [("straight", math.nan), ("lead", 14.0), ("composite", 12.5), ("lead", 13.0)]
    row = vehicle(
        "v2",
        *(
            tracking("v2", seq, mode=mode, estimated_gap_m=gap)
            for seq, (mode, gap) in enumerate(modes_and_gaps)
        ),
    )
    assert row.ticks_by_mode == {"composite": 1, "lead": 2, "straight": 1}
    assert (row.estimated_gap_m_min, row.estimated_gap_m_max) == (12.5, 14.0)
    alone = vehicle("v2", tracking("v2", 0, estimated_gap_m=math.nan))
    assert alone.estimated_gap_m_min is alone.estimated_gap_m_max is None


def lead_and_follower(aside: float) -> Sequence[Message]:
    """The lead drives 60 m east, v2 15 m behind and `aside` to its left."""
    return [
        message
        for seq in range(100)
        for message in (
            truth("v1", seq, 0.6 * seq, 0.0, distance=0.6 * seq),
            truth("v2", seq, 0.6 * seq - 15.0, aside, distance=0.6 * seq),
        )
    ]


def test_true_cross_track_error_is_the_distance_from_the_lead_s_path() -> None:
    for aside in (0.25, -0.25):
        row = vehicle("v2", *lead_and_follower(aside))
        assert row.cross_track_error_m_max == pytest.approx(0.25)
        assert row.cross_track_error_m_rms == pytest.approx(0.25)
        assert row.distance_m == pytest.approx(59.4)


@pytest.mark.parametrize("yaw", [0.1, -0.5])
@pytest.mark.parametrize("distance", [0.0, 10.0])
def test_errors_begin_where_the_lead_started(yaw: float, distance: float) -> None:
    """On the stretch before, v2 is beside a straight that depends on where the lead faced."""
    poses = []
    for message in lead_and_follower(0.25):
        assert isinstance(message, TruePose)
        is_first = message.vehicle == "v1" and message.seq == 0
        whole = replace(message, distance_m=message.distance_m + distance)
        poses.append(replace(whole, yaw_rad=yaw) if is_first else whole)
    row = vehicle("v2", *poses)
    assert row.cross_track_error_m_max == pytest.approx(0.25)
    assert row.cross_track_error_m_rms == pytest.approx(0.25)


def bend(seq: int, behind: float, vehicle: str) -> Message:
    """On a circle of 100 m radius at 20 m/s."""
    turned = (0.4 * seq - behind) / 100.0
    return truth(
        vehicle, seq, 100 * math.sin(turned), 100 * (1 - math.cos(turned)), yaw=turned, distance=1.0
    )


def test_beside_a_hole_in_the_lead_s_path_there_is_no_error() -> None:
    """A straight line across 5 s of a bend would lie 12 m beside the road."""
    kept = [bend(seq, 0.0, "v1") for seq in range(1000) if not 300 <= seq < 550]
    run = run_of(*kept, *(bend(seq, 15.0, "v2") for seq in range(40, 1000)), count=2)
    assert vehicle_summaries(run, {})[1].cross_track_error_m_max == pytest.approx(0.0, abs=0.01)
    assert "lane_departure" not in {event.kind for event in run_events(run)}


@pytest.mark.parametrize(
    ("numbers", "missing"),
    [
        ([0, 1, 2, 3], 0),
        ([0, 1, 2, 5, 6], 2),
        ([2, 3], 2),
        ([0, 2, 1, 3], 0),
        ([3, 2, 1, 0], 0),
        ([5], 5),
        ([0, 5, 1], 3),
    ],
)
def test_poses_are_missing_up_to_the_newest_whatever_their_order(
    numbers: list[int], missing: int
) -> None:
    row = vehicle("v1", *(gps("v1", seq) for seq in numbers))
    assert (row.poses, row.missing_poses) == (len(numbers), missing)


def test_health_is_the_last_one_and_memory_the_largest() -> None:
    row = vehicle(
        "v3",
        health("v3", 0, memory_bytes=50, cpu_ratio=0.5, ticks=10),
        health("v3", 1, memory_bytes=70, cpu_ratio=0.2, ticks=20, late_ticks=1),
        health("v3", 2, memory_bytes=65, cpu_ratio=0.4, ticks=25, late_ticks=1),
        health(
            "v3", 3, final=True, memory_bytes=60, cpu_ratio=0.03, ticks=30, late_ticks=2,
            lateness_ms_max=11.5, rejected_messages=4,
        ),
    )  # fmt: skip
    assert row.memory_bytes_max == 70
    assert (row.ticks, row.late_ticks, row.lateness_ms_max) == (30, 2, 11.5)
    assert (row.rejected_messages, row.finished) == (4, True)
    assert row.cpu_ratio == pytest.approx(0.3)
    assert not vehicle("v3", health("v3", 0)).finished


@given(random=st.randoms(use_true_random=False))
@settings(max_examples=30)
def test_only_the_order_within_a_kind_matters(random: Any) -> None:
    """Kinds of messages come by different ways, and may overtake one another."""
    kinds: list[list[Message]] = [
        [message for message in lead_and_follower(0.3) if message.vehicle == "v1"],
        [message for message in lead_and_follower(0.3) if message.vehicle == "v2"],
        [gps("v1", seq) for seq in range(20)],
        [tracking("v2", seq, lateral_error_m=0.01 * seq) for seq in range(20)],
        [verdict("v1", "v2", seq, dropped="loss" if seq % 3 else "") for seq in range(20)],
        [health("v2", seq, ticks=seq) for seq in range(3)],
    ]
    expected = figures_of(*(message for kind in kinds for message in kind))
    mixed = []
    while any(kinds):
        mixed.append(random.choice([kind for kind in kinds if kind]).pop(0))
    assert figures_of(*mixed) == expected
