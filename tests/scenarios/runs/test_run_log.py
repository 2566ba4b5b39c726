import errno
from pathlib import Path

import pytest
from mcap.writer import Writer

from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.results.log_summary import METADATA_NAME, summary_of
from scenarios.results.summary import to_json
from scenarios.runs.live import LiveRun
from scenarios.runs.run_log import RunLog
from tests.made.scenarios.messages import START, at, gps, health, tracking, truth
from transport.codec import decode, encode
from transport.log.reader import LogReader
from transport.topics import TOPIC_OF, TOPICS, key
from vehicles.messages import LogText, Message, RunEnd


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("lane_change", ["duration_s=5", "convoy.vehicles=2"], seed=7)


def begun(scenario: Scenario, folder: Path) -> RunLog:
    run = RunLog(scenario, folder, clock="wall", run_id="today", live=LiveRun(scenario))
    run.start(START, START)
    for seq in range(10):
        for name in ("v1", "v2"):
            take(run, gps(name, seq), seq)
            take(run, truth(name, seq, 0.6 * seq - (15.0 if name == "v2" else 0.0), 0.0), seq)
            take(run, tracking(name, seq, lateral_error_m=0.01 * seq), seq)
    return run


def take(run: RunLog, message: Message, seq: int = 0) -> None:
    run.recorder.accept(
        key(message.vehicle, TOPIC_OF[type(message)]), encode(message), at(seq / 20)
    )


def test_a_run_is_a_log_and_a_summary_that_say_the_same(scenario: Scenario, tmp_path: Path) -> None:
    folder = tmp_path / "some" / "folder"
    run = begun(scenario, folder)
    run.end(at(5.0), "")
    summary = run.close(at(5.1))
    assert sorted(path.name for path in folder.iterdir()) == [
        LOG_NAME,
        SUMMARY_NAME,
    ]
    assert (folder / SUMMARY_NAME).read_text(encoding="utf-8") == to_json(summary)
    reader = LogReader(folder / LOG_NAME)
    assert not reader.truncated
    attached = reader.attachments()
    assert attached[SUMMARY_NAME] == (folder / SUMMARY_NAME).read_bytes()
    assert scenario_from_text(attached[ATTACHED_AS].decode()).tables == scenario.tables
    about = reader.metadata()[METADATA_NAME]
    assert about["run_id"] == "today"
    assert (about["scenario"], about["seed"], about["clock"]) == ("lane_change", "7", "wall")
    for package in ("convoy-emulator", "eclipse-zenoh", "mcap", "numpy", "protobuf", "python"):
        assert about[package][0].isdigit()


def test_a_run_with_a_reason_to_end_is_failed(scenario: Scenario, tmp_path: Path) -> None:
    run = begun(scenario, tmp_path)
    run.end(at(2.0), "v2 failed 1.5 s after the start")
    summary = run.close(at(3.0))
    assert (summary.outcome, summary.ran_s) == ("failed", 2.0)
    assert summary.reason == "v2 failed 1.5 s after the start"


def test_last_words_after_the_end_are_recorded_until_it_closes(
    scenario: Scenario, tmp_path: Path
) -> None:
    run = begun(scenario, tmp_path)
    run.end(at(2.0), "stopped by SIGINT")
    take(run, health("v2", seconds=2.1, final=True), 41)
    summary = run.close(at(2.2))
    assert [row.finished for row in summary.vehicles] == [False, True]


def test_a_log_that_is_being_written_can_be_read_up_to_its_last_flush(
    scenario: Scenario, tmp_path: Path
) -> None:
    run = begun(scenario, tmp_path)
    run.flush()
    take(run, gps("v1", 10), 10)
    reader = LogReader(tmp_path / LOG_NAME)
    assert reader.truncated
    assert len(list(reader.messages())) == 1 + 60
    assert ATTACHED_AS in reader.attachments()
    run.end(at(5.0), "")
    run.close(at(5.0))


def test_the_same_run_gives_the_same_bytes(scenario: Scenario, tmp_path: Path) -> None:
    logs = []
    for name in ("one", "other"):
        run = begun(scenario, tmp_path / name)
        run.end(at(5.0), "")
        run.close(at(5.0))
        logs.append((tmp_path / name / LOG_NAME).read_bytes())
    assert logs[0] == logs[1]


@pytest.mark.parametrize(
    ("overrides", "seconds", "reason"),
    [
        ((), 1.2, "v1 → v2 delivered none of 24 poses; v2 refused 24 messages"),
        ((), 0.8, ""),
        (("links.latency_ms=4000",), 4.2, ""),
        (("links.loss_ratio=0.9",), 4.2, ""),
        (("links.outages=[{kind='window', from_s=0, to_s=9}]",), 4.2, ""),
        (("vehicle.v1.transmitter_off=[{from_s=0, to_s=9}]",), 4.2, ""),
    ],
    ids=["clean", "too short", "still in transit", "lossy", "outage", "transmitter off"],
)
def test_a_clean_link_that_delivered_nothing_fails_the_run(
    overrides: tuple[str, ...], seconds: float, reason: str, tmp_path: Path
) -> None:
    requested = load_scenario("lane_change", ["duration_s=5", "convoy.vehicles=2", *overrides])
    run = RunLog(requested, tmp_path, clock="wall", run_id="today", live=LiveRun(requested))
    run.start(START, START)
    for seq in range(round(seconds * 20)):
        for name in ("v1", "v2"):
            take(run, gps(name, seq), seq)
    take(run, health("v2", seconds=seconds, final=True, rejected_messages=24), 100)
    end = decode(TOPICS["end"], run.end(at(5.0), ""))
    assert isinstance(end, RunEnd)
    assert end.reason == run.close(at(5.1)).reason == reason


def test_an_impossible_clock_is_reported_at_once_and_in_the_summary(
    scenario: Scenario, tmp_path: Path
) -> None:
    run = begun(scenario, tmp_path)
    for seq in range(99):
        take(run, truth("v2", 10_000 + seq, 0.0, 0.0), 20)  # 200 s ahead
    run.flush()
    assert not list(LogReader(tmp_path / LOG_NAME).messages({"log"}))
    for seq in range(99, 130):
        take(run, truth("v2", 10_000 + seq, 0.0, 0.0), 20)
    run.flush()
    assert len(list(LogReader(tmp_path / LOG_NAME).messages({"log"}))) == 1
    run.end(at(5.0), "")
    summary = run.close(at(5.1))
    assert summary.warnings == (
        "run: 100 messages of v2 refused as future (measured more than 60 s ahead)."
        " Compare the clocks of both computers.",
    )
    texts = [one for _, _, one in LogReader(tmp_path / LOG_NAME).messages({"log"})]
    assert [text.level for text in texts if isinstance(text, LogText)] == ["alert"]


def test_when_only_the_last_bytes_cannot_be_written_the_log_does_not_say_completed(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_writer: Writer) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    run = begun(scenario, tmp_path)
    run.end(at(5.0), "")
    run.flush()
    monkeypatch.setattr(Writer, "finish", fail)
    summary = run.close(at(5.1))
    assert (summary.outcome, summary.reason.endswith("No space left on device")) == ("failed", True)
    found = summary_of(tmp_path / LOG_NAME)
    assert (found.outcome, found.reason) == ("failed", "the log breaks off")
    assert [row.poses for row in found.vehicles] == [10, 10]


def test_a_run_that_ends_as_planned_is_completed(scenario: Scenario, tmp_path: Path) -> None:
    run = begun(scenario, tmp_path)
    run.end(at(5.3), "")  # final counters come a moment later
    summary = run.close(at(6.0))
    assert (summary.outcome, summary.reason) == ("completed", "")
    assert (summary.duration_s, summary.ran_s) == (5.0, 5.0)
    assert summary.identity.seed == 7
    assert [row.poses for row in summary.vehicles] == [10, 10]


def test_refusals_are_in_the_summary(scenario: Scenario, tmp_path: Path) -> None:
    run = begun(scenario, tmp_path)
    for where, data in (("convoy/v1/gps", b"?"), ("convoy/v7/gps", b"?"), ("convoy/v1/gps", b"!")):
        run.recorder.accept(where, data, at(1.0))
    run.end(at(5.0), "")
    assert run.close(at(5.0)).recorder_rejected_messages == {"garbage": 2, "unknown": 1}
