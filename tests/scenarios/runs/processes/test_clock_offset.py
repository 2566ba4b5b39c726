"""The offset of a vehicle's clock from round trips, and what its uncertainty leaves open."""

import pytest

from scenarios.runs.processes.clock_offset import ClockOffset, measure, serve_clock
from transport.bus.memory_bus import MemoryBus
from transport.topics import clock_key
from vehicles.schedule import MILLISECOND

MS = MILLISECOND


def test_the_fastest_of_several_round_trips_gives_the_offset() -> None:
    bus, trips_ms = MemoryBus(), [9, 3, 1, 5, 2]
    now = 1_000 * MS

    def there() -> int:
        """A clock 7 ms ahead, read after half of the round trip."""
        nonlocal now
        half = trips_ms.pop(0) * MS // 2
        now += half
        read = now + 7 * MS
        now += half
        return read

    serve_clock(bus, "v1", there)
    found = measure(bus, "v1", lambda: now)
    assert found == ClockOffset("v1", 7 * MS, MS // 2)
    assert str(found) == "the clock of v1 is 7.0 ms ahead of the recorder's (within 0.5 ms)"


def test_an_asymmetric_delay_stays_within_the_uncertainty() -> None:
    bus = MemoryBus()
    now = 0

    def there() -> int:
        nonlocal now
        now += 8 * MS  # all of the delay on the outbound leg
        return now

    serve_clock(bus, "v1", there)
    found = measure(bus, "v1", lambda: now)
    assert found is not None
    assert abs(found.offset) <= found.uncertainty == 4 * MS


@pytest.mark.parametrize(
    ("offset_ms", "uncertainty_ms", "beyond"),
    [(51.0, 0.5, True), (-51.0, 0.5, True), (50.2, 0.5, False), (90.0, 45.0, False)],
)
def test_only_what_is_certain_counts_against_a_clock(
    offset_ms: float, uncertainty_ms: float, beyond: bool
) -> None:
    found = ClockOffset("v1", round(offset_ms * MS), round(uncertainty_ms * MS))
    assert found.exceeds(50.0) is beyond


def test_a_vehicle_that_does_not_answer_or_not_with_a_time_has_no_offset() -> None:
    bus = MemoryBus()
    assert measure(bus, "v1", lambda: 0) is None
    bus.answer(clock_key("v1"), lambda _: b"noon")
    assert measure(bus, "v1", lambda: 0) is None
