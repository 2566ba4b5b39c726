"""Where messages go: onto a bus when a tick is complete, or to the drives of a rehearsal."""

from scenarios.results.drives import DriveRecorder
from scenarios.runs.node.sink import BusSink
from scenarios.runs.rehearsal import RehearsalSink
from tests.made.scenarios.messages import gps, health, tracking, truth
from tests.made.transport import drive
from tests.made.transport.bus import Heard
from transport.bus.memory_bus import MemoryBus
from transport.codec import encode
from transport.topics import Topic
from vehicles.messages import Message


class TakenDown(DriveRecorder):
    """A drive recorder that keeps what it is given."""

    def __init__(self) -> None:
        super().__init__()
        self.messages: list[Message] = []

    def listen(self, message: Message) -> None:
        self.messages.append(message)


def listened_to() -> tuple[MemoryBus, Heard]:
    bus, heard = MemoryBus(), Heard()
    bus.subscribe("convoy/**", heard)
    return bus, heard


def test_messages_are_published_together_and_in_order_when_flushed() -> None:
    bus, heard = listened_to()
    sink = BusSink("v1", bus)
    sent: list[Message] = [truth("v1", 0, 1.0, 0.0), gps("v1", 0), tracking("v1", 0)]
    for message in sent:
        sink.send(message)
    assert heard == []
    sink.flush()
    keys = ("convoy/v1/truth", "convoy/v1/gps", "convoy/v1/tracking")
    assert heard == list(zip(keys, map(encode, sent), strict=True))
    sink.flush()
    assert len(heard) == 3


def test_on_sent_is_called_before_the_bus_has_the_message() -> None:
    bus, heard = listened_to()
    seen: list[tuple[str, bytes, Message]] = []

    def on_sent(topic: Topic, data: bytes, message: Message) -> None:
        assert heard == []
        seen.append((topic.name, data, message))

    sink = BusSink("v1", bus, on_sent)
    pose = gps("v1", 3)
    sink.send(pose)
    assert seen == [("gps", encode(pose), pose)]


def test_a_rehearsal_publishes_the_pose_alone_and_keeps_the_rest() -> None:
    bus, heard = listened_to()
    drives = TakenDown()
    sink = RehearsalSink("v2", bus, drives.listen)
    pose = gps("v2", 0)
    others: list[Message] = [
        truth("v2", 0, 1.0, 0.0),
        tracking("v2", 0),
        health("v2"),
        drive.trajectory("v2", 0),
    ]
    for message in (pose, *others):
        sink.send(message)
    sink.flush()
    assert heard == [("convoy/v2/gps", encode(pose))]
    assert drives.messages == others
