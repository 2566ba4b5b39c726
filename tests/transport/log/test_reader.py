"""Reading a log, and refused files."""

import os
import random
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from mcap.writer import Writer

from tests.made.transport import drive
from tests.made.transport.logs import TICKS, put, write
from transport.codec import encode
from transport.log.errors import LogError
from transport.log.mcap_file import repair
from transport.log.reader import LogReader
from transport.log.writer import LogWriter
from transport.topics import TOPIC_OF
from vehicles.messages import Message


def test_written_messages_are_read_back(tmp_path: Path) -> None:
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


def test_other_files_are_refused_in_one_line(tmp_path: Path) -> None:
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


def write_chunks(path: Path) -> list[tuple[int, Message]]:
    """Write a drive with a chunk every 0.2 s."""
    messages = list(drive.drive(TICKS))
    with LogWriter(path, library="test") as log:
        log.attach("scenario.toml", "application/toml", b"seed = 1\n")
        for number, (at, message) in enumerate(messages):
            put(log, at, message)
            if number % 150 == 149:
                log.flush()
    return messages


def test_a_damaged_chunk_is_passed_over_and_named(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    written = write_chunks(path)
    content = bytearray(path.read_bytes())
    second = content.index(b"zstd", content.index(b"zstd") + 4)
    content[second + 500] ^= 1
    path.write_bytes(content)
    log = LogReader(path)
    assert [(at, message) for at, _, message in log.messages()] == written[:150] + written[300:]
    assert not log.truncated
    assert log.counts["v2", "truth"] < TICKS
    assert log.attachments() == {"scenario.toml": b"seed = 1\n"}
    assert re.fullmatch(
        rf"{path}: damaged, \d+ bytes cannot be read, "
        rf"from byte {second - 9 - 32} on, between 0\.\d s and 0\.\d s",
        log.damage,
    )


@pytest.mark.campaign(20, 5000)
def test_after_any_damage_the_rest_is_read_or_the_log_refused(
    tmp_path: Path, campaign: int
) -> None:
    """Bits are flipped and the end is cut off at random."""
    path = tmp_path / "run.mcap"
    written = write_chunks(path)
    whole = path.read_bytes()
    known = {at_and_message(at, message) for at, message in written}
    chance = random.Random(5)
    lost = 0
    for _ in range(campaign):
        content = bytearray(whole)
        for _ in range(chance.randrange(4)):
            place = chance.randrange(len(content))
            content[place] ^= 1 << chance.randrange(8)
        if chance.random() < 0.4:
            del content[chance.randrange(len(content)) :]
        path.write_bytes(content)
        log = None
        with suppress_one_line(path):
            log = LogReader(path)
            read = [at_and_message(at, message) for at, _, message in log.messages()]
            log.metadata(), log.attachments()
        if log is None:
            continue
        assert known.issuperset(read)
        assert [at for at, _ in read] == sorted(at for at, _ in read)
        if len(read) < len(written):
            lost += 1
            assert log.truncated or log.damage
        assert "\n" not in log.damage
        if repair(path):
            again = LogReader(path)
            assert not again.truncated
            assert not again.damage
            assert [at_and_message(at, m) for at, _, m in again.messages()] == read
    assert lost


@contextmanager
def suppress_one_line(path: Path) -> Iterator[None]:
    """Check that a log is refused in one line with its name."""
    try:
        yield
    except LogError as error:
        line = str(error)
    else:
        return
    assert str(path) in line
    assert "\n" not in line


def at_and_message(at: int, message: Message) -> tuple[int, bytes]:
    return at, encode(message)
