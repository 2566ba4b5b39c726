"""Parts of logs, joined logs, and logs recovered from damaged ones."""

import random
from pathlib import Path
from shutil import copyfile

import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

import scenarios.api as convoy
from scenarios.cli.main import cli
from scenarios.definition.scenario import scenario_from_text
from scenarios.results.log_queries.log_info import info_of
from scenarios.results.log_queries.log_pieces import LogPart, extract, merge_logs, recover_log
from scenarios.results.log_summary import scenario_of, summary_of
from scenarios.runs.stop import Stop
from scenarios.runs.virtual.logged_run import run_virtual
from tests.made.transport.logs import rerun_accepts, rows
from transport.columns import DEVIATION
from transport.log.reader import LogReader
from transport.log.records import LogError
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


def refuse(line: str) -> None:
    pytest.fail(line)


def own_messages(log: Path) -> list[tuple[str, int, bytes]]:
    """Topics, instants of recording and bytes, as MCAP's own reader gives them."""
    return [(channel.topic, row.log_time, row.data) for _, channel, row in rows(log)]


def test_a_time_span_keeps_start_road_scenario_and_its_own_figures(
    log: Path, tmp_path: Path
) -> None:
    piece = tmp_path / "piece.mcap"
    count = extract(log, LogPart(from_s=2.0, to_s=3.0), piece, refuse)
    held = own_messages(piece)
    assert count == len(held)
    start = scenario_of(log).start_at_ns
    within = [row for row in own_messages(log) if start + 2e9 <= row[1] <= start + 3e9]
    assert set(within) <= set(held)
    early = {topic.rpartition("/")[2] for topic, at, _ in set(held) - set(within)}
    assert early == {"start", "road", "path", "box"}
    assert scenario_of(piece).text == scenario_of(log).text
    reader, summary = LogReader(piece), summary_of(piece)
    assert not reader.faults
    assert summary.ran_s == pytest.approx(1.0, abs=0.05)
    assert not summary.holes
    for row, whole in zip(summary.vehicles, summary_of(log).vehicles, strict=True):
        assert (row.cross_track_error_m_max or 0) <= (whole.cross_track_error_m_max or 0)
    assert rerun_accepts(piece)


def test_topics_and_vehicles_are_selected(log: Path, tmp_path: Path) -> None:
    piece = tmp_path / "piece.mcap"
    extract(log, LogPart(topics=["truth"], vehicles=["v1", "v2"]), piece, refuse)
    names = {topic for topic, _, _ in own_messages(piece)}
    assert {name.split("/")[2] for name in names} == {"v1", "v2", "run"}
    kinds = {name.split("/")[3] for name in names}
    assert kinds == {"truth", "deviation", "pose", "transform", "box", "start", "road", "path"}
    assert set(LogReader(piece).columns(["truth"])) == {("v1", "truth"), ("v2", "truth")}
    assert not LogReader(piece).faults
    for part in (LogPart(vehicles=["v9"]), LogPart(topics=["trut"]), LogPart(from_s=3.0, to_s=2.0)):
        with pytest.raises(LogError):
            extract(log, part, tmp_path / "refused.mcap", refuse)
    with pytest.raises(LogError, match="exists"):
        extract(log, LogPart(), piece, refuse)
    assert [path.name for path in tmp_path.iterdir()] == ["piece.mcap"]


def merged(log: Path, folder: Path, parts: list[LogPart]) -> tuple[Path, bool]:
    """Pieces of a log, joined again, and whether they are the whole run."""
    paths = [folder / f"{number}.mcap" for number in range(len(parts))]
    for part, path in zip(parts, paths, strict=True):
        extract(log, part, path, refuse)
    joined = folder / "joined.mcap"
    count, is_whole = merge_logs(paths, joined, refuse)
    assert count == len(own_messages(joined))
    return joined, is_whole


@pytest.mark.parametrize(
    "parts",
    [
        [LogPart(to_s=2.0), LogPart(from_s=1.5, vehicles=["v1", "v2"]), LogPart(from_s=1.5)],
        [LogPart(vehicles=["v1", "v3"]), LogPart(vehicles=["v2"])],
        [LogPart(topics=["gps", "end"]), LogPart(topics=[*{*TOPICS, DEVIATION} - {"gps", "end"}])],
    ],
)
def test_pieces_joined_are_the_whole(log: Path, tmp_path: Path, parts: list[LogPart]) -> None:
    joined, is_whole = merged(log, tmp_path, parts)
    assert is_whole
    assert sorted(own_messages(joined)) == sorted(own_messages(log))
    assert not LogReader(joined).faults
    assert "piece" not in LogReader(joined).metadata()
    assert summary_of(joined) == summary_of(log)


@pytest.mark.parametrize(
    "parts",
    [
        [LogPart(to_s=2.0), LogPart(from_s=2.1)],
        [LogPart(to_s=2.0), LogPart(from_s=2.0, vehicles=["v1", "v2"])],
        [LogPart(topics=["gps", "end"]), LogPart(topics=["truth"])],
        [LogPart(from_s=3.0), LogPart(from_s=3.5)],
    ],
)
def test_pieces_that_lack_a_part_are_joined_to_a_piece(
    log: Path, tmp_path: Path, parts: list[LogPart]
) -> None:
    joined, is_whole = merged(log, tmp_path, parts)
    assert not is_whole
    assert "merged" in LogReader(joined).metadata()["piece"]
    assert summary_of(joined).outcome_line.startswith("PIECE (merged ")


def test_a_piece_joined_with_the_whole_is_the_whole(log: Path, tmp_path: Path) -> None:
    extract(log, LogPart(vehicles=["v2"]), tmp_path / "piece.mcap", refuse)
    joined = tmp_path / "joined.mcap"
    assert merge_logs([tmp_path / "piece.mcap", log], joined, refuse)[1]
    assert summary_of(joined) == summary_of(log)


def test_a_piece_of_a_piece_states_what_both_keep(log: Path, tmp_path: Path) -> None:
    extract(log, LogPart(from_s=1.0, to_s=3.0), tmp_path / "first.mcap", refuse)
    part = LogPart(from_s=0.5, to_s=2.0, vehicles=["v1", "v2"])
    extract(tmp_path / "first.mcap", part, tmp_path / "second.mcap", refuse)
    held = LogReader(tmp_path / "second.mcap").metadata()["piece"]
    assert held == {"from_s": "1", "to_s": "2", "vehicles": "v1,v2"}


READERS = (
    *("report {}", "report {} --html {out}/report.html", "info {}", "export {} --out {out}"),
    *("explain {} --vehicle v2 --at 2.5", "diff {} {whole}", "compare {} {whole} --json"),
    *("compare {whole} {} --json", "note {}", "scenario-from {}", "scenario-from {} --partial"),
)
LACKING = {
    "gps": {"explain": "no decisions of v2", "compare": "holds no true poses of a vehicle"},
}


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("time", LogPart(from_s=2.0, to_s=3.0)),
        ("vehicles", LogPart(vehicles=["v2", "v3"])),
        ("gps", LogPart(topics=["gps"])),
    ],
)
def test_every_reader_takes_a_piece_or_names_what_is_missing(
    log: Path, tmp_path: Path, name: str, part: LogPart
) -> None:
    piece = tmp_path / "piece.mcap"
    extract(log, part, piece, refuse)
    held = ", ".join(f"{key} {value}" for key, value in part.described().items())
    lacking = LACKING.get(name, {}) | {"scenario-from": f"({held}); use the rest"}
    for line in READERS:
        arguments = line.format(piece, whole=log, out=tmp_path / "out").split()
        (tmp_path / "out").mkdir(exist_ok=True)
        done = CliRunner().invoke(cli, arguments, env={"COLUMNS": "200"})
        reported = done.stderr.splitlines()
        if arguments[0] in lacking and "--partial" not in arguments:
            assert done.exit_code == 2, line
            (error,) = reported
            assert error.startswith(f"error: {piece}: ")
            assert lacking[arguments[0]] in error
            continue
        assert done.exit_code == (arguments[0] == "diff"), done.output
        assert len(reported) <= 1
        page = tmp_path / "out/report.html"
        shown = done.output + (page.read_text(encoding="utf-8") if page.exists() else "")
        assert held in shown or arguments[0] == "note", line


def test_python_takes_pieces(log: Path, tmp_path: Path) -> None:
    extract(log, LogPart(topics=["gps"]), tmp_path / "gps.mcap", refuse)
    run = convoy.open(tmp_path / "gps.mcap")
    assert len(run.states) == len(run.texts) == 0
    assert len(run.vehicles["v2"].gps) == 80
    assert "PIECE (topics gps); 3 vehicles, 4.0 s" in repr(run)
    assert "events" not in run.summary.outcome_line
    assert run.summary.links == ()
    with pytest.raises(convoy.Error, match="holds no true poses"):
        run.plot()
    extract(log, LogPart(from_s=2.0, vehicles=["v2"]), tmp_path / "v2.mcap", refuse)
    run = convoy.open(tmp_path / "v2.mcap")
    assert len(run.plot().axes[0].lines) == 1
    assert not any(row.silent_from_s for row in run.summary.vehicles)
    assert [row.missing_poses for row in run.summary.vehicles] == [0, 0, 0]
    (link,) = run.summary.links
    assert (link.sender, link.receiver, link.unrecorded) == ("v1", "v2", 0)
    assert 35 <= link.sent <= 41


def test_logs_of_different_runs_are_not_joined(log: Path, tmp_path: Path) -> None:
    run_virtual(scenario_from_text(SCENARIO, seed=2), tmp_path, Stop())
    with pytest.raises(LogError, match="another run"):
        merge_logs([log, tmp_path / "run.mcap"], tmp_path / "refused.mcap", refuse)


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
    messages = own_messages(log)
    found = []
    for index in summary.chunk_indexes:
        rows_of = [
            row for row in messages if index.message_start_time <= row[1] <= index.message_end_time
        ]
        found.append(
            (index.chunk_start_offset, index.chunk_start_offset + index.chunk_length, rows_of)
        )
    return found


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


def test_a_whole_log_is_recovered_unchanged(log: Path, tmp_path: Path) -> None:
    copyfile(log, tmp_path / "copy.mcap")
    recover_log(tmp_path / "copy.mcap", tmp_path / "same.mcap")
    assert (tmp_path / "same.mcap").read_bytes() == log.read_bytes()
