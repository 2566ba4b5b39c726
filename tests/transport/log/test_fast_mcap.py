"""The faster way to write messages: that it is taken, that it changes nothing, and without it."""

from io import BytesIO
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from tests.made.transport import drive
from tests.made.transport.logs import put, rows, write
from tests.made.transport.mcap_package import RenamedWriter
from transport.log import fast_mcap
from transport.log.fast_mcap import FastWriter, new_writer
from transport.log.reader import LogReader
from transport.log.writer import LogWriter

WITHOUT = pytest.mark.parametrize(
    ("name", "instead"),
    [("Writer", RenamedWriter), ("ChunkBuilder", object), ("_CHUNK_ATTRIBUTES", {"renamed"})],
)
"""What another version of the package may do without, by its name in `fast_mcap`."""


def test_the_locked_version_of_the_package_is_written_with_in_the_faster_way(
    tmp_path: Path,
) -> None:
    assert type(new_writer(BytesIO())) is FastWriter
    with LogWriter(tmp_path / "run.mcap") as log:
        assert log.fast


@WITHOUT
def test_without_the_names_that_it_needs_the_package_s_own_writer_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, instead: object
) -> None:
    monkeypatch.setattr(fast_mcap, name, instead)
    assert type(new_writer(BytesIO())) in {Writer, RenamedWriter}
    with LogWriter(tmp_path / "run.mcap") as log:
        assert not log.fast
        put(log, drive.START, drive.truth("v1", 0))
    assert [message.seq for _, _, message in LogReader(tmp_path / "run.mcap").messages()] == [0]


@WITHOUT
def test_both_ways_give_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, instead: object
) -> None:
    fast, slow = tmp_path / "fast.mcap", tmp_path / "slow.mcap"
    write(fast)
    monkeypatch.setattr(fast_mcap, name, instead)
    write(slow)
    assert fast.read_bytes() == slow.read_bytes()
    assert len(rows(fast)) > 900


def test_both_ways_give_the_same_bytes_over_several_chunks_and_flushes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fast, slow = tmp_path / "fast.mcap", tmp_path / "slow.mcap"
    long_drive = list(drive.drive(1200))
    for path in (fast, slow):
        with LogWriter(path, library="test") as log:
            assert log.fast == (path == fast)
            for number, (at, message) in enumerate(long_drive):
                put(log, at, message)
                if number == 700:
                    log.flush()
                    log.flush()
        monkeypatch.setattr(fast_mcap, "Writer", RenamedWriter)
    with fast.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.chunk_count >= 4
    assert fast.read_bytes() == slow.read_bytes()
