"""Recorded drives as files hold them: CSV, GPX, and the log of an earlier run of this project.

Each reader returns the samples in the order of the file. A bad line (failed checksum, cut
sentence, a cell that is no number) is passed over and remembered; what makes the whole file
useless raises TraceError. gpxpy and mcap are imported where they are needed, so that a vehicle's
process never holds them.
"""

import contextlib
import csv
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vehicles.messages import GpsPose

SCENARIO_ATTACHMENT = "scenario.toml"
"""Name under which a log holds the scenario of its run."""

PLANE_COLUMNS = ("x_m", "y_m")
WGS84_COLUMNS = ("latitude_deg", "longitude_deg")


class TraceError(ValueError):
    """A recorded drive that cannot be driven, in one line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """One recorded point: (x, y) in metres, or (latitude, longitude) in degrees.

    `place` says where in the file it stands; altitude in m, time in s from anywhere, speed in m/s.
    """

    place: str
    position: tuple[float, float]
    altitude: float | None = None
    time: float | None = None
    speed: float | None = None


@dataclass(frozen=True, slots=True)
class Recording:
    """Samples as recorded, `geodetic` or in a plane; `skipped` says which lines are bad and why."""

    geodetic: bool
    samples: list[Sample] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)


def read_csv(text: str) -> Recording:
    """Read comma, semicolon or tab separated columns with a header line.

    Position is x_m, y_m or latitude_deg, longitude_deg; t_s, speed_mps and altitude_m are used
    where there are such columns, others are ignored. Lines that are empty or start with # too.
    """
    lines = ((i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip(" ,;\t"))
    rows = [(number, line) for number, line in lines if not line.startswith("#")]
    header = rows[0][1] if rows else ""
    mark = next((sign for sign in ",;\t" if sign in header), ",")
    names = [name.strip().lower() for name in _cells(header, mark)]
    columns = next((c for c in (WGS84_COLUMNS, PLANE_COLUMNS) if set(c) <= set(names)), None)
    if columns is None:
        needed = " or ".join(", ".join(pair) for pair in (PLANE_COLUMNS, WGS84_COLUMNS))
        shown = ", ".join(names)[:60].encode("unicode_escape").decode()
        raise TraceError(f"no usable columns: given {shown or 'none'}, allowed {needed}")
    recording = Recording(geodetic=columns is WGS84_COLUMNS)
    used = (*columns, *(c for c in ("altitude_m", "t_s", "speed_mps") if c in names))
    for number, line in rows[1:]:
        try:
            named = dict(zip(names, _cells(line, mark), strict=False))
            values = {column: _number(column, named.get(column, "")) for column in used}
        except ValueError as error:
            recording.skipped.append(f"line {number}: {error}")
        else:
            recording.samples.append(_csv_sample(f"line {number}", columns, values))
    return recording


def _cells(line: str, mark: str) -> list[str]:
    """Split one line, on its own: a quote that is never closed spoils no other line."""
    try:
        return next(csv.reader([line], delimiter=mark))
    except csv.Error as error:
        raise ValueError(str(error)) from error


def _number(column: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{column} is {cell.strip()[:20]!r}")
    return value


def _csv_sample(place: str, columns: tuple[str, str], values: Mapping[str, float]) -> Sample:
    return Sample(
        place=place,
        position=(values[columns[0]], values[columns[1]]),
        altitude=values.get("altitude_m"),
        time=values.get("t_s"),
        speed=values.get("speed_mps"),
    )


def read_gpx(text: str) -> Recording:
    """Read the tracks of a GPX file, or its routes, or its waypoints, whichever come first."""
    from gpxpy import parse  # noqa: PLC0415 - not in a vehicle's process
    from gpxpy.gpx import GPXException  # noqa: PLC0415

    try:
        gpx = parse(text)
    except (GPXException, ValueError) as error:
        raise TraceError(f"not valid GPX: {str(error).splitlines()[0]}") from error
    tracks = [p for track in gpx.tracks for segment in track.segments for p in segment.points]
    routes = [p for route in gpx.routes for p in route.points]
    points: list[Any] = [*tracks] or [*routes] or [*gpx.waypoints]
    if not points:
        raise TraceError("no points in its tracks, routes and waypoints")
    recording = Recording(geodetic=True)
    for number, point in enumerate(points, 1):
        place = f"point {number}"
        recording.samples.append(
            Sample(
                place=place,
                position=(point.latitude, point.longitude),
                altitude=point.elevation,
                time=point.time.timestamp() if point.time else None,
                speed=getattr(point, "speed", None),
            )
        )
    return recording


def read_log(path: Path, vehicle: str | None) -> Recording:
    """Read the GPS poses that `vehicle`, by default the lead, broadcast in an earlier run."""
    from transport.log.records import LogError  # noqa: PLC0415 - not in a vehicle's process

    try:
        poses = sorted(_poses(path, vehicle), key=lambda pose: pose.measured_at_ns)
    except LogError as error:
        raise TraceError(str(error).removeprefix(f"{path}: ")) from error
    except TraceError:
        raise
    except Exception as error:
        raise TraceError("damaged log") from error
    recording = Recording(geodetic=True)
    for pose in poses:
        recording.samples.append(
            Sample(
                place=f"message {pose.seq}",
                position=(pose.latitude_deg, pose.longitude_deg),
                altitude=pose.altitude_m,
                time=(pose.measured_at_ns - poses[0].measured_at_ns) / 1e9,
                speed=pose.speed_mps,
            )
        )
    return recording


def _poses(path: Path, vehicle: str | None) -> list[GpsPose]:
    from transport.log.reader import LogReader  # noqa: PLC0415 - not in a vehicle's process

    log = LogReader(path)
    senders = [name for name in log.vehicles if log.counts.get((name, "gps"))]
    name = vehicle or _lead(log.attachments().get(SCENARIO_ATTACHMENT, b""), senders)
    if name not in senders:
        raise TraceError(f"given vehicle {name}, allowed {', '.join(senders) or 'none'}")
    return [m for _, _, m in log.messages(("gps",), (name,)) if isinstance(m, GpsPose)]


def _lead(scenario: bytes, senders: list[str]) -> str:
    """Name of the lead of a logged run; the first vehicle where the log does not say."""
    convoy: dict[str, Any] = {}
    with contextlib.suppress(ValueError):  # a damaged text says nothing
        convoy = tomllib.loads(scenario.decode()).get("convoy", {})
    names = convoy.get("names") or senders[:1] or ["v1"]
    return str(names[0])
