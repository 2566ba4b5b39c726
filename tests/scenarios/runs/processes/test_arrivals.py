from collections import Counter
from itertools import starmap

import pytest

from scenarios.runs.processes.arrivals import (
    MOST_BYTES,
    OLDEST_NS,
    OVERHEAD_BYTES,
    Arrivals,
    SendingOrder,
)
from transport.bus.telemetry import BatchRecord, packed
from transport.codec import MAX_BYTES, RefusedMessageError
from vehicles.schedule import SECOND

KEYS = [f"convoy/v{vehicle}/{topic}" for vehicle in range(20) for topic in "abcdefghij"]


def drained(arrivals: Arrivals) -> list[tuple[int, str, bytes]]:
    """All that waits, in turn."""
    return arrivals.take(len(arrivals), 0.0)


def test_a_recorder_of_twenty_that_is_held_up_for_five_seconds_loses_nothing() -> None:
    arrivals = Arrivals(KEYS)
    count = 0
    for tick in range(5 * 50):
        for name in KEYS[::2]:  # five topics of each at 50 Hz, of 200 bytes
            arrivals.put(tick, name, bytes(200))
            count += 1
    assert not arrivals.error_lines()
    assert len(drained(arrivals)) == count


def test_a_flood_is_refused_and_pushes_out_nothing_of_others() -> None:
    forged, honest = KEYS[0], KEYS[1:]
    arrivals = Arrivals(KEYS, most_bytes=1_000_000)
    size = 240 + OVERHEAD_BYTES
    for at in range(10_000):
        arrivals.put(at, forged, bytes(240))
    assert arrivals.error_lines() == {"overflow": 10_000 - 1_000_000 // size}
    for at in range(12):
        for name in honest:
            arrivals.put(at, name, bytes(240))
    assert not arrivals.error_lines()
    counts = Counter(name for _, name, _ in drained(arrivals))
    assert all(counts[name] == 12 for name in honest)
    arrivals.put(0, forged, bytes(240))  # there is room again
    assert not arrivals.error_lines()
    assert len(arrivals) == 1


def test_unrecordable_messages_do_not_wait() -> None:
    arrivals = Arrivals(KEYS)
    for _ in range(3):
        arrivals.put(0, "convoy/ghost/a", b"boo")
        arrivals.put(0, KEYS[0], bytes(MAX_BYTES + 1))
    arrivals.put(0, KEYS[0], bytes(MAX_BYTES))
    assert arrivals.error_lines() == {"unknown": 3, "oversized": 3}
    assert not arrivals.error_lines()
    assert len(arrivals) == 1


def test_messages_of_a_batch_take_their_places_by_their_own_instants() -> None:
    held = SendingOrder({"v1/records": {"truth": "v1/truth"}})
    late = 5 * SECOND
    held.put((late - 10, "v2/gps", b"alone"))
    records = [("truth", late - 20, b"before"), ("truth", late - 5, b"after")]
    records += [("truth", 0, b"long ago"), ("truth", 2 * late, b"not yet"), ("gps", late, b"alone")]
    batch, *more = packed(starmap(BatchRecord, records))
    assert not more
    held.put((late, "v1/records", batch))
    with pytest.raises(RefusedMessageError, match="garbage"):
        held.put((late, "v1/records", b"rubbish"))
    assert held.until(late - 6) == [
        (late - OLDEST_NS, "v1/truth", b"long ago"),
        (late - 20, "v1/truth", b"before"),
        (late - 10, "v2/gps", b"alone"),
    ]
    assert held.until() == [
        (late - 5, "v1/truth", b"after"),
        (late, "v1/truth", b"not yet"),
        (late, "v1/records", b"alone"),  # no batch may have it, and no recorder takes that key
    ]


def test_messages_are_returned_in_order_of_sending() -> None:
    held = SendingOrder()
    sent = [30, 10, 20, 10, 50]
    for number, at in enumerate(sent):
        held.put((at, f"{number}", b""))
    assert [key for _, key, _ in held.until(9)] == []
    assert [key for _, key, _ in held.until(20)] == ["1", "3", "2"]  # equal ones as they came
    held.put((5, "late", b""))
    assert [key for _, key, _ in held.until(20)] == ["late"]
    assert [key for _, key, _ in held.until()] == ["0", "4"]


def test_under_a_flood_of_all_keys_twice_the_limit_waits_at_most() -> None:
    arrivals = Arrivals(KEYS, most_bytes=1_000_000)
    for at in range(100):
        for name in KEYS:
            arrivals.put(at, name, bytes(840))
    assert sum(len(data) + OVERHEAD_BYTES for _, _, data in drained(arrivals)) <= 2_000_000
    assert MOST_BYTES <= 64 * 2**20


def test_messages_are_taken_in_turn() -> None:
    arrivals = Arrivals(KEYS)
    assert arrivals.take(1, 0.0) == []
    for at, name in enumerate(KEYS):
        arrivals.put(at, name, name.encode())
    assert drained(arrivals) == [(at, name, name.encode()) for at, name in enumerate(KEYS)]
    assert not arrivals.error_lines()


def test_only_some_keys_may_have_larger_messages() -> None:
    arrivals = Arrivals(["small"], larger={"large": 50_000})
    for key in ("small", "large"):
        arrivals.put(0, key, bytes(MAX_BYTES + 1))
    arrivals.put(0, "large", bytes(50_001))
    assert [key for _, key, _ in drained(arrivals)] == ["large"]
    assert arrivals.error_lines() == {"oversized": 2}
