"""MCAP: the log of an earlier run, and positions in files of other programs."""

import contextlib
import math
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.traces.recorded_drive import (
    DAMAGE,
    NOT_A_POSITION,
    LeftOut,
    LeftOutRecords,
    RecordedDrive,
    TraceError,
)
from vehicles.messages import GpsPose
from vehicles.schedule import SECOND

if TYPE_CHECKING:
    from transport.log.reader import LogReader

MCAP_MAGIC: Final = b"\x89MCAP0\r\n"


def read_mcap(path: Path, vehicle: str | None, topic: str | None) -> RecordedDrive:
    """Read the GPS poses of a vehicle in the log of a run, or the positions of another file.

    `vehicle` is by default the lead. `topic` may be missing if only one has positions.
    """
    from transport.log.errors import LogError  # noqa: PLC0415
    from transport.log.reader import LogReader  # noqa: PLC0415 - not in a vehicle's process

    try:
        if topic is not None:
            return _read_fixes(path, topic, "")
        try:
            log = LogReader(path)
        except LogError as error:
            return _read_fixes(path, None, str(error).removeprefix(f"{path}: "))
        return _read_run(log, vehicle)
    except LogError as error:
        raise TraceError(str(error).removeprefix(f"{path}: ")) from error
    except TraceError:
        raise
    except Exception as error:
        raise TraceError("damaged log") from error


def _read_run(log: "LogReader", vehicle: str | None) -> RecordedDrive:
    senders = [name for name in log.vehicles if log.counts.get((name, "gps"))]
    name = vehicle or _lead(log.attachments().get(ATTACHED_AS, b""), senders)
    if name not in senders:
        raise TraceError(f"given vehicle {name}, allowed {', '.join(senders) or 'none'}")
    poses = [m for _, _, m in log.messages(("gps",), (name,)) if isinstance(m, GpsPose)]
    poses.sort(key=lambda pose: pose.measured_at_ns)
    left_out = LeftOutRecords()
    missing, total = log.missing.get((name, "gps"), (0, 0))
    if log.damage or missing:
        damage = log.damage.removeprefix(f"{log.path}: ")
        holes = f"{missing} of {total} poses of {name} are missing" if missing else ""
        reason = "; ".join(filter(None, (damage, holes)))
        left_out.add(LeftOut(poses[0].seq if poses else 0, DAMAGE, reason))
    rows = [(pose.latitude_deg, pose.longitude_deg, pose.altitude_m) for pose in poses]
    return _drive(
        [pose.seq for pose in poses],
        [pose.measured_at_ns for pose in poses],
        rows,
        [pose.speed_mps for pose in poses],
        left_out,
    )


def _lead(scenario: bytes, senders: list[str]) -> str:
    """Return the name of the lead of a logged run; without it the first vehicle."""
    convoy: dict[str, Any] = {}
    with contextlib.suppress(ValueError):  # a damaged text
        convoy = tomllib.loads(scenario.decode()).get("convoy", {})
    names = convoy.get("names") or senders[:1] or ["v1"]
    return str(names[0])


def _read_fixes(path: Path, topic: str | None, otherwise: str) -> RecordedDrive:
    """Read the positions of a topic; `otherwise` is the reason if there are none in the file."""
    from transport.log.location_fixes import fixes_by_topic  # noqa: PLC0415

    by_topic, damage = fixes_by_topic(path)
    names = ", ".join(sorted(by_topic)) or "none"
    if topic is None and len(by_topic) > 1:
        raise TraceError(
            f"{len(by_topic)} topics have positions: {names}. Set path.topic to one, or "
            "replay_topic of a replayed vehicle"
        )
    if not by_topic and otherwise:
        raise TraceError(f"{otherwise}; and no LocationFix or NavSatFix")
    chosen = next(iter(by_topic)) if topic is None else topic
    if chosen not in by_topic:
        raise TraceError(f"given topic {chosen}, allowed {names}")
    fixes, left_out = by_topic[chosen], LeftOutRecords()
    usable = []
    for number, fix in enumerate(fixes, 1):
        if fix is None or not math.isfinite(fix.latitude + fix.longitude):
            left_out.add(LeftOut(number, NOT_A_POSITION, "no position"))
        else:
            usable.append((number, fix))
    if damage:
        left_out.add(LeftOut(len(fixes) + 1, DAMAGE, damage))
    return _drive(
        [number for number, _ in usable],
        [fix.at_ns for _, fix in usable],
        [(fix.latitude, fix.longitude, fix.altitude) for _, fix in usable],
        [math.nan] * len(usable),
        left_out,
    )


def _drive(
    numbers: list[int],
    times_ns: list[int],
    places: list[tuple[float, float, float]],
    speeds: list[float],
    left_out: LeftOutRecords,
) -> RecordedDrive:
    """Return the drive of messages, with times from the first one."""
    zero_ns = times_ns[0] if times_ns else 0
    latitude, longitude, altitude = np.array(places).reshape(-1, 3).T
    return RecordedDrive(
        geodetic=True,
        unit="message",
        numbers=np.array(numbers, dtype=np.int64),
        position=np.array((latitude, longitude)),
        altitude_m=np.where(np.isfinite(altitude), altitude, math.nan),
        time_s=np.array([(at - zero_ns) / SECOND for at in times_ns]),
        speed_mps=np.array(speeds),
        clock="unix",
        zero_s=zero_ns / SECOND,
        left_out=left_out,
    )
