"""Messages of a log by columns equal those read one by one."""

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.transport import drive
from tests.made.transport.logs import write
from tests.transport.any_messages import any_message
from transport.codec import encode
from transport.columns import Columns
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.log.writer import LogWriter
from transport.topics import TOPIC_OF, TOPICS
from vehicles.messages import Message, RunEnd, Tracking, TruePose

GENERATION_1 = Path(__file__).parents[2] / "golden/logs/generation_1/run.mcap"
INT64_MAX = 2**63 - 1
UNKNOWN_FIELD = b"\xf8\x3f\x01"
"""Field 127, with the number 1."""


def value(columns: Columns, row: int, name: str) -> Any:
    if name in columns.lists:
        offsets, values = columns.lists[name]
        return tuple(values[offsets[row] : offsets[row + 1]].tolist())
    return columns[name].tolist()[row]


def assert_equal(columns: Columns, messages: Sequence[Message]) -> None:
    assert len(columns) == len(messages)
    for name in [field.name for field in fields(messages[0]) if field.name != "vehicle"]:
        for row, message in enumerate(messages):
            read, expected = value(columns, row, name), getattr(message, name)
            assert type(read) is type(expected)
            assert read == expected or (math.isnan(read) and math.isnan(expected))


def compare(path: Path) -> None:
    reader = LogReader(path)
    rows: dict[tuple[str, str], list[tuple[int, Message]]] = {}
    for at, vehicle, message in reader.messages():
        rows.setdefault((vehicle, TOPIC_OF[type(message)].name), []).append((at, message))
    columns = reader.columns(TOPICS)
    assert {key for key, read in columns.items() if len(read)} == set(rows)
    ordered = sorted(
        (at, at_ns)
        for c in columns.values()
        for at, at_ns in zip(c.order, c.logged_at_ns, strict=True)
    )
    assert [at_ns for _, at_ns in ordered] == [at for at, _, _ in reader.messages()]
    for key, messages in rows.items():
        assert columns[key].logged_at_ns.tolist() == [at for at, _ in messages]
        assert_equal(columns[key], [message for _, message in messages])


def test_every_field_of_a_drive(tmp_path: Path) -> None:
    write(tmp_path / "run.mcap")
    compare(tmp_path / "run.mcap")


def test_a_log_of_an_earlier_version_has_defaults() -> None:
    compare(GENERATION_1)


def test_a_damaged_log_has_the_readable_messages(tmp_path: Path) -> None:
    content = bytearray(GENERATION_1.read_bytes())
    content[len(content) // 2] ^= 1
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    assert LogReader(path).damage
    compare(path)


def within_int64(message: Message) -> Message:
    """Counters are read as int64."""
    numbers = {name: getattr(message, name) for name in (f.name for f in fields(message))}
    clamped: dict[str, Any] = {
        k: v & INT64_MAX for k, v in numbers.items() if type(v) is int and v > INT64_MAX
    }
    return replace(message, vehicle="v1", **clamped)


@given(st.lists(any_message.map(within_int64), min_size=1, max_size=8))
def test_any_messages(tmp_path_factory: pytest.TempPathFactory, messages: list[Message]) -> None:
    """Also messages with unknown fields, or with their first field at the end."""
    path = tmp_path_factory.mktemp("any") / "run.mcap"
    with LogWriter(path, library="test") as log:
        for number, message in enumerate(messages):
            data = encode(message)
            first = 2 + len(message.vehicle)
            log.write(
                1, message, data + UNKNOWN_FIELD if number % 2 else data[first:] + data[:first]
            )
            log.write(2, message)
    compare(path)


def test_topics_vehicles_and_a_span_select(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    written = write(path)
    middle = drive.START + drive.TICK * 30
    span = (drive.START, middle)
    selected = ("truth", "trajectory")
    columns = LogReader(path).columns(selected, vehicles=["v2"], span_ns=span)
    assert set(columns) == {("v2", "truth"), ("v2", "trajectory")}
    truth = columns["v2", "truth"]
    expected = [
        m for at, m in written if isinstance(m, TruePose) and m.vehicle == "v2" and at <= middle
    ]
    assert truth["east_m"].tolist() == [message.east_m for message in expected]
    assert truth.at_ns.tolist() == [message.true_at_ns for message in expected]


def test_refused_messages_are_errors(tmp_path: Path) -> None:
    end = RunEnd(vehicle="run", seq=0, end_at_ns=1, reason="")
    tracking = next(m for _, m in drive.drive(60) if isinstance(m, Tracking))
    cases: dict[str, tuple[Message, bytes]] = {
        "cut": (end, encode(end)[:-3]),
        "incomplete": (end, encode(end)[:7]),
        "unknown word": (tracking, encode(replace(tracking, mode="composte"))),  # type: ignore[arg-type]
    }
    for name, (message, data) in cases.items():
        path = tmp_path / f"{name}.mcap"
        with LogWriter(path, library="test") as log:
            log.write(1, message, data)
        reader = LogReader(path)
        with pytest.raises(LogError):
            list(reader.messages())
        with pytest.raises(LogError):
            reader.columns(TOPICS)
