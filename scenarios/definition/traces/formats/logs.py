"""MCAP: the log of an earlier run, and positions in files of other programs."""

import contextlib
import json
import math
import struct
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.traces.drive import (
    DAMAGE,
    NOT_A_POSITION,
    DriveTable,
    Floats,
    Ints,
    LeftOut,
    LeftOutRecords,
    TraceError,
)
from vehicles.schedule import SECOND

if TYPE_CHECKING:
    from transport.log.reader import LogReader

MCAP_MAGIC = b"\x89MCAP0\r\n"
GEODETIC = ("LocationFix", "NavSatFix")
PLANE = ("Odometry", "PoseStamped")
"""Messages with latitude, longitude and altitude (deg, m), and with x, y and z (m)."""


class LoggedPosition(NamedTuple):
    """A position at an instant (ns of Unix time), NaN if it cannot be read."""

    at_ns: int
    first: float
    second: float
    height: float
    speed: float = math.nan


def read_mcap(path: Path, vehicle: str | None, topic: str | None) -> DriveTable:
    """Read the GPS poses of a vehicle in the log of a run, or the positions of another file.

    `vehicle` is by default the lead. `topic` may be missing if only one has positions.
    """
    from transport.log.errors import LogError  # noqa: PLC0415
    from transport.log.reader import LogReader  # noqa: PLC0415 - not in a vehicle's process

    try:
        if topic is not None:
            return _read_topic(path, topic, "")
        try:
            log = LogReader(path)
        except LogError as error:
            return _read_topic(path, None, str(error).removeprefix(f"{path}: "))
        return _read_run(log, vehicle)
    except LogError as error:
        raise TraceError(str(error).removeprefix(f"{path}: ")) from error
    except TraceError:
        raise
    except Exception as error:
        raise TraceError("damaged log") from error


def _read_run(log: "LogReader", vehicle: str | None) -> DriveTable:
    senders = [name for name in log.vehicles if log.counts.get((name, "gps"))]
    convoy: dict[str, Any] = {}
    with contextlib.suppress(ValueError):  # a damaged text
        convoy = tomllib.loads(log.attachments().get(ATTACHED_AS, b"").decode()).get("convoy", {})
    name = vehicle or str((convoy.get("names") or senders or ["v1"])[0])
    if name not in senders:
        raise TraceError(f"given vehicle {name}, allowed {', '.join(senders) or 'none'}")
    fields = ("seq", "measured_at_ns", "latitude_deg", "longitude_deg", "altitude_m", "speed_mps")
    read = log.columns(("gps",), vehicles=(name,))[name, "gps"].fields
    order = np.argsort(read["measured_at_ns"], kind="stable")
    numbers, times, *values = (read[key][order] for key in fields)
    left_out = LeftOutRecords()
    missing, total = log.missing.get((name, "gps"), (0, 0))
    if log.damage or missing:
        damage = log.damage.removeprefix(f"{log.path}: ")
        holes = f"{missing} of {total} poses of {name} are missing" if missing else ""
        reason = "; ".join(filter(None, (damage, holes)))
        left_out.add(LeftOut(int(numbers[0]) if numbers.size else 0, DAMAGE, reason))
    return _drive(numbers, times, np.array(values), left_out, geodetic=True)


def _read_topic(path: Path, topic: str | None, otherwise: str) -> DriveTable:
    """Read the positions of a topic; `otherwise` is the reason if there are none in the file."""
    from transport.log.errors import LogError  # noqa: PLC0415
    from transport.log.raw_messages import raw_messages  # noqa: PLC0415

    by_topic: dict[tuple[bool, str], list[LoggedPosition]] = {}
    damage = ""
    try:
        for schema, channel, message in raw_messages(path):
            kind = (schema.name if schema else "").replace("/", ".").rpartition(".")[2]
            if kind in GEODETIC + PLANE:
                position = _position(kind, channel.message_encoding, message.data)
                position = position if position.at_ns else position._replace(at_ns=message.log_time)
                by_topic.setdefault((kind in GEODETIC, channel.topic), []).append(position)
    except LogError as error:
        damage = str(error)
    names = ", ".join(sorted(name for _, name in by_topic)) or "none"
    if not by_topic and otherwise:
        raise TraceError(f"{otherwise}; and no {', '.join(GEODETIC + PLANE)}")
    wanted = [key for key in by_topic if key[1] == topic]
    if topic is None:
        wanted = [key for key in by_topic if key[0]] or [*by_topic]
        if len(wanted) > 1:
            raise TraceError(
                f"{len(by_topic)} topics have positions: {names}. Set path.topic to one, or "
                "replay_topic of a replayed vehicle"
            )
    if not wanted:
        raise TraceError(f"given topic {topic}, allowed {names}")
    positions, left_out = by_topic[wanted[0]], LeftOutRecords()
    if damage:
        left_out.add(LeftOut(len(positions) + 1, DAMAGE, damage))
    times = np.array([one.at_ns for one in positions], dtype=np.int64)
    values = np.array([one[1:] for one in positions]).T
    numbers = np.arange(1, times.size + 1)
    drive = _drive(numbers, times, values, left_out, geodetic=wanted[0][0])
    unknown = np.any(~np.isfinite(drive.position), axis=0)
    return drive.without(unknown, NOT_A_POSITION, lambda _: "no position")


def _drive(
    numbers: Ints, times_ns: Ints, values: Floats, left_out: LeftOutRecords, *, geodetic: bool
) -> DriveTable:
    """Return the drive of messages, with times from the first one.

    `values` (4, n) are the position, its height (m) and the speed (m/s).
    """
    zero_ns = int(times_ns[0]) if times_ns.size else 0
    return DriveTable(
        geodetic=geodetic,
        unit="message",
        numbers=numbers.astype(np.int64),
        position=values[:2].astype(np.float64),
        altitude_m=np.where(np.isfinite(values[2]), values[2], math.nan),
        time_s=(times_ns - zero_ns) / SECOND,
        speed_mps=values[3].astype(np.float64),
        clock="unix",
        zero_s=zero_ns / SECOND,
        left_out=left_out,
    )


def _position(kind: str, encoding: str, data: bytes) -> LoggedPosition:
    """Decode the position of a message; NaN if it is unreadable."""
    try:
        if encoding == "json":
            return _of_json(json.loads(data))
        if encoding == "protobuf":
            from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix  # noqa: PLC0415

            fix = LocationFix.FromString(data)
            at = fix.timestamp.ToNanoseconds()
            return LoggedPosition(at, fix.latitude, fix.longitude, fix.altitude)
        return _of_cdr(kind, data)
    except Exception:  # noqa: BLE001 - decoders raise their own
        return LoggedPosition(1, *[math.nan] * 3)


def _of_json(message: dict[str, Any]) -> LoggedPosition:
    stamp = message.get("timestamp") or message.get("header", {}).get("stamp") or {}
    at = int(stamp.get("sec", 0)) * SECOND + int(stamp.get("nsec", stamp.get("nanosec", 0)))
    if "latitude" in message:
        place = [message.get(name) for name in ("latitude", "longitude", "altitude")]
    else:
        pose = message["pose"].get("pose", message["pose"])
        place = [pose["position"].get(axis) for axis in "xyz"]
    return LoggedPosition(at, *(math.nan if value is None else float(value) for value in place))


def _of_cdr(kind: str, data: bytes) -> LoggedPosition:
    """Decode header, the name of a frame or two, the status of a fix, and the position.

    The values of ROS 2 are aligned to their size behind four bytes with their order.
    """
    order, at = "<" if data[1] & 1 else ">", 4

    def take(form: str, size: int) -> tuple[Any, ...]:
        nonlocal at
        at += (4 - at) % size
        values = struct.unpack_from(f"{order}{form}", data, at)
        at += struct.calcsize(f"{order}{form}")
        return values

    sec, nsec = take("iI", 4)
    for _ in range(2 if kind == "Odometry" else 1):
        (length,) = take("I", 4)
        at += length
    if kind == "NavSatFix":
        take("b", 1)
        take("H", 2)
    return LoggedPosition(sec * SECOND + nsec, *take("ddd", 8))
