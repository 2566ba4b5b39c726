"""Reads the positions of MCAP files of other programs: LocationFix and NavSatFix."""

import json
import math
import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.LocationFixes_pb2 import LocationFixes
from google.protobuf.message import DecodeError
from mcap.reader import NonSeekingReader
from mcap.records import Message

from transport.log.errors import LogError
from vehicles.schedule import SECOND

RECORD_BYTES_MAX = 2**28
"""Maximum length of a record; a larger one is damage."""


class RecordedFix(NamedTuple):
    """A position (deg, m) at an instant (ns of Unix time)."""

    at_ns: int
    latitude: float
    longitude: float
    altitude: float


Decoder = Callable[[bytes], Iterable[RecordedFix]]


def fixes_by_topic(path: Path) -> tuple[dict[str, list[RecordedFix | None]], str]:
    """Read the positions of a file by topic, and describe damage in a line.

    A damaged or truncated file is read up to the damage. A message without a time has that of the
    log, and an unreadable message is None.
    """
    fixes: dict[str, list[RecordedFix | None]] = {}
    try:
        with path.open("rb") as file:
            reader = NonSeekingReader(file, record_size_limit=RECORD_BYTES_MAX)
            for schema, channel, message in reader.iter_messages(log_time_order=False):
                name = schema.name.replace("/", ".").rpartition(".")[2] if schema else ""
                if decoder := DECODERS.get((name, channel.message_encoding)):
                    fixes.setdefault(channel.topic, []).extend(_read(decoder, message))
    except OSError as error:
        raise LogError(f"{path}: cannot read the log: {error.strerror}") from error
    except Exception as error:  # noqa: BLE001 - zstandard and struct raise their own
        reason = str(error).partition("\n")[0] or type(error).__name__
        return fixes, f"damaged or truncated, the rest cannot be read: {reason}"
    return fixes, ""


def _read(decoder: Decoder, message: Message) -> list[RecordedFix | None]:
    try:
        return [
            fix if fix.at_ns else fix._replace(at_ns=message.log_time)
            for fix in decoder(message.data)
        ]
    except (ValueError, KeyError, TypeError, AttributeError, DecodeError, struct.error, IndexError):
        return [None]


def _from_protobuf(fixes: Iterable[LocationFix]) -> list[RecordedFix]:
    return [
        RecordedFix(fix.timestamp.ToNanoseconds(), fix.latitude, fix.longitude, fix.altitude)
        for fix in fixes
    ]


def _from_json(data: bytes) -> list[RecordedFix]:
    content, fixes = json.loads(data), []
    for fix in content.get("fixes", [content]):
        stamp = fix.get("timestamp") or fix.get("header", {}).get("stamp") or {}
        nanoseconds = stamp.get("nsec", stamp.get("nanosec", 0))
        at = int(stamp.get("sec", 0)) * SECOND + int(nanoseconds)
        altitude = fix.get("altitude")
        height = math.nan if altitude is None else float(altitude)
        fixes.append(RecordedFix(at, float(fix["latitude"]), float(fix["longitude"]), height))
    return fixes


def _from_ros1(data: bytes) -> list[RecordedFix]:
    """Header: sequence, time and name of a frame; then status, service and the position."""
    _, sec, nsec, length = struct.unpack_from("<IIII", data)
    return [RecordedFix(sec * SECOND + nsec, *struct.unpack_from("<ddd", data, 16 + length + 3))]


def _from_cdr(data: bytes) -> list[RecordedFix]:
    """As in ROS 1, aligned behind the four bytes that state the byte order."""
    order = "<" if data[1] & 1 else ">"
    sec, nsec, length = struct.unpack_from(f"{order}iII", data, 4)
    service_at = (12 + length + 1 + 1) // 2 * 2
    position_at = (service_at + 2 + 7) // 8 * 8
    position = struct.unpack_from(f"{order}ddd", data, 4 + position_at)
    return [RecordedFix(sec * SECOND + nsec, *position)]


DECODERS: dict[tuple[str, str], Decoder] = {
    ("LocationFix", "json"): _from_json,
    ("LocationFix", "protobuf"): lambda data: _from_protobuf([LocationFix.FromString(data)]),
    ("LocationFixes", "json"): _from_json,
    ("LocationFixes", "protobuf"): lambda data: _from_protobuf(
        LocationFixes.FromString(data).fixes
    ),
    ("NavSatFix", "json"): _from_json,
    ("NavSatFix", "ros1"): _from_ros1,
    ("NavSatFix", "cdr"): _from_cdr,
}
"""Decoders by schema and encoding."""
