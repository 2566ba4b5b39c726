"""Truncated logs: their contents and their repair, also if its file calls fail."""

import random
import signal
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from tests.made.failing_calls import FAULTS, Fault, failing_calls
from tests.made.transport import drive
from tests.made.transport.logs import TICKS, put, rerun_accepts, rows, write
from transport.codec import encode
from transport.log.errors import LogError
from transport.log.mcap_file import McapFile, repair
from transport.log.reader import LogReader
from transport.log.writer import LogWriter
from transport.topics import valid_at


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
from tests.made.transport import drive
from transport.log.writer import LogWriter

log = LogWriter(Path(sys.argv[1]))
log.metadata("convoy", {"seed": "1"})
last = os.open(sys.argv[2], os.O_WRONLY | os.O_CREAT)
flushed = 0
for seq in range(10**9):
    now = time.time_ns()
    pose = drive.gps("v1", seq, now)
    log.write(now, pose)
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
    assert last_written - valid_at(before[-1]) <= 500_000_000
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


def interrupted(path: Path, *, damaged: bool) -> bytes:
    """A log that ends within a chunk, and maybe has another chunk that cannot be read."""
    write(path, 100)
    chunks = McapFile(path).chunks
    data = bytearray(path.read_bytes()[: chunks[-1].start + 100])
    if damaged:
        data[(chunks[1].start + chunks[1].end) // 2] ^= 1
    path.write_bytes(data)
    return bytes(data)


def failure_of(log: Path) -> str:
    """Repair a log; return the reason for which it fails."""
    try:
        repair(log)
    except LogError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("damaged", [False, True])
def test_a_repair_that_fails_destroys_nothing(fault: Fault, damaged: bool, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    data = interrupted(log, damaged=damaged)
    before = list(LogReader(log).messages())
    with failing_calls(tmp_path) as calls:
        assert repair(log)
    assert len(calls.made) > 3
    whole = log.read_bytes()
    for number in range(len(calls.made)):
        log.write_bytes(data)
        with failing_calls(tmp_path, number, fault):
            reason = failure_of(log)
        assert [path.name for path in tmp_path.iterdir()] == [log.name]
        assert list(LogReader(log).messages()) == before
        assert reason.startswith(f"{log}: ") or log.read_bytes() == whole
