"""Contents of a written log, and their standard form."""

import resource
from pathlib import Path

import pytest

from tests.made.transport import drive
from tests.made.transport.logs import TICKS, put, rerun_accepts, rows, write
from transport.codec import encode
from transport.log.errors import LogError
from transport.log.mcap_file import repair
from transport.log.reader import LogReader
from transport.log.writer import LogWriter
from transport.topics import TOPIC_OF, key, valid_at
from vehicles.schedule import SECOND


def test_own_bytes_stand_untouched_under_the_key(tmp_path: Path) -> None:
    written = write(tmp_path / "run.mcap")
    own = [row for row in rows(tmp_path / "run.mcap") if row[0].name.startswith("convoy.")]
    assert len(own) == len(written)
    for (at, message), (schema, channel, record) in zip(written, own, strict=True):
        topic = TOPIC_OF[type(message)]
        assert record.data == encode(message)
        assert record.sequence == message.seq
        assert record.log_time == at
        assert record.publish_time == valid_at(message)
        assert schema.name == f"convoy.{type(message).__name__}"
        assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
        assert channel.topic == "/" + key(message.vehicle, topic)
        assert channel.metadata == {"zenoh_key": key(message.vehicle, topic)}


def test_same_writes_give_the_same_bytes(tmp_path: Path) -> None:
    write(tmp_path / "one.mcap")
    write(tmp_path / "two.mcap")
    write(tmp_path / "other.mcap", TICKS + 1)
    first = (tmp_path / "one.mcap").read_bytes()
    assert first == (tmp_path / "two.mcap").read_bytes()
    assert first != (tmp_path / "other.mcap").read_bytes()


def test_flushed_messages_are_readable_before_the_end(tmp_path: Path) -> None:
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


def test_a_log_that_is_there_already_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(LogError, match="exists"):
        LogWriter(path)
    assert path.read_bytes() == b"precious"


@pytest.mark.parametrize("put_another", [False, True])
def test_a_log_that_was_removed_is_missed_at_the_next_flush(
    tmp_path: Path, *, put_another: bool
) -> None:
    path = tmp_path / "run.mcap"
    log = LogWriter(path)
    put(log, drive.START, drive.truth("v1", 0))
    path.unlink()
    if put_another:
        path.write_bytes(b"another")
    with pytest.raises(LogError, match=f"{path}: cannot write the log: "):
        log.flush()
    put(log, drive.START, drive.truth("v1", 1))  # no effect
    log.attach("x", "text/plain", b"")
    log.close()


def cut(path: Path, size: int) -> None:
    with path.open("r+b") as file:
        file.truncate(size)


@pytest.mark.parametrize("kept", [0.0, 0.5, 0.99])
def test_a_log_that_is_truncated_while_it_is_written_is_an_error(
    tmp_path: Path, kept: float
) -> None:
    path = tmp_path / "run.mcap"
    log = LogWriter(path)
    put_and_flush(log, 2 * TICKS)
    log.flush()
    put(log, drive.START + 50 * SECOND, drive.truth("v1", 0))
    cut(path, round(kept * path.stat().st_size))
    with pytest.raises(LogError, match=f"{path}: cannot write the log: "):
        log.close()
    assert log.failure


def put_and_flush(log: LogWriter, ticks: int) -> None:
    for number, (at, message) in enumerate(drive.drive(ticks)):
        put(log, at, message)
        if number % 100 == 0:
            log.flush()


def test_on_a_full_disk_the_log_is_given_up_and_stays_readable(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    limit, never = 150_000, resource.getrlimit(resource.RLIMIT_FSIZE)
    log = LogWriter(path)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, never[1]))
    try:
        with pytest.raises(LogError, match=f"{path}: cannot write the log: File too large"):
            put_and_flush(log, 40 * TICKS)
        log.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, never)
    assert path.stat().st_size <= limit
    assert LogReader(path).truncated
    assert sum(LogReader(path).counts.values()) > 500
    assert repair(path)
    assert rerun_accepts(path)


def test_log_times_never_go_back(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.mcap") as log:
        for at in (5, 3, 9, 9, 2, 10):
            put(log, drive.START + at, drive.truth("v1", 0))
    recorded = [(record.log_time, channel) for _, channel, record in rows(tmp_path / "run.mcap")]
    assert [at for at, _ in recorded] == sorted(at for at, _ in recorded)
    own = [at - drive.START for at, channel in recorded if channel.topic == "/convoy/v1/truth"]
    assert own == [5, 5, 9, 9, 9, 10]
