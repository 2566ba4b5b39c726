from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.results.metrics import Metrics
from scenarios.runs.recorder import Recorder
from tests.made.messages import START, at, command, gps, health, start, text, tracking, truth
from transport.codec import MAX_BYTES, encode
from transport.log.reader import LogReader
from transport.log.writer import LogWriter
from transport.topics import CONDUCTOR, TOPIC_OF, TOPICS, key
from vehicles.messages import LogText, Message, RunEnd, RunStart
from vehicles.schedule import instant

CONVOY = ("v1", "v2")


class Recorded:
    """A recorder with its log, its figures and a listener."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.writer = LogWriter(path)
        self.metrics = Metrics(CONVOY, {("v1", "v2"): {}})
        self.heard: list[tuple[int, Message]] = []
        self.recorder = Recorder(
            vehicles=CONVOY,
            writer=self.writer,
            metrics=self.metrics,
            listeners=[lambda now, message: self.heard.append((now, message))],
        )

    def take(self, messages: Iterable[Message]) -> None:
        for k, message in enumerate(messages):
            self.recorder.accept(key_of(message), encode(message), START + k)

    def logged(self) -> list[tuple[int, str, Message]]:
        self.writer.close()
        return list(LogReader(self.path).messages())


@pytest.fixture
def recorded(tmp_path: Path) -> Recorded:
    return Recorded(tmp_path / "run.mcap")


def key_of(message: Message) -> str:
    return key(message.vehicle, TOPIC_OF[type(message)])


SOUND: list[Message] = [
    gps("v1", 0),
    gps("v2", 0),
    truth("v1", 0, 1.0, 2.0),
    tracking("v2", 0, lateral_error_m=0.3),
    command("v2", 0),
    health("v1"),
    text("v1", 0, "steers along: path"),
    gps("v1", 1),
]


def test_messages_are_logged_counted_and_shown_as_they_came(recorded: Recorded) -> None:
    recorded.take(SOUND)
    assert recorded.recorder.recorded == len(SOUND)
    assert not recorded.recorder.rejected
    assert recorded.heard == [(START + k, message) for k, message in enumerate(SOUND)]
    assert recorded.metrics.summary()["vehicles"][0]["poses"] == 2
    assert recorded.metrics.summary()["vehicles"][1]["lateral_error_m_max"] == 0.3
    assert recorded.logged() == [
        (START + k, message.vehicle, message) for k, message in enumerate(SOUND)
    ]


def test_a_listener_sees_what_is_in_the_figures_already(tmp_path: Path) -> None:
    seen = []
    with LogWriter(tmp_path / "run.mcap") as writer:
        metrics = Metrics(CONVOY, {})
        recorder = Recorder(
            vehicles=CONVOY,
            writer=writer,
            metrics=metrics,
            listeners=[lambda _at, _message: seen.append(metrics.vehicles["v1"].poses)],
        )
        for seq in range(3):
            recorder.accept("convoy/v1/gps", encode(gps("v1", seq)), at(seq))
    assert seen == [1, 2, 3]


POSE = encode(gps("v1", 7))
PADDING = b"\xfa\x7f" + b"\x80\x80\x02" + bytes(0x8000)  # an unknown field of 32 KiB
WRONG: dict[str, tuple[str, bytes, str]] = {
    "rubbish": ("convoy/v1/gps", b"\xff\x00rubbish\xfe", "malformed"),
    "nothing": ("convoy/v1/gps", b"", "malformed"),
    "text": ("convoy/v1/health", b"hello convoy, how are you?", "malformed"),
    "oversized": ("convoy/v1/gps", POSE + PADDING, "malformed"),
    "a megabyte of zeros": ("convoy/v1/gps", bytes(1_000_000), "malformed"),
    "a message of another topic": ("convoy/v1/gps", encode(command("v1", 7)), "malformed"),
    "another vehicle's pose": (
        "convoy/v1/gps",
        encode(gps("v2", 7)),
        "vehicle does not match key",
    ),
    "a stranger's pose": ("convoy/v1/gps", encode(gps("v9", 7)), "vehicle does not match key"),
    "a stranger's key": ("convoy/v9/gps", encode(gps("v9", 7)), "unknown key"),
    "a topic that is none": ("convoy/v1/weather", POSE, "unknown key"),
    "a key below a topic": ("convoy/v1/gps/more", POSE, "unknown key"),
    "another root": ("other/v1/gps", POSE, "unknown key"),
    "no key": ("", POSE, "unknown key"),
    "a repeated message": ("convoy/v1/gps", encode(gps("v1", 0)), "repeated"),
    "a number used before": ("convoy/v1/gps", encode(gps("v1", 0, speed_mps=9.0)), "repeated"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_changes_nothing_but_a_counter(tmp_path: Path, name: str) -> None:
    where, data, counter = WRONG[name]
    disturbed, sound = Recorded(tmp_path / "disturbed.mcap"), Recorded(tmp_path / "sound.mcap")
    for k, message in enumerate(SOUND):
        for one in (disturbed, sound):
            one.recorder.accept(key_of(message), encode(message), START + k)
        disturbed.recorder.accept(where, data, START + k)
    assert disturbed.recorder.rejected == {counter: len(SOUND)}
    assert disturbed.recorder.recorded == sound.recorder.recorded
    assert disturbed.heard == sound.heard
    assert disturbed.metrics.summary() == sound.metrics.summary()
    assert disturbed.logged() == sound.logged()
    assert disturbed.path.read_bytes() == sound.path.read_bytes()


@pytest.mark.parametrize("message", SOUND[:7], ids=lambda message: type(message).__name__)
def test_a_message_cut_anywhere_is_refused(recorded: Recorded, message: Message) -> None:
    whole = encode(message)
    for length in range(len(whole)):
        recorded.recorder.accept(key_of(message), whole[:length], START)
    assert recorded.recorder.recorded == 0
    assert recorded.recorder.rejected == {"malformed": len(whole)}
    recorded.recorder.accept(key_of(message), whole, START)
    assert recorded.recorder.recorded == 1


@given(data=st.binary(max_size=200), topic=st.sampled_from(sorted(TOPICS)))
@settings(max_examples=100)
def test_no_bytes_do_harm(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, topic: str
) -> None:
    one = Recorded(tmp_path_factory.mktemp("logs") / "run.mcap")
    one.recorder.accept(f"convoy/v1/{topic}", data, START)
    assert one.recorder.recorded + one.recorder.rejected.total() == 1
    one.writer.close()


def test_the_largest_message_that_is_accepted(recorded: Recorded) -> None:
    empty = len(encode(text("v1", 0, "")))
    fits = text("v1", 0, "x" * (MAX_BYTES - empty - 1))  # the text's length takes a byte more
    assert len(encode(fits)) == MAX_BYTES
    recorded.take([fits])
    assert recorded.recorder.recorded == 1
    recorded.take([text("v1", 1, fits.text + "x")])
    assert recorded.recorder.rejected == {"malformed": 1}


def test_numbers_count_for_each_vehicle_and_topic_alone(recorded: Recorded) -> None:
    recorded.take([gps("v1", 3), gps("v2", 3), truth("v1", 3, 0.0, 0.0), gps("v1", 2)])
    assert recorded.recorder.recorded == 4


def test_the_run_s_own_messages_are_numbered_and_returned_for_the_bus(recorded: Recorded) -> None:
    recorder = recorded.recorder
    data = recorder.put(RunStart, at(0.0), start_at_ns=at(0.5), run_id="trial")
    recorder.say(at(1.0), "all 2 vehicles are present")
    recorder.say(at(2.0), "the router was out of reach for 1.0 s", "warning")
    recorder.put(RunEnd, at(3.0), end_at_ns=at(3.0), reason="")
    logged = recorded.logged()
    assert [(now, vehicle) for now, vehicle, _ in logged] == [
        (at(second), CONDUCTOR) for second in range(4)
    ]
    begin, first, second, end = (message for _, _, message in logged)
    assert isinstance(begin, RunStart)
    assert encode(begin) == data
    assert (begin.start_at_ns, begin.run_id, begin.seq) == (at(0.5), "trial", 0)
    assert isinstance(first, LogText)
    assert isinstance(second, LogText)
    assert [(first.seq, first.level), (second.seq, second.level)] == [(0, "info"), (1, "warning")]
    assert isinstance(end, RunEnd)
    assert [message for _, message in recorded.heard] == [begin, first, second, end]


def test_the_run_s_own_messages_are_not_taken_again_from_the_bus(recorded: Recorded) -> None:
    data = recorded.recorder.put(RunStart, at(0.0), start_at_ns=START, run_id="trial")
    assert data == encode(start())
    for _ in range(3):
        recorded.recorder.accept("convoy/run/start", data, at(0.1))
    assert recorded.recorder.recorded == 1
    assert recorded.recorder.rejected == {"repeated": 3}


def test_nobody_else_speaks_for_the_run(recorded: Recorded) -> None:
    recorded.recorder.put(RunStart, at(0.0), start_at_ns=START, run_id="trial")
    data = encode(RunEnd(vehicle=CONDUCTOR, seq=0, end_at_ns=at(1.0), reason="enough"))
    recorded.recorder.accept("convoy/run/end", data, at(1.0))
    assert recorded.recorder.recorded == 1
    assert recorded.recorder.rejected == {"in the run's own name": 1}


def test_another_run_s_messages_take_no_number_from_this_run_s(recorded: Recorded) -> None:
    recorded.recorder.valid_from = at(0.0)
    for seconds in (-3600.0, -0.1, 3600.0):
        other = replace(gps("v1", 1), measured_at_ns=at(seconds))
        recorded.recorder.accept("convoy/v1/gps", encode(other), at(0.0))
    recorded.take([gps("v1", 0), gps("v1", 1)])
    assert recorded.recorder.recorded == 2
    assert recorded.recorder.rejected == {"of another run": 3}


def scheduled(recorded: Recorded, *, v1_hz: float = 20.0) -> Recorder:
    """The recorder of a run that has started, of which it knows the GNSS rates."""
    recorded.recorder.gnss_rates_hz = {"v1": v1_hz, "v2": 20.0}
    recorded.recorder.put(RunStart, at(-0.5), start_at_ns=START, run_id="trial")
    return recorded.recorder


@pytest.mark.parametrize("number", [1, 40, 2**32, 2**63 - 1])
def test_a_pose_numbered_ahead_of_its_schedule_makes_none_missing(
    recorded: Recorded, number: int
) -> None:
    recorder = scheduled(recorded)
    for seq in range(30):
        recorder.accept("convoy/v1/gps", encode(gps("v1", seq)), at(seq / 20))
        forged = replace(gps("v1", seq + number), measured_at_ns=at(seq / 20))
        recorder.accept("convoy/v1/gps", encode(forged), at(seq / 20))
    assert recorder.rejected == {"ahead of its schedule": 30}
    row = recorded.metrics.summary()["vehicles"][0]
    assert (row["poses"], row["missing_poses"]) == (30, 0)


@pytest.mark.parametrize("rate_hz", [1.0, 3.0, 7.0, 20.0, 30.0, 99.9])
def test_whoever_keeps_its_schedule_is_never_ahead_of_it(
    recorded: Recorded, rate_hz: float
) -> None:
    recorder = scheduled(recorded, v1_hz=rate_hz)
    for seq in (0, 1, 2, 3, 100, 4711, 1_000_000):
        pose = replace(gps("v1", seq), measured_at_ns=instant(START, seq, rate_hz))
        recorder.accept("convoy/v1/gps", encode(pose), pose.measured_at_ns)
    assert not recorder.rejected
    later = replace(gps("v2", 3), measured_at_ns=at(1.0))  # a receiver may leave numbers out
    recorder.accept("convoy/v2/gps", encode(later), at(1.0))
    assert not recorder.rejected


def test_the_recorder_tells_in_the_log_how_many_it_refused(recorded: Recorded) -> None:
    recorded.take(SOUND)
    recorded.recorder.accept("convoy/v1/gps", b"rubbish", at(1.0))
    recorded.recorder.accept("convoy/v9/gps", POSE, at(1.0))
    recorded.recorder.report_health(at(2.0), final=True)
    own = recorded.logged()[-1][2]
    assert own == health(
        CONDUCTOR, 0, seconds=2.0, final=True, ticks=0, heard=len(SOUND), rejected_messages=2
    )


def test_a_witness_records_as_the_bus_does(tmp_path: Path) -> None:
    """In virtual time messages come with what they say, and need not be decoded again."""
    by_bus, by_witness = Recorded(tmp_path / "bus.mcap"), Recorded(tmp_path / "witness.mcap")
    by_bus.take(SOUND)
    for k, message in enumerate(SOUND):
        topic = TOPIC_OF[type(message)]
        by_witness.recorder.witness(topic, encode(message), message, START + k)
    assert by_witness.heard == by_bus.heard
    assert by_witness.metrics.summary() == by_bus.metrics.summary()
    by_bus.writer.close()
    by_witness.writer.close()
    assert by_witness.path.read_bytes() == by_bus.path.read_bytes()
