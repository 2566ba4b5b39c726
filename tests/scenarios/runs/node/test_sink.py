"""Where messages go: onto a bus when a tick is complete, in batches, or to observers."""

from collections import Counter
from itertools import pairwise

from scenarios.runs.node.sink import BATCH_NS, BatchingSink
from scenarios.runs.observer import OnMessage, listeners_by_kind
from scenarios.runs.virtual import ObservedSink
from tests.made.scenarios.messages import gps, health, tracking, truth
from tests.made.transport import drive
from tests.made.transport.bus import ReceivedMessages
from transport.bus.bus import MemoryBus
from transport.bus.telemetry import unpacked
from transport.codec import encode
from vehicles.messages import (
    Command,
    CompositeTrajectory,
    GpsPose,
    LinkVerdict,
    Message,
    TruePose,
)
from vehicles.schedule import SECOND


def listened_to() -> tuple[MemoryBus, ReceivedMessages]:
    bus, received = MemoryBus(), ReceivedMessages()
    bus.subscribe("convoy/**", received)
    return bus, received


def test_an_observed_vehicle_publishes_its_pose_and_observers_take_their_kinds() -> None:
    bus, received = listened_to()
    taken: list[tuple[str, int, Message]] = []
    some = OnMessage(
        lambda at, one: taken.append(("some", at, one)), frozenset({GpsPose, TruePose})
    )
    other = OnMessage(lambda at, one: taken.append(("other", at, one)), frozenset({TruePose}))
    sink = ObservedSink("v1", bus, lambda: 7, listeners_by_kind([some, other]))
    pose, true = gps("v1", 3), truth("v1", 3, 1.0, 0.0)
    for message in (true, pose, tracking("v1", 3)):
        sink.send(message)
    assert taken == [("some", 7, true), ("other", 7, true), ("some", 7, pose)]
    assert received == []
    for _ in range(2):
        sink.flush()
        assert received == [("convoy/v1/gps", encode(pose))]
    assert [sink.reads(kind) for kind in (TruePose, GpsPose, Command)] == [True, True, False]


def test_log_messages_go_in_batches_and_others_at_once() -> None:
    bus, received = listened_to()
    at = [0]
    sink = BatchingSink("v1", bus, lambda: at[0])
    instants = []
    for tick in range(50):
        at[0] = tick * SECOND // 50
        sink.send(truth("v1", tick, 1.0, 0.0))
        sink.send(gps("v1", tick))
        before = len(received)
        sink.flush()
        assert received[before] == ("convoy/v1/gps", encode(gps("v1", tick)))
        assert len(received) - before <= 2
        instants += [at[0]] * (len(received) - before - 1)
    spans = {later - earlier for earlier, later in pairwise(instants)}
    assert spans == {BATCH_NS}
    sink.send(truth("v1", 50, 1.0, 0.0))
    sink.send(health("v1"))
    sink.flush_all()
    assert [where for where, _ in received[-2:]] == ["convoy/v1/health", "convoy/v1/records"]
    truths = [
        one for where, data in received if where == "convoy/v1/records" for one in unpacked(data)
    ]
    assert [one.data for one in truths] == [encode(truth("v1", k, 1.0, 0.0)) for k in range(51)]
    assert truths[7].at == truth("v1", 7, 1.0, 0.0).true_at_ns
    sink.flush_all()
    assert len(received) == 50 + len(instants) + 2


def test_the_vehicles_of_a_convoy_take_turns() -> None:
    bus, received = listened_to()
    at = [0]
    sinks = [BatchingSink(f"v{k}", bus, lambda: at[0]) for k in range(1, 41)]
    loads: list[int] = []
    for tick in range(5):
        at[0] = SECOND + tick * SECOND // 50
        for k, sink in enumerate(sinks, 1):
            sink.send(truth(f"v{k}", tick, 1.0, 0.0))
            sink.flush()
        loads.append(len(received) - sum(loads))
    assert max(loads[1:]) < 20  # of forty


def test_log_only_messages_are_sent_at_the_rates_of_the_log() -> None:
    bus, received = listened_to()
    at = [0]
    rates = {"trajectory": 5.0, "command": 0.0, "truth": 1.0, "verdict": 0.0}
    sink = BatchingSink("v2", bus, lambda: at[0], logged_hz=rates)
    for tick in range(50):
        at[0] = tick * SECOND // 50
        sink.send(drive.trajectory("v2", tick))
        sink.send(truth("v2", tick, 1.0, 0.0))
        sink.flush()
    sink.flush_all()
    records = [record for _, data in received for record in unpacked(data)]
    counts = Counter(record.topic for record in records)
    assert counts == {"trajectory": 5, "truth": 50}  # figures are made of every true pose
    assert not sink.reads(Command)
    assert sink.reads(CompositeTrajectory)
    assert sink.reads(TruePose)
    assert sink.reads(LinkVerdict)
