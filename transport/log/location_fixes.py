"""Reads the positions of MCAP files of other programs: LocationFix and NavSatFix."""

import json
import math
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.LocationFixes_pb2 import LocationFixes
from google.protobuf.message import DecodeError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader

from transport.log.errors import LogError

SECOND = 1_000_000_000


class RecordedFix(NamedTuple):
    """A position (deg, m) at an instant (ns of Unix time)."""

    at_ns: int
    latitude: float
    longitude: float
    altitude: float


Decoder = Callable[[bytes], Iterator[RecordedFix]]

RECORD_BYTES_MAX = 2**28
"""Maximum length of a record; a larger one is damage."""


def fixes_by_topic(path: Path) -> tuple[dict[str, list[RecordedFix | None]], str]:
    """Read the positions of a file by topic, and describe damage in a line.

    A damaged or truncated file is read up to the damage. A message without a time has that of the
    log, and an unreadable message is None.
    """
    schemas: dict[int, str] = {}
    topics: dict[int, tuple[str, Decoder]] = {}
    fixes: dict[str, list[RecordedFix | None]] = {}
    try:
        with path.open("rb") as file:
            for record in StreamReader(file, record_size_limit=RECORD_BYTES_MAX).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, Channel):
                    decoder = _decoder(schemas.get(record.schema_id, ""), record.message_encoding)
                    if decoder:
                        topics[record.id] = record.topic, decoder
                elif isinstance(record, Message) and record.channel_id in topics:
                    topic, decode = topics[record.channel_id]
                    fixes.setdefault(topic, []).extend(_read(decode, record))
    except OSError as error:
        raise LogError(f"{path}: cannot read the log: {error.strerror}") from error
    except Exception as error:  # noqa: BLE001 - zstandard and struct raise their own
        reason = str(error).partition("\n")[0] or type(error).__name__
        return fixes, f"damaged or truncated, the rest cannot be read: {reason}"
    return fixes, ""


def _read(decode: Decoder, message: Message) -> list[RecordedFix | None]:
    try:
        return [
            fix if fix.at_ns else fix._replace(at_ns=message.log_time)
            for fix in decode(message.data)
        ]
    except (ValueError, KeyError, TypeError, AttributeError, DecodeError, struct.error):
        return [None]


def _decoder(schema: str, encoding: str) -> Decoder | None:
    """Return the decoder of positions, None for other messages."""
    name = schema.rpartition(".")[2].rpartition("/")[2]
    if name not in {"LocationFix", "LocationFixes", "NavSatFix"}:
        return None
    several = name == "LocationFixes"
    decoders: dict[str, Decoder] = {"json": _from_json, "ros1": _from_ros1, "cdr": _from_cdr}
    if name != "NavSatFix":
        decoders = {
            "json": _from_json,
            "protobuf": _all_from_protobuf if several else _from_protobuf,
        }
    return decoders.get(encoding)


def _from_protobuf(data: bytes) -> Iterator[RecordedFix]:
    yield _from_message(LocationFix.FromString(data))


def _all_from_protobuf(data: bytes) -> Iterator[RecordedFix]:
    yield from map(_from_message, LocationFixes.FromString(data).fixes)


def _from_message(message: LocationFix) -> RecordedFix:
    at = message.timestamp.ToNanoseconds()
    return RecordedFix(at, message.latitude, message.longitude, message.altitude)


def _from_json(data: bytes) -> Iterator[RecordedFix]:
    content = json.loads(data)
    for fix in content.get("fixes", [content]):
        stamp = fix.get("timestamp") or fix.get("header", {}).get("stamp") or {}
        nanoseconds = stamp.get("nsec", stamp.get("nanosec", 0))
        altitude = fix.get("altitude")
        yield RecordedFix(
            int(stamp.get("sec", 0)) * SECOND + int(nanoseconds),
            float(fix["latitude"]),
            float(fix["longitude"]),
            math.nan if altitude is None else float(altitude),
        )


def _from_ros1(data: bytes) -> Iterator[RecordedFix]:
    """Header: sequence, time and name of a frame; then status, service and the position."""
    _, sec, nsec, length = struct.unpack_from("<IIII", data)
    yield RecordedFix(sec * SECOND + nsec, *struct.unpack_from("<ddd", data, 16 + length + 3))


def _from_cdr(data: bytes) -> Iterator[RecordedFix]:
    """As in ROS 1, aligned behind the four bytes that state the byte order."""
    order = "<" if data[1] & 1 else ">"
    sec, nsec, length = struct.unpack_from(f"{order}iII", data, 4)
    service_at = (12 + length + 1 + 1) // 2 * 2
    position_at = (service_at + 2 + 7) // 8 * 8
    yield RecordedFix(
        sec * SECOND + nsec, *struct.unpack_from(f"{order}ddd", data, 4 + position_at)
    )
