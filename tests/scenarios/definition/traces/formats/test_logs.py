"""MCAP: positions of other programs; the log of a run is tested with the drives."""

import json
import struct
from collections.abc import Iterable
from pathlib import Path

import pytest
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.LocationFixes_pb2 import LocationFixes
from mcap.writer import CompressionType, Writer

from scenarios.definition.traces.drive import TraceError
from scenarios.definition.traces.formats.logs import read_mcap
from tests.made.scenarios.recorded_drives import drive as made_drive
from tests.made.scenarios.recorded_drives import write_log

START = 1_700_000_000


def place(k: int) -> tuple[float, float, float]:
    return 52.0 + k / 1000, 13.0 + k / 1000, 100.0 + k


def protobuf(k: int) -> LocationFix:
    latitude, longitude, altitude = place(k)
    fix = LocationFix(latitude=latitude, longitude=longitude, altitude=altitude)
    fix.timestamp.seconds, fix.timestamp.nanos = START + k, 500_000_000
    return fix


def as_json(k: int) -> bytes:
    names = ("latitude", "longitude", "altitude")
    stamp = {"sec": START + k, "nsec": 500_000_000}
    return json.dumps({"timestamp": stamp, **dict(zip(names, place(k), strict=True))}).encode()


def as_cdr(k: int, frame: bytes, order: str) -> bytes:
    """NavSatFix of ROS 2: each value is aligned to its size behind the first four bytes."""
    data = struct.pack(f"{order}iII", START + k, 500_000_000, len(frame) + 1) + frame + b"\0"
    data += struct.pack("b", 0)
    data += bytes(-len(data) % 2) + struct.pack(f"{order}H", 1)
    data += bytes(-len(data) % 8) + struct.pack(f"{order}ddd", *place(k)) + bytes(80)
    return (b"\0\1\0\0" if order == "<" else b"\0\0\0\0") + data


def as_ros1(k: int) -> bytes:
    head = struct.pack("<IIII3sbH", k, START + k, 500_000_000, 3, b"gps", 0, 1)
    return head + struct.pack("<ddd", *place(k)) + bytes(73)


def write(
    path: Path, schema: str, encoding: str, messages: Iterable[bytes], topics: Iterable[str]
) -> None:
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, use_chunking=False)
        writer.start()
        number = writer.register_schema(schema, "x", b"")
        for topic in topics:
            channel = writer.register_channel(topic, encoding, number)
            for k, data in enumerate(messages):
                at = (START + k) * 10**9 + 500_000_000
                writer.add_message(channel, log_time=at, publish_time=at, data=data)
        writer.finish()  # type: ignore[no-untyped-call]


KS = range(4)
FIXES = LocationFixes(fixes=[protobuf(k) for k in KS])
UNTIMED = [LocationFix(latitude=p[0], longitude=p[1], altitude=p[2]) for p in map(place, KS)]
KINDS = {
    "protobuf": ("foxglove.LocationFix", [protobuf(k).SerializeToString() for k in KS]),
    "protobuf, times of the log": (
        "foxglove.LocationFix",
        [f.SerializeToString() for f in UNTIMED],
    ),
    "protobuf, several": ("foxglove.LocationFixes", [FIXES.SerializeToString()]),
    "json": ("foxglove.LocationFix", [as_json(k) for k in KS]),
    "json, several": (
        "foxglove.LocationFixes",
        [b'{"fixes": [' + b",".join(as_json(k) for k in KS) + b"]}"],
    ),
    "cdr": ("sensor_msgs/msg/NavSatFix", [as_cdr(k, b"gps_link", "<") for k in KS]),
    "cdr, odd name": ("sensor_msgs/msg/NavSatFix", [as_cdr(k, b"gps", "<") for k in KS]),
    "cdr, no name": ("sensor_msgs/msg/NavSatFix", [as_cdr(k, b"", "<") for k in KS]),
    "cdr, big endian": ("sensor_msgs/msg/NavSatFix", [as_cdr(k, b"map", ">") for k in KS]),
    "ros1": ("sensor_msgs/NavSatFix", [as_ros1(k) for k in KS]),
}


@pytest.mark.parametrize("kind", KINDS)
def test_positions_of_other_programs_are_read(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.mcap"
    schema, messages = KINDS[kind]
    write(path, schema, kind.partition(",")[0], messages, ["/gps"])
    for topic in (None, "/gps"):
        drive = read_mcap(path, None, topic)
        assert list(zip(*drive.position.tolist(), drive.altitude_m.tolist(), strict=True)) == [
            place(k) for k in KS
        ]
        assert drive.time_s.tolist() == [0, 1, 2, 3]
        assert (drive.clock, drive.zero_s, drive.unit) == ("unix", START + 0.5, "message")
        assert drive.left_out.counts.total() == 0


def test_a_topic_is_chosen_if_several_have_positions(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path, "foxglove.LocationFix", "json", map(as_json, KS), ["/front"])
    write(path, "foxglove.LocationFix", "json", list(map(as_json, KS)), ["/front", "/rear"])
    with pytest.raises(TraceError, match=r"2 topics have positions: /front, /rear\..*path\.topic"):
        read_mcap(path, None, None)
    assert read_mcap(path, None, "/rear").count == 4
    with pytest.raises(TraceError, match="given topic /gps, allowed /front, /rear"):
        read_mcap(path, None, "/gps")


def test_a_truncated_file_is_read_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path, "foxglove.LocationFix", "json", map(as_json, KS), ["/gps"])
    content = path.read_bytes()
    path.write_bytes(content[: content.index(as_json(2)) + 5])
    drive = read_mcap(path, None, None)
    assert drive.numbers.tolist() == [1, 2]
    (record,) = drive.left_out.records
    assert (record.number, record.kind) == (3, "damaged")


def test_a_file_without_positions_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path, "foxglove.Log", "json", map(as_json, KS), ["/log"])
    with pytest.raises(TraceError, match="no LocationFix, NavSatFix"):
        read_mcap(path, None, None)


def test_the_log_of_a_run_keeps_its_times(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write_log(path, made_drive()[:5])
    drive = read_mcap(path, "v2", None)
    assert drive.time_s.tolist() == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    assert (drive.zero_s, drive.clock, drive.unit) == (START, "unix", "message")
    assert drive.speed_mps.tolist() == [12.0] * 5
    with pytest.raises(TraceError, match="given vehicle v9, allowed v1, v2"):
        read_mcap(path, "v9", None)
    assert read_mcap(path, None, "/convoy/v2/location").count == 5
