"""Clocks of processes follow the recorder's, whatever their offset and drift."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import pytest

from scenarios.runs.end_confirmation import addressed
from scenarios.runs.processes.membership import ClockOffset, ClockServer, ClockSync
from transport.bus.bus import MemoryBus
from transport.clock import SystemTime, WallClock
from vehicles.schedule import MILLISECOND, SECOND

MS = MILLISECOND
RUN_ID = "recorder"
BOOT = 5_000 * SECOND
"""Reading of the monotonic clock at the true instant 0."""


@dataclass
class World(MemoryBus):
    """A bus with delays, on a true time that is advanced by hand."""

    offset: int = 0
    drift: float = 0.0
    there_ns: int = MS // 2
    back_ns: int = MS // 2
    delays: Callable[[int], int] = lambda _: 0
    now: int = 0
    queries: int = 0
    in_flight: list[tuple[int, Callable[[], None]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self.server = ClockServer(self, lambda: self.now, ["v2"], RUN_ID)
        self.clock = WallClock(system=SystemTime(self.monotonic, lambda: self.now + self.offset))
        self.sync = ClockSync(self, "v2", self.clock, lambda: RUN_ID, sufficient_ns=10 * MS)

    def monotonic(self) -> int:
        return BOOT + self.now + round(self.now * self.drift)

    def request(
        self, key: str, handler: Callable[[bytes], None], timeout_s: float, payload: bytes = b""
    ) -> None:
        self.queries += 1
        extra = self.delays(self.queries)

        def arrive() -> None:
            answer = self.query(key, timeout_s, payload)
            assert answer is not None
            self.in_flight.append((self.now + self.back_ns, lambda: handler(answer)))

        self.in_flight.append((self.now + self.there_ns + extra, arrive))

    def reports(self, query: bytes) -> bytes | None:
        """The server's answer to a query."""
        return self.query("convoy/@clock/run", 1.0, addressed(RUN_ID, query))

    def run(self, seconds: float) -> list[int]:
        """Let time pass; errors (ns) of the clock every 10 ms."""
        errors = []
        until = self.now + round(seconds * SECOND)
        while self.now < until:
            step = min((at for at, _ in self.in_flight), default=until)
            self.now = min(max(step, self.now), self.now - self.now % (10 * MS) + 10 * MS)
            due = [row for row in self.in_flight if row[0] <= self.now]
            self.in_flight = [row for row in self.in_flight if row[0] > self.now]
            for _, act in due:
                act()
            if self.now % (10 * MS) == 0:
                self.sync.advance()
                errors.append(self.clock.now() - self.now)
        return errors


@pytest.mark.parametrize("offset_ms", [5000, -5000, -40, 300])
def test_a_wrong_clock_is_corrected_before_the_start(offset_ms: int) -> None:
    world = World(offset=offset_ms * MS)
    world.run(0.5)
    assert world.sync.is_measured
    assert abs(world.clock.now() - world.now) <= MS // 2
    report = world.server.offsets["v2"]
    assert report.offset == pytest.approx(offset_ms * MS, abs=MS // 2)
    assert report.uncertainty == MS // 2


@pytest.mark.parametrize("drift", [500e-6, -500e-6])
def test_a_drifting_clock_stays_within_a_few_milliseconds(drift: float) -> None:
    world = World(drift=drift, offset=-40 * MS)
    world.run(2.0)
    world.sync.running = True
    errors = world.run(120.0)
    assert max(map(abs, errors)) < 7 * MS  # what it drifts until it is measured again
    assert max(map(abs, errors[6000:])) < 2 * MS  # drift itself is corrected
    # The clock never stops or leaps.
    gains = [10 * MS + after - before for before, after in pairwise(errors)]
    assert 9 * MS < min(gains) <= max(gains) < 11.1 * MS
    expected = -40 * MS + drift * world.now
    assert world.server.offsets["v2"].offset == pytest.approx(expected, abs=7 * MS)


def test_a_step_during_the_run_is_slewed_and_not_taken_for_a_drift() -> None:
    world = World()
    world.run(1.0)
    world.sync.running = True
    world.run(25.0)
    world.clock.set_back(-2 * SECOND)  # as after a machine was suspended
    errors = world.run(60.0)
    assert errors[0] == pytest.approx(2 * SECOND, abs=MS)
    assert abs(errors[-1]) <= MS
    assert abs(world.clock.setting.rate) < 20e-6
    assert all(before - after < 2 * MS for before, after in pairwise(errors))


def test_a_round_trip_of_a_second_is_waited_for_and_its_uncertainty_reported() -> None:
    world = World(offset=3 * SECOND, there_ns=500 * MS, back_ns=500 * MS)
    world.run(1.0)
    assert not world.sync.is_measured
    world.run(7.0)
    report = world.server.offsets["v2"]
    assert report.offset == pytest.approx(3 * SECOND, abs=5 * MS)
    assert report.uncertainty == pytest.approx(500 * MS, abs=10 * MS)


def test_an_asymmetric_delay_stays_within_the_uncertainty() -> None:
    world = World(offset=SECOND, there_ns=8 * MS, back_ns=0)
    world.run(1.0)
    assert abs(world.clock.now() - world.now) <= world.sync.uncertainty == 4 * MS


def test_late_answers_of_an_earlier_measurement_are_not_used_in_the_next() -> None:
    world = World(offset=SECOND, delays=lambda query: 2 * SECOND if query == 1 else 0)
    world.run(1.0)
    assert world.sync.is_measured
    world.run(5.0)
    assert abs(world.clock.now() - world.now) <= MS
    assert world.server.offsets["v2"].offset == pytest.approx(SECOND, abs=MS)


@pytest.mark.parametrize(
    "payload",
    [b"", b"v2", b"v2 1", b"v2 x 1", b"v2 1 -1", b"v3 1 1", b"v2 1 1 1", b"\xff 1 1", b"9" * 5000],
)
def test_malformed_reports_are_ignored(payload: bytes) -> None:
    world = World()
    assert world.reports(b"mark\n" + payload) == b"mark 0"
    assert world.server.offsets == {}
    assert world.reports(b"mark\n" + ClockOffset("v2", -7, 5).pack()) == b"mark 0"
    assert world.server.offsets == {"v2": ClockOffset("v2", -7, 5)}


def test_a_report_of_another_run_gets_no_answer() -> None:
    world, report = World(), ClockOffset("v2", -7, 5).pack()
    for query in (report, b"", addressed("earlier", b"mark\n" + report)):
        assert world.query("convoy/@clock/run", 1.0, query) == b""
    assert world.server.offsets == {}


def test_a_right_clock_is_not_touched() -> None:
    world = World(there_ns=0, back_ns=MS)  # looks like an offset of half the trip
    world.run(5.0)
    world.sync.running = True
    assert set(world.run(60.0)) == {0}
    assert world.server.offsets["v2"].offset == 0


@pytest.mark.parametrize("answer", [b"noon", b"", b"-5", b"1e9", b"9" * 400, "٣".encode()])
def test_an_answer_that_is_no_time_measures_nothing(answer: bytes) -> None:
    world = World()
    world.answer("convoy/@clock/run", lambda _: answer)
    world.run(3.0)
    assert not world.sync.is_measured
