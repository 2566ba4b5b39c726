"""Every file call of a repair fails once: the messages that could be read before stay readable."""

from pathlib import Path

import pytest

from tests.made.failing_calls import FAULTS, Fault, failing_calls
from tests.made.transport.logs import write
from transport.log.errors import LogError
from transport.log.mcap_file import McapFile, repair
from transport.log.reader import LogReader


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
