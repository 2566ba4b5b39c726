"""What was not recorded is named: poses, true poses, decisions, and vehicles that are unseen."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.results.record import (
    RecordHole,
    expected_poses,
    hole_lines,
    missing_poses,
    pose_holes,
    record_holes,
    seen_before,
    silent_from_s,
    unseen,
)
from scenarios.results.tables import RunTables
from tests.made.scenarios.messages import START, at, gps, health, sent, start, text, tracking, truth
from tests.made.scenarios.recorded_run import NAMES, tables_of
from transport.topics import valid_at
from vehicles.messages import Change, Message
from vehicles.schedule import SECOND, instants


@given(ran=st.integers(0, 3 * SECOND), rate_hz=st.sampled_from([7.0, 12.5, 20.0, 60.0]))
def test_a_schedule_has_the_instants_before_its_end(ran: int, rate_hz: float) -> None:
    assert expected_poses(ran, rate_hz) == len(list(instants(0, ran, rate_hz)))


def poses(seconds: float, name: str = "v1") -> list[Message]:
    return [gps(name, seq) for seq in range(round(20 * seconds))]


def truths(seconds: float, name: str = "v1") -> list[Message]:
    return [truth(name, seq, 0.4 * seq, 0.0) for seq in range(round(50 * seconds))]


def final(seconds: float, name: str = "v1") -> Message:
    return health(name, seconds=seconds, final=True)


def run_of(messages: Sequence[Message], ran_s: float = 10.0) -> RunTables:
    """Tables of a run with v2 and v3 complete."""
    others = [
        message
        for name in NAMES[1:]
        for message in (*poses(10.0, name), *truths(10.0, name), final(10.0, name))
    ]
    recorded = [start(), *messages, *others]
    return tables_of([(valid_at(message), message) for message in recorded], ran_s=ran_s)


def test_a_hole_is_named_by_instants_number_and_vehicle() -> None:
    kept = [one for one in poses(10.0) if not 40 <= one.seq < 135]
    run = run_of([*kept, *truths(10.0), final(10.0)])
    holes = record_holes(run)
    assert holes == (RecordHole(vehicle="v1", from_s=2.0, to_s=6.7, poses=95),)
    assert list(hole_lines(holes, 1)) == [
        "not recorded: 95 poses of v1, 2.00 to 6.70 s after the start"
    ]
    assert (missing_poses(run, "v1"), silent_from_s(run, "v1"), unseen(run)) == (95, None, ())


def test_the_tail_is_a_hole_of_a_vehicle_that_stayed_to_the_end() -> None:
    run = run_of([*poses(8.0), *truths(8.0), final(10.0)])
    assert record_holes(run) == (RecordHole(vehicle="v1", from_s=8.0, to_s=9.95, poses=40),)
    (span,) = unseen(run)
    assert (span.vehicle, span.kind, span.from_s, span.to_s) == ("v1", "true pose", 7.98, 10.0)


@pytest.mark.parametrize("last", [final(4.0), text("v1", 0, "out of memory", "fatal")], ids=str)
def test_a_vehicle_that_left_early_has_no_hole(last: Message) -> None:
    run = run_of([*poses(4.0), *truths(4.0), last])
    assert (missing_poses(run, "v1"), record_holes(run)) == (0, ())
    assert silent_from_s(run, "v1") == pytest.approx(4.0, abs=0.05)


def test_a_vehicle_that_became_silent_is_unseen_to_the_end() -> None:
    """It may have failed, so its poses are no hole; nothing is known of it."""
    run = run_of([*poses(4.0), *truths(4.0), health("v1", seconds=4.0)])
    assert record_holes(run) == ()
    (span,) = unseen(run)
    assert (span.from_s, span.to_s) == (3.98, 10.0)
    assert span.missing_s == pytest.approx(6.02)


def test_true_poses_that_are_missing_alone_are_named_too() -> None:
    """A router that drops what is not urgent keeps the poses; the figures lack those instants."""
    kept = [one for one in truths(10.0) if one.seq not in {53, 54}]
    run = run_of([*poses(10.0), *kept, final(10.0)])
    lost = RecordHole(vehicle="v1", from_s=1.06, to_s=1.08, poses=2, kind="true pose")
    assert (missing_poses(run, "v1"), record_holes(run)) == (0, (lost,))
    assert list(hole_lines([lost], 1)) == [
        "not recorded: 2 true poses of v1, 1.06 to 1.08 s after the start"
    ]
    (span,) = unseen(run)
    assert (span.from_s, span.to_s) == (1.04, 1.1)
    assert span.missing_s == pytest.approx(0.04)


@pytest.mark.parametrize("messages", [poses(10.0), []], ids=["a foreign program", "nothing"])
def test_a_vehicle_without_any_true_pose_is_a_hole(messages: list[Message]) -> None:
    kind, count, last = ("true pose", 500, 9.98) if messages else ("pose", 200, 9.95)
    run = run_of(messages)
    (hole,) = record_holes(run)
    assert (hole.vehicle, hole.kind, hole.poses) == ("v1", kind, count)
    assert (hole.from_s, hole.to_s) == (0.0, last)
    (span,) = unseen(run)
    assert (span.vehicle, span.from_s, span.to_s, span.missing_s) == ("v1", 0.0, 10.0, 10.0)


STALL = Change(vehicle="v1", seq=0, effective_at_ns=at(9.0), kind="stall", by_hand=True, table="{}")
"""A change after which a vehicle may not send at every instant."""


@given(
    order=st.permutations(range(25)),
    kept=st.integers(0, 25),
    gaps=st.lists(st.integers(100, 2000), min_size=25, max_size=25),
)
def test_without_a_schedule_a_hole_lies_between_the_poses_beside_it(
    order: list[int], kept: int, gaps: list[int]
) -> None:
    """In whatever order they came; what was sent last may be missing without a trace."""
    sent_at = [START + sum(gaps[: k + 1]) * SECOND // 1000 for k in range(25)]
    poses = [sent(gps("v1", k), sent_at[k]) for k in order[:kept]]
    messages: list[Message] = [start(), STALL, *poses]
    run = tables_of([(valid_at(message), message) for message in messages])
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
    assert pose_holes(run, "v1") == expected


def test_the_instant_before_the_hole_in_which_an_event_began() -> None:
    kept = [one for one in truths(10.0) if not 100 <= one.seq < 150]
    decided = [tracking("v1", seq) for seq in range(500) if seq not in range(20)]
    run = run_of([*kept, *decided, final(10.0)])
    assert seen_before(run, "truth", ["v2", "v1"], at(2.5)) == at(1.98)
    assert seen_before(run, "truth", ["v2", "v1"], at(3.0)) == at(1.98)
    assert seen_before(run, "truth", ["v2", "v1"], at(3.02)) is None
    assert seen_before(run, "truth", ["v2"], at(2.5)) is None
    assert seen_before(run, "tracking", ["v1"], at(0.4)) == START


def test_without_the_start_times_count_from_the_first_true_pose() -> None:
    late = [one for name in ("v1", "v2") for one in truths(10.0, name) if one.seq >= 100]
    kept = [one for one in late if one.vehicle == "v1" or one.seq >= 150]
    run = tables_of([(valid_at(one), one) for one in kept])
    assert seen_before(run, "truth", ["v2"], at(3.0)) == at(2.0)
    assert {span.from_s for span in unseen(run)} == {0.0}
