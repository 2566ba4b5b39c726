import math
import os
import random
import signal
import struct
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from mcap.writer import Writer

from tests.made import drive
from transport.codec import encode
from transport.log.mcap_log import LogError, LogReader, LogWriter, repair
from transport.picture import viewer_process
from transport.topics import TOPIC_OF, instant, key
from vehicles.messages import LogText, Message

TICKS = 60


def write(path: Path, ticks: int = TICKS) -> list[tuple[int, Message]]:
    messages = list(drive.drive(ticks))
    with LogWriter(path, library="test") as log:
        log.metadata("convoy", {"scenario": "circle", "seed": "1"})
        log.attach("scenario.toml", "application/toml", b"seed = 1\n")
        for at, message in messages:
            put(log, at, message)
    return messages


def put(log: LogWriter, at: int, message: Message) -> None:
    log.write(TOPIC_OF[type(message)], message.vehicle, encode(message), at, None, message)


def rows(path: Path) -> list[Any]:
    with path.open("rb") as file:
        return list(make_reader(file, validate_crcs=True).iter_messages(log_time_order=False))


def rerun_accepts(path: Path) -> bool:
    check = [str(viewer_process.program()), "mcap", "check", str(path)]
    done = subprocess.run(check, env={**os.environ, "CI": "1"}, capture_output=True, check=False)
    return done.returncode == 0


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    written = write(tmp_path / "run.mcap")
    log = LogReader(tmp_path / "run.mcap")
    assert [(at, message) for at, _, message in log.messages()] == written
    assert all(vehicle == message.vehicle for _, vehicle, message in log.messages())
    assert not log.truncated
    assert log.metadata() == {"convoy": {"scenario": "circle", "seed": "1"}}
    assert log.attachments() == {"scenario.toml": b"seed = 1\n"}
    assert log.vehicles == ("run", "v1", "v2", "v3")


def test_topics_and_vehicles_select(tmp_path: Path) -> None:
    written = write(tmp_path / "run.mcap")
    log = LogReader(tmp_path / "run.mcap")
    chosen = [m for _, _, m in log.messages(topics=("gps", "truth"), vehicles=("v2",))]
    expected = [
        m for _, m in written if m.vehicle == "v2" and TOPIC_OF[type(m)].name in {"gps", "truth"}
    ]
    assert chosen == expected
    assert len(chosen) == TICKS + TICKS // 5


def test_counts_per_channel(tmp_path: Path) -> None:
    written = write(tmp_path / "run.mcap")
    counts = Counter((m.vehicle, TOPIC_OF[type(m)].name) for _, m in written)
    assert LogReader(tmp_path / "run.mcap").counts == counts
    channels = Counter(channel.topic for _, channel, _ in rows(tmp_path / "run.mcap"))
    assert channels["/convoy/v2/truth"] == TICKS
    for twin in ("location", "pose", "transform", "preview"):
        assert channels[f"/convoy/v2/{twin}"] == {"location": 12, "preview": 6}.get(
            twin, TICKS // 4
        )
    assert "/convoy/v1/preview" not in channels


def test_own_bytes_stand_untouched_under_the_key(tmp_path: Path) -> None:
    written = write(tmp_path / "run.mcap")
    own = [row for row in rows(tmp_path / "run.mcap") if row[0].name.startswith("convoy.")]
    assert len(own) == len(written)
    for (at, message), (schema, channel, record) in zip(written, own, strict=True):
        topic = TOPIC_OF[type(message)]
        assert record.data == encode(message)
        assert record.sequence == message.seq
        assert record.log_time == at
        assert record.publish_time == instant(message)
        assert schema.name == f"convoy.{type(message).__name__}"
        assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
        assert channel.topic == "/" + key(message.vehicle, topic)
        assert channel.metadata == {"zenoh_key": key(message.vehicle, topic)}


def test_a_stranger_decodes_the_log_by_the_schemas_in_it(tmp_path: Path) -> None:
    """Nothing but the schemas in the file is used to read it: no module of this project."""
    write(tmp_path / "run.mcap")
    found: dict[str, Any] = {}
    for schema, channel, record in rows(tmp_path / "run.mcap"):
        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
            pool.Add(file)
        kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
        if channel.topic not in found:
            found[channel.topic] = kind.FromString(record.data)
    location = found["/convoy/v1/location"]
    assert (location.latitude, location.longitude, location.altitude) == (48.0, 11.0, 500.0)
    assert location.heading == pytest.approx(1.5 * math.pi)  # westwards, clockwise from north
    assert location.velocity.x == pytest.approx(-drive.SPEED)
    assert location.velocity.y == pytest.approx(0.0, abs=1e-12)
    assert location.timestamp.seconds * 1_000_000_000 + location.timestamp.nanos == drive.START
    pose = found["/convoy/v1/pose"]
    assert pose.frame_id == "map"
    assert (pose.pose.position.x, pose.pose.position.y) == pytest.approx((drive.RADIUS, 0.0))
    half = math.pi / 4  # northwards: a quarter turn about the vertical axis
    assert pose.pose.orientation.z == pytest.approx(math.sin(half))
    assert pose.pose.orientation.w == pytest.approx(math.cos(half))
    transform = found["/convoy/v1/transform"]
    assert (transform.parent_frame_id, transform.child_frame_id) == ("map", "v1")
    assert (transform.translation.x, transform.rotation.z) == (
        pose.pose.position.x,
        pose.pose.orientation.z,
    )
    text = found["/convoy/run/text"]
    assert (text.message, text.level, text.name) == ("off", 3, "run")


def test_preview_poses_lie_on_the_arc(tmp_path: Path) -> None:
    write(tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as file:
        for _, _, record in make_reader(file).iter_messages(topics=["/convoy/v2/preview"]):
            poses = PosesInFrame.FromString(record.data).poses
            assert len(poses) == 5  # 0, 2, 4, 6, 8 m
            for pose in poses[3:]:  # the second arc lies on the circle itself
                distance = math.hypot(pose.position.x, pose.position.y)
                assert distance == pytest.approx(drive.RADIUS, abs=1e-9)
                yaw = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
                tangent = math.atan2(pose.position.y, pose.position.x) + math.pi / 2
                assert math.remainder(yaw - tangent, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_same_writes_give_the_same_bytes(tmp_path: Path) -> None:
    write(tmp_path / "one.mcap")
    write(tmp_path / "two.mcap")
    write(tmp_path / "other.mcap", TICKS + 1)
    one = (tmp_path / "one.mcap").read_bytes()
    assert one == (tmp_path / "two.mcap").read_bytes()
    assert one != (tmp_path / "other.mcap").read_bytes()


def test_log_times_never_go_back(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.mcap") as log:
        for at in (5, 3, 9, 9, 2, 10):
            put(log, drive.START + at, drive.truth("v1", 0))
    recorded = [(record.log_time, channel) for _, channel, record in rows(tmp_path / "run.mcap")]
    assert [at for at, _ in recorded] == sorted(at for at, _ in recorded)
    own = [at - drive.START for at, channel in recorded if channel.topic == "/convoy/v1/truth"]
    assert own == [5, 5, 9, 9, 9, 10]


def test_messages_of_strangers_are_logged_as_they_are(tmp_path: Path) -> None:
    """What is well-formed but nonsense must not bring the recorder down."""
    good = drive.trajectory("v2", 0)
    nonsense: list[Message] = [
        drive.gps("v2", 0, -5),
        LogText(vehicle="v2", seq=2**40, logged_at_ns=0, level="info", text=""),
        _with(good, piece_length_m=(math.nan, math.inf)),
        _with(good, piece_length_m=(1e300, -1.0), decided_at_ns=2**62),
    ]
    with LogWriter(tmp_path / "run.mcap") as log:
        for message in nonsense:
            put(log, drive.START, message)
    read = [encode(message) for _, _, message in LogReader(tmp_path / "run.mcap").messages()]
    assert read == [encode(message) for message in nonsense]


def _with(message: Any, **changes: Any) -> Any:
    values = {name: getattr(message, name) for name in message.__dataclass_fields__}
    return type(message)(**{**values, **changes})


def test_rerun_accepts_the_log(tmp_path: Path) -> None:
    write(tmp_path / "run.mcap")
    assert rerun_accepts(tmp_path / "run.mcap")


def test_what_was_flushed_can_be_read_before_the_end(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    log = LogWriter(path)
    log.metadata("convoy", {"seed": "7"})
    put(log, drive.START, drive.truth("v1", 0))
    log.flush()
    put(log, drive.START + 1, drive.truth("v1", 1))
    reader = LogReader(path)
    assert reader.truncated
    assert [message.seq for _, _, message in reader.messages()] == [0]
    assert reader.metadata() == {"convoy": {"seed": "7"}}
    assert reader.counts == {("v1", "truth"): 1}
    log.close()
    log.close()
    assert [message.seq for _, _, message in LogReader(path).messages()] == [0, 1]


def test_a_log_cut_anywhere_keeps_its_beginning(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    messages = list(drive.drive(TICKS))
    with LogWriter(path) as log:
        for number, (at, message) in enumerate(messages):
            put(log, at, message)
            if number % 100 == 0:
                log.flush()
    whole = path.read_bytes()
    header = whole.index(b"zstandard") + 40
    chance = random.Random(3)
    for cut in sorted(chance.randrange(header, len(whole)) for _ in range(25)):
        broken = tmp_path / "broken.mcap"
        broken.write_bytes(whole[:cut])
        assert repair(broken)
        kept = [row[2].data for row in rows(broken) if row[0].name.startswith("convoy.")]
        assert kept == [encode(message) for _, message in messages[: len(kept)]]
        assert len(kept) % 100 == 1 or len(kept) == len(messages) or not kept
        assert not repair(broken)
        assert {file.name for file in tmp_path.iterdir()} == {"run.mcap", "broken.mcap"}
    assert rerun_accepts(broken)
    assert LogReader(broken).metadata()["repaired"]["messages"].isdigit()


WRITER = """
import os, sys, time
from pathlib import Path
from tests.made import drive
from transport.codec import encode
from transport.log.mcap_log import LogWriter
from transport.topics import TOPICS

log = LogWriter(Path(sys.argv[1]))
log.metadata("convoy", {"seed": "1"})
last = os.open(sys.argv[2], os.O_WRONLY | os.O_CREAT)
flushed = 0
for seq in range(10**9):
    now = time.time_ns()
    pose = drive.gps("v1", seq, now)
    log.write(TOPICS["gps"], "v1", encode(pose), now, None, pose)
    os.pwrite(last, now.to_bytes(8, "little"), 0)
    if now - flushed >= 400_000_000:
        flushed = now
        log.flush()
    time.sleep(0.001)
"""


@pytest.mark.parametrize("moment_s", [0.9, 1.37])
def test_a_killed_recorder_loses_at_most_half_a_second(tmp_path: Path, moment_s: float) -> None:
    path, last = tmp_path / "run.mcap", tmp_path / "last"
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(path), str(last)])
    while not last.exists():
        assert writer.poll() is None
    try:
        writer.wait(moment_s)
    except subprocess.TimeoutExpired:
        writer.send_signal(signal.SIGKILL)
    assert writer.wait() == -signal.SIGKILL
    (last_written,) = struct.unpack("<q", last.read_bytes())
    reader = LogReader(path)
    assert reader.truncated
    before = [message for _, _, message in reader.messages()]
    assert last_written - instant(before[-1]) <= 500_000_000
    assert repair(path)
    repaired = LogReader(path)
    assert not repaired.truncated
    assert [message for _, _, message in repaired.messages()] == before
    assert len(rows(path)) == 2 * len(before)
    assert repaired.metadata() == {
        "convoy": {"seed": "1"},
        "repaired": {"messages": str(2 * len(before))},
    }
    assert rerun_accepts(path)


def test_what_is_no_log_is_refused_in_one_line(tmp_path: Path) -> None:
    cases = {"missing": None, "empty": b"", "garbage": os.urandom(300), "text": b"hello\n"}
    for name, content in cases.items():
        path = tmp_path / f"{name}.mcap"
        if content is not None:
            path.write_bytes(content)
        for attempt in (LogReader, repair):
            with pytest.raises(LogError, match=str(path)) as refused:
                attempt(path)
            assert "\n" not in str(refused.value)


def test_a_log_of_something_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("std.String", "protobuf", b"")
        channel = writer.register_channel("/chatter", "protobuf", schema)
        writer.add_message(channel, 0, b"", 0)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(LogError, match=r"no messages of a convoy.*/convoy/<vehicle>/<topic>"):
        LogReader(path)


def test_a_damaged_chunk_is_named(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write(path)
    content = bytearray(path.read_bytes())
    middle = content.index(b"zstd") + 5000
    content[middle : middle + 8] = b"\0" * 8
    path.write_bytes(content)
    with pytest.raises(LogError, match="damaged"):
        list(LogReader(path).messages())


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot write"):
        LogWriter(tmp_path / "nowhere" / "run.mcap")
