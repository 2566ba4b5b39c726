"""Contents of logs, parts of them cut out by other programs, and damaged logs recovered."""

import random
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from scenarios.definition.scenario import scenario_from_text
from scenarios.results.log_info import info_of, recover_log
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.transport.logs import rerun_accepts, rows
from transport.log.reader import LogReader
from transport.topics import TOPICS

SCENARIO = """
name = "part"
duration_s = 4.0
[convoy]
vehicles = 3
gap_m = 7.0
[speed]
set_mps = 10.0
[path]
kind = "segments"
segments = [{ length_m = 10.0 }, { length_m = 60.0, radius_m = 50.0, turn = "left" }]
[links]
loss_ratio = 0.3
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    run_virtual(scenario_from_text(SCENARIO), folder, Stop())
    return folder / "run.mcap"


def own_messages(log: Path) -> list[tuple[str, int, bytes]]:
    """Topics, instants of recording and bytes, as MCAP's own reader gives them."""
    return [(channel.topic, row.log_time, row.data) for _, channel, row in rows(log)]


def test_what_a_log_holds_is_described(log: Path) -> None:
    info = info_of(log)
    counts: dict[str, int] = {}
    for topic, _, _ in own_messages(log):
        counts[topic] = counts.get(topic, 0) + 1
    assert {row.channel: row.messages for row in info.channels} == counts
    assert info.messages == sum(counts.values())
    assert sum(row.bytes for row in info.channels) == sum(len(row[2]) for row in own_messages(log))
    truth = next(row for row in info.channels if row.channel == "/convoy/v2/truth")
    assert truth.rate_hz == pytest.approx(50.0)
    assert truth.gap_s_max == pytest.approx(0.02)
    assert truth.missing == 0
    assert info.is_complete
    assert info.identity["scenario"] == "part"
    assert info.bytes == log.stat().st_size


@pytest.mark.campaign(4, 100)
def test_every_message_of_the_chunks_before_a_cut_is_recovered(
    log: Path, tmp_path: Path, campaign: int
) -> None:
    whole, chance = log.read_bytes(), random.Random(5)
    chunks = chunks_of(log)
    for number in range(campaign):
        cut = chance.randrange(chunks[0][1], len(whole) - 40)
        (tmp_path / "cut.mcap").write_bytes(whole[:cut])
        expected = [row for _, end, rows in chunks if end <= cut for row in rows]
        assert recovered(tmp_path, number, "cut.mcap") == sorted(expected)


@pytest.mark.campaign(4, 100)
def test_a_flipped_bit_costs_at_most_its_chunk(log: Path, tmp_path: Path, campaign: int) -> None:
    whole, chance = log.read_bytes(), random.Random(6)
    chunks = chunks_of(log)
    for number in range(campaign):
        place = chance.randrange(8, len(whole))
        flipped = bytearray(whole)
        flipped[place] ^= 1 << chance.randrange(8)
        (tmp_path / "flipped.mcap").write_bytes(flipped)
        expected = {row for start, end, rows in chunks if not start <= place < end for row in rows}
        assert expected <= set(recovered(tmp_path, number, "flipped.mcap"))


Rows = list[tuple[str, int, bytes]]


def chunks_of(log: Path) -> list[tuple[int, int, Rows]]:
    """First byte, end and messages of each chunk, by MCAP's own index and reader."""
    with log.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    topics = {number: channel.topic for number, channel in summary.channels.items()}
    with log.open("rb") as file:
        records = StreamReader(file, emit_chunks=True).records
        chunks = [breakup_chunk(record) for record in records if isinstance(record, Chunk)]
    return [
        (
            index.chunk_start_offset,
            index.chunk_start_offset + index.chunk_length,
            [
                (topics[one.channel_id], one.log_time, one.data)
                for one in chunk
                if isinstance(one, Message)
            ],
        )
        for index, chunk in zip(summary.chunk_indexes, chunks, strict=True)
    ]


def recovered(folder: Path, number: int, name: str) -> Rows:
    output = folder / f"{number}-{name}"
    recover_log(folder / name, output)
    reader = LogReader(output)
    assert not reader.damage
    assert not reader.truncated
    if number == 0:
        assert rerun_accepts(output)
    assert sum(map(len, reader.columns(TOPICS).values())) == sum(reader.counts.values())
    return sorted(own_messages(output))
