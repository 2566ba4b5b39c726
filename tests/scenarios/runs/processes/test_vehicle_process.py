"""What a vehicle makes of what the recorder announces, and of its silence."""

import time
from threading import Event, Thread

import pytest

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.node.process_probe import Lateness, ProcessProbe
from scenarios.runs.node.vehicle_builder import VehicleBuilder
from scenarios.runs.processes import vehicle_process as process
from scenarios.runs.processes.membership import (
    RECORDER,
    VEHICLE,
    ClockServer,
    Fingerprint,
    Membership,
)
from scenarios.runs.processes.vehicle_process import RunCancelledError, VehicleProcess, paced_ticks
from scenarios.runs.stop import Stop
from transport.bus.bus import MemoryBus, MemoryNetwork
from transport.clock import VirtualClock, late_threshold, ticks
from transport.codec import encode
from transport.topics import RUN_SENDER, TOPICS, key
from vehicles.messages import RunEnd, RunStart
from vehicles.schedule import MILLISECOND, SECOND


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("lane_change", ["duration_s=5"])


@pytest.mark.parametrize(("started_s", "is_late"), [(-3.0, True), (0.5, False)])
@pytest.mark.parametrize("ahead_s", [0.0, 10.0, -10.0])
def test_a_late_join_is_judged_by_the_recorder_s_clock(
    scenario: Scenario, ahead_s: float, started_s: float, *, is_late: bool
) -> None:
    network, stop = MemoryNetwork(), Stop()
    recorder, bus = MemoryBus(network), MemoryBus(network)

    def recorders_now() -> int:
        return time.time_ns() - round(ahead_s * SECOND)

    fingerprint = Fingerprint.of(scenario)
    recorder.announce(RECORDER, "mine only", fingerprint.chunk)
    ClockServer(recorder, recorders_now, ["v2"], "mine only")
    membership = Membership(bus, "mine", VEHICLE, "v2", fingerprint)
    vehicle = VehicleProcess(VehicleBuilder(scenario, "v2"), bus, membership, stop)
    start_at = recorders_now() + round(started_s * SECOND)
    start = start_message(start_at, "mine only")
    recorder.publish(key(RUN_SENDER, TOPICS["start"]), encode(start))
    if not is_late:
        vehicle.await_start(lambda _: None, 5.0)
        return
    with pytest.raises(RunCancelledError, match="run mine had started before"):
        vehicle.await_start(lambda _: None, 5.0)


@pytest.mark.parametrize("says_the_run_is_on", [True, False])
def test_a_recorder_that_catches_up_is_waited_for_as_long_as_it_gives_signs(
    monkeypatch: pytest.MonkeyPatch, *, says_the_run_is_on: bool
) -> None:
    patience_s, needed_s, over = 0.4, 1.6, Event()
    monkeypatch.setattr(process, "END_NS", round(patience_s * SECOND))
    monkeypatch.setattr(process, "WATCH_NS", SECOND // 50)
    network = MemoryNetwork()
    recorder, bus = MemoryBus(network), MemoryBus(network)
    scenario = load_scenario("lane_change", ["duration_s=0.2"])
    fingerprint = Fingerprint.of(scenario)
    Membership(recorder, "mine", RECORDER, "mine only", fingerprint).join()
    ClockServer(recorder, time.time_ns, ["v1"], "mine only")
    membership = Membership(bus, "mine", VEHICLE, "v1", fingerprint)
    vehicle = VehicleProcess(VehicleBuilder(scenario, "v1"), bus, membership, Stop())
    start_at = time.time_ns() + SECOND // 5
    start = encode(start_message(start_at, "mine only"))
    ended_at = start_at + round((0.2 + needed_s) * SECOND)
    end = encode(end_message(ended_at, "mine only"))
    recorder.publish(key(RUN_SENDER, TOPICS["start"]), start)

    def catch_up() -> None:
        while not over.wait(0.1) and time.time_ns() < ended_at:
            if says_the_run_is_on:
                recorder.publish(key(RUN_SENDER, TOPICS["start"]), start)
        recorder.publish(key(RUN_SENDER, TOPICS["end"]), end)

    announcer = Thread(target=catch_up)
    announcer.start()
    try:
        vehicle.await_start(lambda _: None, 1.0)
        if says_the_run_is_on:
            vehicle.drive(lambda _: None)
            assert vehicle.exit_code == 0
        else:
            with pytest.raises(RunCancelledError, match="unknown end: the recorder announced none"):
                vehicle.drive(lambda _: None)
    finally:
        over.set()
        announcer.join()


def start_message(at: int, run_id: str) -> RunStart:
    return RunStart(vehicle=RUN_SENDER, seq=0, start_at_ns=at, run_id=run_id)


def end_message(at: int, run_id: str) -> RunEnd:
    return RunEnd(vehicle=RUN_SENDER, seq=0, end_at_ns=at, reason="", run_id=run_id)


class Announcements:
    """Announcements of a run that a vehicle has joined, with a recorder and a stranger."""

    def __init__(self, scenario: Scenario) -> None:
        self.network = MemoryNetwork()
        self.fingerprint = Fingerprint.of(scenario)
        self.recorder, bus = MemoryBus(self.network), MemoryBus(self.network)
        self.announce_recorder(self.recorder, "ours")
        member = Membership(bus, "mine", VEHICLE, "v1", self.fingerprint)
        member.join(sleep=lambda _: None)
        self.received = process.RunAnnouncements(bus, member, lambda: 0)

    def announce_recorder(self, bus: MemoryBus, run_id: str) -> None:
        bus.announce(RECORDER, run_id, self.fingerprint.chunk)

    def start(self, at: int = 1, run_id: str = "ours") -> RunStart | None:
        """Publish a start; returns the start that the vehicle accepts."""
        start = start_message(at, run_id)
        self.recorder.publish(key(RUN_SENDER, TOPICS["start"]), encode(start))
        return self.received.start

    def end(self, run_id: str) -> RunEnd | None:
        """Publish an end; returns the end that the vehicle accepts."""
        end = encode(end_message(5, run_id))
        self.recorder.publish(key(RUN_SENDER, TOPICS["end"]), end)
        return self.received.end


@pytest.mark.parametrize("started", [False, True])
def test_only_the_recorder_of_the_run_ends_it(scenario: Scenario, *, started: bool) -> None:
    run = Announcements(scenario)
    stranger = MemoryBus(run.network)
    if started:
        run.start()
    run.announce_recorder(stranger, "theirs")
    for run_id in ("", "theirs"):
        assert run.end(run_id) is None
    assert run.received.foreign == 2
    assert run.end("ours") is not None


def test_a_tick_begins_at_the_vehicle_s_turn_and_is_late_from_then_on() -> None:
    start_at = 1_790_000_000 * SECOND
    clock, probe = VirtualClock(start_at), ProcessProbe(late_threshold(50.0))
    schedule = ticks(start_at, start_at + SECOND // 10, 50.0)
    begun_ms = []
    for tick in paced_ticks(schedule, clock, probe, stagger_ns=15 * MILLISECOND, back_at=start_at):
        begun_ms.append((clock.now() - tick.at) // MILLISECOND)
        if len(begun_ms) == 3:
            clock.wait_until(clock.now() + 32 * MILLISECOND)  # what it does takes so long
    assert begun_ms == [15, 15, 15, 27, 15]
    assert probe.lateness == Lateness(1, 12 * MILLISECOND)


def test_a_stranger_does_not_follow_the_recorder_of_a_started_run(scenario: Scenario) -> None:
    run = Announcements(scenario)
    run.start()
    run.network.leave(run.recorder)
    run.announce_recorder(MemoryBus(run.network), "theirs")
    assert run.end("theirs") is None
    assert run.end("ours") is not None


def test_only_the_recorder_of_the_run_starts_it(scenario: Scenario) -> None:
    """Also not a recorder of an earlier run, and nobody moves a start that was announced."""
    run = Announcements(scenario)
    for run_id in ("", "theirs"):
        assert run.start(5, run_id) is None
    assert run.received.foreign == 2
    assert run.start(1) == run.start(2)
