"""Changes of a vehicle are taken once and in order of time, added from any thread."""

from threading import Thread

from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.schema.change_tables import LeaveTable, StallTable
from scenarios.runs.node.outbox import DueChange, PendingChanges, scheduled_changes
from vehicles.schedule import SECOND


def stall(at_s: float = 0.0, vehicle: str = "v2") -> StallTable:
    return StallTable(kind="stall", at_s=at_s, vehicle=vehicle, for_s=1.0)


def due(at: int) -> DueChange:
    return DueChange(at, stall())


instants = st.lists(st.integers(0, 100))


@given(instants, instants, st.lists(st.integers(1, 30)))
def test_each_is_taken_once_at_the_first_tick_from_its_instant_on(
    before: list[int], added: list[int], spans: list[int]
) -> None:
    pending_changes = PendingChanges(map(due, before))
    for at in added:
        pending_changes.add(due(at))
    now, last, taken = 0, -1, []
    for span in [*spans, 200]:
        now += span
        for one in pending_changes.take(now):
            assert last < one.at <= now
            taken.append(one.at)
        last = now
    assert taken == sorted(before + added)


def test_of_one_instant_the_first_to_be_named_comes_first() -> None:
    first, second, third = (
        DueChange(5, stall(1.0)),
        DueChange(5, stall(2.0)),
        DueChange(5, stall(3.0), by_hand=True),
    )
    pending_changes = PendingChanges([first, second])
    pending_changes.add(third)
    assert pending_changes.take(5) == [first, second, third]


def test_a_late_change_is_taken_at_the_next_tick() -> None:
    pending_changes = PendingChanges()
    assert pending_changes.take(50) == []
    pending_changes.add(due(10))
    assert pending_changes.take(51) == [due(10)]
    assert pending_changes.take(52) == []


def add_many(pending_changes: PendingChanges) -> None:
    for at in range(500):
        pending_changes.add(due(at))


def test_nothing_is_lost_between_threads() -> None:
    pending_changes, taken = PendingChanges(), 0
    threads = [Thread(target=add_many, args=(pending_changes,)) for _ in range(4)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        taken += len(pending_changes.take(1000))
    assert taken + len(pending_changes.take(1000)) == 2000


def test_a_vehicle_has_those_that_concern_it_counted_from_the_start() -> None:
    other = LeaveTable(kind="leave", at_s=0.5, vehicle="v3")
    chosen = scheduled_changes([stall(2.5), other], 7, lambda change: change.kind == "stall")
    assert chosen == [DueChange(7 + 5 * SECOND // 2, stall(2.5))]
