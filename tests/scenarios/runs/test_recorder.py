import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest

from scenarios.definition.schema.link_tables import LinkTable
from scenarios.runs.observer import OnMessage
from scenarios.runs.recorder import Recorder
from tests.made.scenarios.messages import (
    START,
    at,
    command,
    gps,
    health,
    sent,
    text,
    tracking,
    truth,
)
from tests.made.transport.links import inbox as inbox_of
from tests.made.transport.logs import rows
from transport.codec import encode
from transport.log.reader import LogReader
from transport.log.writer import LogWriter
from transport.topics import RUN_SENDER, TOPIC_OF, key
from vehicles.geometry.geodesy import LocalPlane, Origin
from vehicles.messages import LogText, Message, RunEnd, RunStart

CONVOY = ("v1", "v2")
PLANE = LocalPlane(Origin(30.638, -96.481, 80.0))


class Recorded:
    """A recorder with its log and a listener."""

    def __init__(self, path: Path, *, begun: bool = True, **rates_hz: float) -> None:
        self.path = path
        self.writer = LogWriter(path)
        self.received: list[tuple[int, Message]] = []
        self.recorder = Recorder(
            vehicles=dict.fromkeys(CONVOY, 20.0) | rates_hz,
            plane=PLANE,
            writer=self.writer,
            control_rate_hz=50.0,
            observers=[OnMessage(lambda now, message: self.received.append((now, message)))],
        )
        if begun:
            self.recorder.begin(at(-0.5), START, "trial")
            self.received.clear()

    @property
    def recorded(self) -> int:
        """Messages recorded but for the start."""
        return self.recorder.recorded - 1

    def take(self, messages: Iterable[Message]) -> None:
        for k, message in enumerate(messages):
            self.recorder.accept(key_of(message), encode(message), START + k)

    def logged(self) -> list[tuple[int, str, Message]]:
        self.writer.close()
        return [row for row in LogReader(self.path).messages() if not isinstance(row[2], RunStart)]


@pytest.fixture
def recorded(tmp_path: Path) -> Recorded:
    return Recorded(tmp_path / "run.mcap")


def key_of(message: Message) -> str:
    return key(message.vehicle, TOPIC_OF[type(message)])


SOUND: list[Message] = [
    gps("v1", 0),
    gps("v2", 0),
    truth("v1", 0, 1.0, 2.0),
    tracking("v2", 0, lateral_error_m=0.3, lateral_deviation_m=0.02),
    command("v2", 0),
    health("v1"),
    text("v1", 0, "mode path"),
    gps("v1", 1),
]


POSE = encode(gps("v1", 7))
PADDING = b"\xfa\x7f" + b"\x80\x80\x02" + bytes(0x8000)  # an unknown field of 32 KiB
WRONG: dict[str, tuple[str, bytes, str]] = {
    "rubbish": ("convoy/v1/gps", b"\xff\x00rubbish\xfe", "garbage"),
    "nothing": ("convoy/v1/gps", b"", "garbage"),
    "text": ("convoy/v1/health", b"hello convoy, how are you?", "garbage"),
    "oversized": ("convoy/v1/gps", POSE + PADDING, "oversized"),
    "a megabyte of zeros": ("convoy/v1/gps", bytes(1_000_000), "oversized"),
    "a message of another topic": ("convoy/v1/gps", encode(command("v1", 7)), "garbage"),
    "another vehicle's pose": (
        "convoy/v1/gps",
        encode(gps("v2", 7)),
        "foreign",
    ),
    "a stranger's pose": ("convoy/v1/gps", encode(gps("v9", 7)), "foreign"),
    "a stranger's key": ("convoy/v9/gps", encode(gps("v9", 7)), "unknown"),
    "a topic that is none": ("convoy/v1/weather", POSE, "unknown"),
    "a key below a topic": ("convoy/v1/gps/more", POSE, "unknown"),
    "another root": ("other/v1/gps", POSE, "unknown"),
    "no key": ("", POSE, "unknown"),
    "a repeated message": ("convoy/v1/gps", encode(gps("v1", 0)), "duplicate"),
    "a number used before": ("convoy/v1/gps", encode(gps("v1", 0, speed_mps=9.0)), "duplicate"),
}


@pytest.mark.parametrize("name", WRONG)
def test_invalid_messages_change_only_a_counter(tmp_path: Path, name: str) -> None:
    where, data, counter = WRONG[name]
    disturbed, sound = Recorded(tmp_path / "disturbed.mcap"), Recorded(tmp_path / "sound.mcap")
    for k, message in enumerate(SOUND):
        for one in (disturbed, sound):
            one.recorder.accept(key_of(message), encode(message), START + k)
        disturbed.recorder.accept(where, data, START + k)
    assert disturbed.recorder.rejected == {counter: len(SOUND)}
    assert disturbed.recorded == sound.recorded
    assert disturbed.received == sound.received
    assert disturbed.logged() == sound.logged()
    assert disturbed.path.read_bytes() == sound.path.read_bytes()


def test_a_topic_with_two_writers_is_named(recorded: Recorded) -> None:
    for speed in (8.0, 9.0):
        recorded.take(gps("v1", seq, speed_mps=speed) for seq in range(30))
        assert bool(recorded.recorder.doubled) == (speed == 9.0)
    assert "convoy/v1/gps" in recorded.recorder.doubled


def test_the_run_s_own_messages_are_numbered_and_returned_for_the_bus(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path / "run.mcap", begun=False)
    recorder = recorded.recorder
    started = recorder.begin(at(0.0), at(0.5), "trial")
    recorder.log(at(1.0), "all 2 vehicles are present")
    recorder.log(at(2.0), "the router was out of reach for 1.0 s", "warning")
    ended = recorder.end(at(3.0), "enough", "trial")
    recorded.writer.close()
    logged = list(LogReader(recorded.path).messages())
    assert [(now, vehicle) for now, vehicle, _ in logged] == [
        (at(second), RUN_SENDER) for second in range(4)
    ]
    begin, first, second, end = (message for _, _, message in logged)
    assert begin == RunStart(vehicle="run", seq=0, start_at_ns=at(0.5), run_id="trial")
    assert encode(begin) == started
    assert isinstance(first, LogText)
    assert isinstance(second, LogText)
    assert [(first.seq, first.level), (second.seq, second.level)] == [(0, "info"), (1, "warning")]
    assert end == RunEnd(vehicle="run", seq=0, end_at_ns=at(3.0), reason="enough", run_id="trial")
    assert encode(end) == ended
    assert [message for _, message in recorded.received] == [begin, first, second, end]


def test_no_other_process_sends_for_the_run(recorded: Recorded) -> None:
    data = encode(RunEnd(vehicle=RUN_SENDER, seq=0, end_at_ns=at(1.0), reason="enough"))
    recorded.recorder.accept("convoy/run/end", data, at(1.0))
    assert recorded.recorded == 0
    assert recorded.recorder.rejected == {"reserved": 1}


def test_another_run_s_messages_take_no_number_from_this_run_s(recorded: Recorded) -> None:
    for seconds in (-3600.0, -0.1, 3600.0):
        other = replace(gps("v1", 1), measured_at_ns=at(seconds))
        recorded.recorder.accept("convoy/v1/gps", encode(other), at(0.0))
    recorded.take([gps("v1", 0), gps("v1", 1)])
    assert recorded.recorded == 2
    assert recorded.recorder.rejected == {"early": 2, "future": 1}


def test_a_pose_that_vehicles_refuse_is_refused_by_the_recorder_for_the_same_reason(
    recorded: Recorded,
) -> None:
    """Impossible poses are neither used nor logged."""
    spoilt = [
        replace(gps("v1", 3), speed_mps=180.0),
        replace(gps("v1", 3), latitude_deg=-10.0),
        replace(gps("v1", 3), heading_deg=400.0),
        sent(gps("v1", 9), at(3 / 20)),
    ]
    inbox = inbox_of("v2", {"v1": LinkTable()}, start_at=START, origin=PLANE.origin)
    for pose in spoilt:
        recorded.recorder.accept("convoy/v1/gps", encode(pose), at(0.2))
        inbox.on_bytes("convoy/v1/gps", encode(pose))
    inbox.take(at(0.2))
    assert recorded.recorder.rejected == inbox.rejected
    assert inbox.rejected == {"absurd": 2, "far": 1, "sequence": 1}
    recorded.take([gps("v1", 3)])
    assert recorded.recorded == 1


@pytest.mark.parametrize("number", [1, 40, 2**32, 2**63 - 31])
def test_a_pose_numbered_ahead_of_its_schedule_makes_none_missing(
    recorded: Recorded, number: int
) -> None:
    recorder = recorded.recorder
    for seq in range(30):
        recorder.accept("convoy/v1/gps", encode(gps("v1", seq)), at(seq / 20))
        forged = sent(gps("v1", seq + number), at(seq / 20))
        recorder.accept("convoy/v1/gps", encode(forged), at(seq / 20))
    assert recorder.rejected == {"sequence": 30}
    assert [message.seq for _, message in recorded.received] == list(range(30))


def test_the_recorder_logs_its_refusals(recorded: Recorded) -> None:
    recorded.take(SOUND)
    recorded.recorder.accept("convoy/v1/gps", b"rubbish", at(1.0))
    recorded.recorder.accept("convoy/v9/gps", POSE, at(1.0))
    recorded.recorder.report_health(at(2.0), final=True)
    own = recorded.logged()[-1][2]
    assert own == health(
        RUN_SENDER,
        0,
        seconds=2.0,
        final=True,
        ticks=0,
        received=len(SOUND) + 1,
        rejected_messages=2,
    )


def test_a_text_is_shown_and_logged_without_control_characters(recorded: Recorded) -> None:
    recorded.take([text("v1", 0, "\x1b[2Jgone\n\x07")])
    escaped = text("v1", 0, r"\x1b[2Jgone\n\x07")
    assert [message for _, message in recorded.received] == [escaped]
    recorded.writer.close()
    content = [row[2].data for row in rows(recorded.path)]
    assert not any(b"\x1b[2J" in data or b"\x07" in data[-6:] for data in content)
    assert encode(escaped) in content


def test_a_number_that_is_not_finite_is_refused_as_absurd(recorded: Recorded) -> None:
    recorded.take([truth("v1", 0, math.inf, 0.0)])
    assert recorded.recorder.rejected == {"absurd": 1}


def test_messages_are_logged_counted_and_shown_as_they_came(recorded: Recorded) -> None:
    recorded.take(SOUND)
    assert recorded.recorded == len(SOUND)
    assert not recorded.recorder.rejected
    assert recorded.received == [(START + k, message) for k, message in enumerate(SOUND)]
    assert recorded.logged() == [
        (START + k, message.vehicle, message) for k, message in enumerate(SOUND)
    ]
