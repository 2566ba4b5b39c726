"""A log that another process writes is the one that this process would have written."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tests.made.transport import drive
from tests.made.transport.logs import put, rows
from transport.codec import encode
from transport.log.aside.server import serve
from transport.log.aside.writer import AsideWriter
from transport.log.message_log import MessageLog
from transport.log.reader import LogReader
from transport.log.records import LogError
from transport.log.writer import LogWriter
from transport.topics import TOPIC_OF
from vehicles.messages import GpsPose, Message

RATES_HZ = {"truth": 5.0}


def begun(path: Path) -> LogWriter:
    return LogWriter(path, rates_hz=RATES_HZ)


@contextmanager
def aside(path: Path) -> Iterator[tuple[AsideWriter, int]]:
    """The log at `path`, and the number of the process that writes it."""
    theirs, calls = os.pipe()
    answers, saying = os.pipe()
    child = os.fork()
    if not child:
        with suppress(BaseException):
            os.close(calls)
            os.close(answers)
            with os.fdopen(theirs, "rb") as reading, os.fdopen(saying, "wb") as writing:
                serve(partial(begun, path), reading, writing)
        os._exit(0)
    os.close(theirs)
    os.close(saying)
    log = AsideWriter(path, os.fdopen(calls, "wb"), os.fdopen(answers, "rb"))
    try:
        yield log, child
    finally:
        with suppress(LogError):
            log.close()
        with suppress(ChildProcessError):
            os.waitpid(child, 0)


def written(log: MessageLog, count: int = 700) -> None:
    log.metadata("run", {"seed": "1"})
    log.attach("scenario.toml", "application/toml", b"title = 'x'")
    messages: list[Message] = []
    for number in range(count):
        messages += [drive.truth("v1", number), drive.gps("v2", number, drive.START)]
    # Numbers of NumPy's, which nobody should send, are numbers all the same.
    messages.append(replace(drive.truth("v1", count), speed_mps=np.float64(7.5)))
    messages.append(replace(drive.trajectory("v2", 0), sample_east_m=(np.float64(0.5), 1.5)))
    for at, message in enumerate(messages):
        if at % 3:
            put(log, drive.START + at, message)
        else:
            topic = TOPIC_OF[type(message)]
            log.write(topic, message.vehicle, None, drive.START + at, at, message)
        if at % 7 == 0:
            log.write_deviation(drive.START + at, "v2", drive.START, np.float64(0.25), np.nan)
    log.attach("summary.json", "application/json", b"{}")
    log.close()


def test_the_file_is_the_same_to_the_byte(tmp_path: Path) -> None:
    here = begun(tmp_path / "here.mcap")
    written(here)
    with aside(tmp_path / "aside.mcap") as (log, _):
        written(log)
        assert not log.broken
        log.close()  # a second time is harmless
    assert (tmp_path / "aside.mcap").read_bytes() == (tmp_path / "here.mcap").read_bytes()


def test_bytes_without_a_message_are_read(tmp_path: Path) -> None:
    pose = drive.gps("v1", 3, drive.START)
    topic = TOPIC_OF[GpsPose]
    with aside(tmp_path / "run.mcap") as (log, _):
        log.write(topic, "v1", encode(pose), drive.START)
        with pytest.raises(TypeError):
            log.write(topic, "v1", None, drive.START)
    assert [message for _, _, message in LogReader(tmp_path / "run.mcap").messages()] == [pose]


def test_without_a_call_there_is_no_file(tmp_path: Path) -> None:
    with aside(tmp_path / "run.mcap"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_log_that_is_there_already_is_named_at_the_first_call(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"mine")
    with aside(tmp_path / "run.mcap") as (log, _):
        with pytest.raises(LogError, match="never overwritten"):
            log.metadata("run", {})
        assert log.broken
        log.metadata("run", {})  # nothing, like every further call
        put(log, drive.START, drive.truth("v1", 0))
    assert (tmp_path / "run.mcap").read_bytes() == b"mine"


def test_a_file_that_was_removed_is_found_out_at_the_end(tmp_path: Path) -> None:
    with aside(tmp_path / "run.mcap") as (log, _):
        log.metadata("run", {})
        (tmp_path / "run.mcap").unlink()
        put(log, drive.START, drive.truth("v1", 0))
        with pytest.raises(LogError, match="cannot write the log"):
            log.close()


def test_who_finds_the_writing_process_dead_says_so(tmp_path: Path) -> None:
    with aside(tmp_path / "run.mcap") as (log, child):
        log.metadata("run", {})
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        put(log, drive.START, drive.truth("v1", 0))
        with pytest.raises(LogError, match="the process that writes it has ended"):
            log.flush()
        assert log.broken


def test_if_the_caller_dies_the_log_is_completed(tmp_path: Path) -> None:
    with aside(tmp_path / "run.mcap") as (log, child):
        log.metadata("run", {})
        for number in range(300):
            put(log, drive.START, drive.gps("v1", number, drive.START))
        log.flush()
        os.close(log._calls.fileno())  # as the system does with those of a dead process
        os.waitpid(child, 0)
    own = [row for row in rows(tmp_path / "run.mcap") if row[1].topic == "/convoy/v1/gps"]
    assert len(own) == 300
