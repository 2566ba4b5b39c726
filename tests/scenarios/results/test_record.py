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


def poses(seconds: float, name: str = "v1", without: range = range(0)) -> list[Message]:
    return [gps(name, seq) for seq in range(round(20 * seconds)) if seq not in without]


def truths(seconds: float, name: str = "v1", without: range = range(0)) -> list[Message]:
    numbers = range(round(50 * seconds))
    return [truth(name, seq, 0.4 * seq, 0.0) for seq in numbers if seq not in without]


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


Hole = tuple[str, float, float, int]
"""Kind, first and last instant (s), number of poses."""
Span = tuple[float, float, float]
"""Begin, end and missing time (s) in which nothing is known of true poses."""
OF_ALL = poses(10.0), truths(10.0)


@pytest.mark.parametrize(
    ("messages", "hole", "span"),
    [
        ([*poses(10.0, without=range(40, 135)), *OF_ALL[1], final(10.0)],
         ("pose", 2.0, 6.7, 95), None),
        ([*poses(8.0), *truths(8.0), final(10.0)], ("pose", 8.0, 9.95, 40), (7.98, 10.0, 2.02)),
        # a router that drops what is not urgent keeps the poses; the figures lack those instants
        ([*OF_ALL[0], *truths(10.0, without=range(53, 55)), final(10.0)],
         ("true pose", 1.06, 1.08, 2), (1.04, 1.1, 0.04)),
        # a vehicle that left early, or may have failed, has no hole
        ([*poses(4.0), *truths(4.0), final(4.0)], None, None),
        ([*poses(4.0), *truths(4.0), text("v1", 0, "out of memory", "fatal")], None, None),
        ([*poses(4.0), *truths(4.0), health("v1", seconds=4.0)], None, (3.98, 10.0, 6.02)),
        # a foreign program, and a vehicle of which nothing was recorded
        (OF_ALL[0], ("true pose", 0.0, 9.98, 500), (0.0, 10.0, 10.0)),
        ([], ("pose", 0.0, 9.95, 200), (0.0, 10.0, 10.0)),
    ],
)  # fmt: skip
def test_holes_and_times_in_which_nothing_is_known_are_named(
    messages: list[Message], hole: Hole | None, span: Span | None
) -> None:
    run = run_of(messages)
    found = record_holes(run)
    assert [(one.kind, one.from_s, one.to_s, one.poses) for one in found] == [hole] * bool(hole)
    assert missing_poses(run, "v1") == (hole[3] if hole and hole[0] == "pose" else 0)
    spans = [(one.from_s, one.to_s, one.missing_s) for one in unseen(run)]
    assert spans == [pytest.approx(span)] * bool(span)
    assert {one.vehicle for one in found} | {one.vehicle for one in unseen(run)} <= {"v1"}
    for line in hole_lines(found, 1):
        assert hole is not None
        assert f"{hole[3]} {hole[0]}s of v1, {hole[1]:.2f} to {hole[2]:.2f} s" in line


def test_a_vehicle_that_ended_early_is_silent() -> None:
    assert silent_from_s(run_of([*poses(4.0), *truths(4.0), final(4.0)]), "v1") == pytest.approx(
        4.0, abs=0.05
    )
    assert silent_from_s(run_of([*OF_ALL[0], *OF_ALL[1], final(10.0)]), "v1") is None


STALL = Change(vehicle="v1", seq=0, effective_at_ns=at(9.0), kind="stall", by_hand=True, table="{}")
"""A change after which a vehicle may not send at every instant."""


@given(order=st.permutations(range(25)), kept=st.integers(1, 25))
def test_without_a_schedule_a_hole_lies_between_the_poses_beside_it(
    order: list[int], kept: int
) -> None:
    """In whatever order they came; what was sent last may be missing without a trace."""
    sent_at = [START + (k + k * k) * SECOND // 100 for k in range(25)]
    messages: list[Message] = [
        start(),
        STALL,
        *(sent(gps("v1", k), sent_at[k]) for k in order[:kept]),
    ]
    run = tables_of([(valid_at(message), message) for message in messages])
    known = sorted(order[:kept])
    since = [(at_ns - START) / SECOND for at_ns in sent_at]
    expected = [
        RecordHole(
            vehicle="v1",
            from_s=since[one] if one >= 0 else 0.0,
            to_s=since[other],
            poses=other - one - 1,
        )
        for one, other in zip([-1, *known], known, strict=False)
        if other - one > 1
    ]
    found = [hole for hole in record_holes(run) if hole.vehicle == "v1" and hole.kind == "pose"]
    assert found == expected


def test_the_instant_before_the_hole_in_which_an_event_began() -> None:
    kept = truths(10.0, without=range(100, 150))
    decided = [tracking("v1", seq) for seq in range(20, 500)]
    run = run_of([*kept, *decided, final(10.0)])
    assert seen_before(run, "truth", ["v2", "v1"], at(2.5)) == at(1.98)
    assert seen_before(run, "truth", ["v2", "v1"], at(3.0)) == at(1.98)
    assert seen_before(run, "truth", ["v2", "v1"], at(3.02)) is None
    assert seen_before(run, "truth", ["v2"], at(2.5)) is None
    assert seen_before(run, "tracking", ["v1"], at(0.4)) == START


def test_without_the_start_times_count_from_the_first_true_pose() -> None:
    kept = [*truths(10.0, without=range(100)), *truths(10.0, "v2", range(150))]
    run = tables_of([(valid_at(one), one) for one in kept])
    assert seen_before(run, "truth", ["v2"], at(3.0)) == at(2.0)
    assert {span.from_s for span in unseen(run)} == {0.0}
