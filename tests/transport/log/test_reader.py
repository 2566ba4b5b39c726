"""What is read back of a log, and which files are refused."""

import os
from collections import Counter
from pathlib import Path

import pytest
from mcap.writer import Writer

from tests.made.transport.logs import TICKS, rows, write
from transport.log.mcap_file import repair
from transport.log.reader import LogReader
from transport.log.records import LogError
from transport.topics import TOPIC_OF


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
