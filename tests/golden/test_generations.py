"""All commands read the logs of versions from 0.7.0 on, one for each generation of the schema.

`logs/` has a folder for each generation, with `run.mcap` and `summary.json` of `convoy run`. For a
new generation, add a folder.
"""

import json
import math
import signal
from collections.abc import Iterator
from dataclasses import MISSING, fields
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest
from click.testing import CliRunner
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorSet
from mcap.reader import make_reader

from scenarios.cli.main import cli
from scenarios.results.log_summary import summary_of
from scenarios.results.outcome import with_outcome_line
from scenarios.results.summary import from_json, to_json
from scenarios.runs.node.recorded_vehicle import read_recorded_vehicle
from scenarios.studies.many.losses import read_run
from transport.codec import PROTOBUF
from transport.log.mcap_file import repair
from transport.log.reader import LogReader
from transport.log.writer import LogWriter
from transport.topics import TOPICS
from vehicles.messages import Message

LOGS = sorted((Path(__file__).parent / "logs").iterdir())
KINDS = {kind.__name__: kind for kind in PROTOBUF}


@pytest.fixture(params=LOGS, ids=lambda folder: folder.name)
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A copy, since a review writes its layout next to the log."""
    return Path(copytree(request.param, tmp_path / "golden"))


@pytest.fixture(autouse=True)
def own_signals() -> Iterator[None]:
    """Commands set signal handlers; the test run keeps its own."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def convoy(*arguments: str | Path) -> str:
    done = CliRunner().invoke(cli, list(map(str, arguments)))
    assert done.exit_code == 0, done.output
    return done.stdout


def test_all_messages_are_read(folder: Path) -> None:
    reader = LogReader(folder / "run.mcap")
    assert not reader.damage
    assert not reader.truncated
    kinds = {type(message) for _, _, message in reader.messages()}
    assert kinds == {topic.message for topic in TOPICS.values() if topic.name in _topics(reader)}
    assert sum(1 for _ in reader.messages()) == sum(reader.counts.values())


def _topics(reader: LogReader) -> set[str]:
    return {topic for _, topic in reader.counts}


def test_the_first_generation_has_all_its_topics() -> None:
    assert _topics(LogReader(LOGS[0] / "run.mcap")) == {
        *("gps", "truth", "trajectory", "tracking", "command", "verdict", "health", "log"),
        *("change", "start", "end"),
    }


def _first_values(folder: Path, topic: str, name: str) -> set[object]:
    messages = LogReader(folder / "run.mcap").messages((topic,))
    return {getattr(message, name) for _, _, message in messages}


def test_the_first_generation_has_messages_dropped_and_refused() -> None:
    assert {"loss", "cut"} <= _first_values(LOGS[0], "verdict", "reason")
    assert "distrusted" in _first_values(LOGS[0], "tracking", "predecessor_status")
    assert _first_values(LOGS[0], "health", "rejected_messages") > {0}
    assert {"link", "cut", "gnss", "stall"} <= _first_values(LOGS[0], "change", "kind")


def test_the_summary_is_read(folder: Path) -> None:
    stored = with_outcome_line(from_json((folder / "summary.json").read_text(encoding="utf-8")))
    assert summary_of(folder / "run.mcap") == stored
    assert json.loads(convoy("report", folder, "--json")) == json.loads(to_json(stored))
    assert "v3" in convoy("report", folder)


def test_a_summary_of_another_version_is_read(folder: Path) -> None:
    text = (folder / "summary.json").read_text(encoding="utf-8")
    values: dict[str, Any] = json.loads(text)
    values["later"] = {"nested": [1]}
    for row in values["vehicles"]:
        row["later_m"] = 1.0
        del row["cross_track_error_m_max"], row["distance_m"]
    del values["holes"]
    read = from_json(json.dumps(values))
    assert [row.name for row in read.vehicles] == ["v1", "v2", "v3"]
    assert read.vehicles[1].cross_track_error_m_max is None
    assert math.isnan(read.vehicles[1].distance_m)
    assert read.holes == ()


def test_a_summary_of_a_newer_format_is_refused(folder: Path, tmp_path: Path) -> None:
    values = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    log = tmp_path / "run.mcap"
    with LogWriter(log) as writer:
        writer.write(0, next(LogReader(folder / "run.mcap").messages())[2])
        values["schema"] = "convoy.summary/99"
        writer.attach("summary.json", "application/json", json.dumps(values).encode())
    done = CliRunner().invoke(cli, ["report", str(log)])
    assert (done.exit_code, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"error: {log} ")
    assert "convoy.summary/99" in line


def test_figures_are_computed_from_a_log_that_breaks_off(folder: Path, tmp_path: Path) -> None:
    broken = tmp_path / "run.mcap"
    broken.write_bytes((folder / "run.mcap").read_bytes()[:-20])
    assert repair(broken)  # the summary in a repaired log is ignored
    ours, whole = summary_of(broken), summary_of(folder / "run.mcap")
    assert ours.reason.startswith("the log breaks off")
    for row, recorded in zip(ours.vehicles, whole.vehicles, strict=True):
        assert row.poses == recorded.poses
        assert row.cross_track_error_m_max == recorded.cross_track_error_m_max


def test_a_review_draws_the_log(folder: Path, tmp_path: Path) -> None:
    convoy("review", folder, "--save", tmp_path / "run.rrd")
    assert (tmp_path / "run.rrd").stat().st_size > 0


def test_explain_reads_the_log(folder: Path) -> None:
    answer = json.loads(convoy("explain", folder, "--vehicle", "v3", "--at", "3", "--json"))
    assert {source["sender"] for source in answer["sources"]} == {"v1", "v2"}


def test_laws_are_fitted_to_its_links(folder: Path) -> None:
    fitted = convoy("channel", "fit", folder)
    assert fitted.count("[[link]]") == 4


def truth(log: Path) -> list[tuple[int, str, Message]]:
    return list(LogReader(log).messages(("truth",)))


@pytest.fixture
def again(folder: Path, tmp_path: Path) -> Path:
    """Log of the repeated session."""
    session = tmp_path / "session.toml"
    convoy("scenario-from", folder, "-o", session)
    done = CliRunner().invoke(
        cli, ["run", str(session), "--clock=virtual", "--quiet", f"--out={tmp_path / 'again'}"]
    )
    assert done.exit_code in {0, 1}, done.output  # 1: it breaks a limit, as the recorded run did
    return tmp_path / "again" / "run.mcap"


def test_the_session_is_repeated(folder: Path, again: Path) -> None:
    assert summary_of(again).identity.seed == summary_of(folder / "run.mcap").identity.seed
    assert len(truth(again)) == len(truth(folder / "run.mcap"))


def test_losses_are_ranked_if_the_run_can_be_repeated(
    folder: Path, again: Path, tmp_path: Path
) -> None:
    """A version with other vehicle behaviour reads the log, and refuses to rank its losses."""
    options = ["--workers", "0", "--runs", "10", "--out", str(tmp_path)]
    done = CliRunner().invoke(cli, ["blame", str(folder), *options])
    repeated = truth(again) == truth(folder / "run.mcap")
    assert done.exit_code == (0 if repeated else 2), done.output
    assert read_run(folder / "run.mcap").tables.tables


def drive(folder: Path, out: Path, text: str) -> None:
    """Run two seconds of a scenario that reads the log."""
    file = out / "reader.toml"
    text = text.replace("LOG", str(folder / "run.mcap"))
    file.write_text(f"name = 'reader'\nduration_s = 2.0\n{text}", encoding="utf-8")
    convoy("run", file, "--clock", "virtual", "--quiet", "--out", out / "run")
    assert summary_of(out / "run" / "run.mcap").outcome == "completed"


PATH = "[convoy]\nvehicles = 3\n[path]\nkind = 'trace'\nfile = 'LOG'\n"


@pytest.mark.parametrize(
    "text",
    [
        PATH,
        f"{PATH}[speed]\nlead = 'recorded'\n[vehicle.v2]\nreplay = 'LOG'\nreplay_vehicle = 'v2'\n",
        f"{PATH}[links]\nloss = {{kind = 'log', file = 'LOG'}}\n",
    ],
    ids=["path", "replayed follower", "losses"],
)
def test_the_log_serves_as_path_drive_and_losses(folder: Path, tmp_path: Path, text: str) -> None:
    drive(folder, tmp_path, text)


def test_a_vehicle_is_replayed(folder: Path) -> None:
    recorded = read_recorded_vehicle(folder / "run.mcap", "v2")
    assert {pose.vehicle for pose in recorded.poses} == {"v2"}
    assert len(recorded.truth) == LogReader(folder / "run.mcap").counts["v2", "truth"]


def _schemas(folder: Path) -> dict[str, DescriptorProto]:
    """Descriptions of messages in the log."""
    with (folder / "run.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    files = [
        FileDescriptorSet.FromString(schema.data)
        for schema in summary.schemas.values()
        if schema.encoding == "protobuf"
    ]
    return {
        message.name: message
        for file_set in files
        for file in file_set.file
        if file.package == "convoy"
        for message in file.message_type
    }


def _described(kind: type[Message]) -> DescriptorProto:
    description = DescriptorProto()
    PROTOBUF[kind].DESCRIPTOR.CopyToProto(description)
    return description


@pytest.mark.parametrize("name", KINDS)
def test_the_schema_is_compatible_with_the_log(folder: Path, name: str) -> None:
    """Numbers and types stay, removed numbers are reserved, added fields have a default."""
    old_fields = {field.number: field for field in _schemas(folder)[name].field}
    description = _described(KINDS[name])
    new_fields = {field.number: field for field in description.field}
    reserved = {n for part in description.reserved_range for n in range(part.start, part.end)}
    for number, field in old_fields.items():
        assert number in new_fields or number in reserved, field.name
        if number in new_fields:
            assert _form(new_fields[number]) == _form(field)
    added = {new_fields[number].name for number in new_fields.keys() - old_fields.keys()}
    defaults = {field.name for field in fields(KINDS[name]) if field.default is not MISSING}
    assert added <= defaults


def _form(field: FieldDescriptorProto) -> tuple[str, int, int]:
    return field.name, field.type, field.label
