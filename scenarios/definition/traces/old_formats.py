"""Formats of recorded drives: CSV, GPX, NMEA 0183, and the log of an earlier run.

Each reader returns the points in the order of the file. Invalid lines (failed checksum, truncated
sentence, a cell that is not a number) are skipped and listed; an unusable file raises TraceError.
gpxpy, pynmea2 and mcap are imported where they are needed, so that vehicle processes do not load
them.
"""

import contextlib
import csv
import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import time
from pathlib import Path
from typing import Any

from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.traces.recorded_drive import Clock, TraceError
from vehicles.messages import GpsPose
from vehicles.schedule import SECOND

PLANE_COLUMNS = ("x_m", "y_m")
WGS84_COLUMNS = ("latitude_deg", "longitude_deg")

KNOT = 1852.0 / 3600.0
"""Knot (m/s), the unit of speed in NMEA 0183."""

DAY = 86_400.0
"""Seconds in a day, the period of times in NMEA 0183."""

FIRST_UNIX = 1e9
"""Smallest time (s; September 2001) in a CSV file that is Unix time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedPoint:
    """One recorded point: (x, y) in metres, or (latitude, longitude) in degrees.

    `place` is its place in the file; altitude in m, time in s from any instant, speed in m/s.
    """

    place: str
    position: tuple[float, float]
    altitude: float | None = None
    time: float | None = None
    speed: float | None = None


@dataclass(frozen=True, slots=True)
class DriveOfPoints:
    """Points of a file, `geodetic` or in a plane; `skipped` lists invalid lines.

    With a `clock`, times are absolute and count from `zero` (s) on it.
    """

    geodetic: bool
    points: list[RecordedPoint] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    clock: Clock | None = None
    zero: float = 0.0


def read_csv(text: str) -> DriveOfPoints:
    """Read comma, semicolon or tab separated columns with a header line.

    Positions are x_m, y_m or latitude_deg, longitude_deg; t_s, speed_mps and altitude_m are
    optional. Other columns, empty lines and lines that start with # are ignored.
    """
    lines = ((i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip(" ,;\t"))
    rows = [(number, line) for number, line in lines if not line.startswith("#")]
    header = rows[0][1] if rows else ""
    mark = next((sign for sign in ",;\t" if sign in header), ",")
    names = [name.strip().lower() for name in _cells(header, mark)]
    columns = next((c for c in (WGS84_COLUMNS, PLANE_COLUMNS) if set(c) <= set(names)), None)
    if columns is None:
        needed = " or ".join(", ".join(pair) for pair in (PLANE_COLUMNS, WGS84_COLUMNS))
        given = ", ".join(names)[:60].encode("unicode_escape").decode()
        raise TraceError(f"no usable columns: given {given or 'none'}, allowed {needed}")
    drive = DriveOfPoints(geodetic=columns is WGS84_COLUMNS)
    used = (*columns, *(c for c in ("altitude_m", "t_s", "speed_mps") if c in names))
    for number, line in rows[1:]:
        try:
            named = dict(zip(names, _cells(line, mark), strict=False))
            values = {column: _number(column, named.get(column, "")) for column in used}
        except ValueError as error:
            drive.skipped.append(f"line {number}: {error}")
        else:
            drive.points.append(_csv_point(f"line {number}", columns, values))
    usual = drive.points[len(drive.points) // 2].time if drive.points else None
    return replace(drive, clock="unix" if usual is not None and usual >= FIRST_UNIX else None)


def _cells(line: str, mark: str) -> list[str]:
    """Split a single line, so that an open quote affects no other line."""
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


def _csv_point(place: str, columns: tuple[str, str], values: Mapping[str, float]) -> RecordedPoint:
    return RecordedPoint(
        place=place,
        position=(values[columns[0]], values[columns[1]]),
        altitude=values.get("altitude_m"),
        time=values.get("t_s"),
        speed=values.get("speed_mps"),
    )


def read_gpx(text: str) -> DriveOfPoints:
    """Read the tracks of a GPX file, or else its routes, or else its waypoints."""
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
    drive = DriveOfPoints(geodetic=True, clock="unix")
    for number, point in enumerate(points, 1):
        place = f"point {number}"
        drive.points.append(
            RecordedPoint(
                place=place,
                position=(point.latitude, point.longitude),
                altitude=point.elevation,
                time=point.time.timestamp() if point.time else None,
                speed=getattr(point, "speed", None),
            )
        )
    return drive


def read_nmea(text: str) -> DriveOfPoints:
    """Read the GGA and RMC sentences of a receiver; both of one instant become one point.

    A sentence needs a checksum and a valid fix; other sentences are ignored. Speed is from RMC.
    Times of day continue over midnight. Raises TraceError without a valid sentence.
    """
    drive = DriveOfPoints(geodetic=True, clock="day")
    points, day, last = drive.points, 0.0, -math.inf
    for place, sentence in _sentences(text, drive.skipped):
        point = _nmea_point(place, sentence)
        if point is None:
            drive.skipped.append(f"{place}: no fix")
            continue
        if point.time is not None:
            day += DAY if point.time + day < last - DAY / 2 else 0.0
            point = replace(point, time=point.time + day)
        if points and point.time is not None and point.time == points[-1].time:
            points[-1] = _merged(points[-1], point)
        else:
            points.append(point)
        last = last if point.time is None else point.time
    if not points:
        reason = f", {drive.skipped[0]}" if drive.skipped else ""
        raise TraceError(f"no valid GGA or RMC sentence{reason}")
    return drive


def _sentences(text: str, skipped: list[str]) -> Iterator[tuple[str, Any]]:
    """Yield the GGA and RMC sentences with their places; invalid ones go to `skipped`."""
    import pynmea2  # noqa: PLC0415 - not in a vehicle's process

    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        try:
            sentence = pynmea2.parse(line.strip(), check=True)
        except pynmea2.SentenceTypeError:
            continue
        except pynmea2.ChecksumError:
            skipped.append(f"line {number}: wrong or missing checksum")
            continue
        except (pynmea2.ParseError, ValueError):
            skipped.append(f"line {number}: not a sentence")
            continue
        if isinstance(sentence, pynmea2.GGA | pynmea2.RMC):
            yield f"line {number}", sentence


def _nmea_point(place: str, sentence: Any) -> RecordedPoint | None:
    """Return position, time and speed of a sentence; None without a valid fix."""
    try:
        if not (sentence.lat and sentence.lon and sentence.is_valid):
            return None
        knots = getattr(sentence, "spd_over_grnd", None)
        return RecordedPoint(
            place=place,
            position=(float(sentence.latitude), float(sentence.longitude)),
            altitude=_height(sentence),
            time=_time_of_day(sentence.timestamp),
            speed=None if knots is None else float(knots) * KNOT,
        )
    except (ValueError, TypeError):  # an invalid number in spite of a correct checksum
        return None


def _height(sentence: Any) -> float | None:
    """Return the height above the ellipsoid (m): above sea level plus the geoid's."""
    if not getattr(sentence, "altitude", None):
        return None
    return float(sentence.altitude) + float(sentence.geo_sep or 0.0)


def _time_of_day(clock: object) -> float | None:
    if not isinstance(clock, time):
        return None
    return clock.hour * 3600.0 + clock.minute * 60.0 + clock.second + clock.microsecond * 1e-6


def _merged(one: RecordedPoint, other: RecordedPoint) -> RecordedPoint:
    """Complete the first point of an instant by the second."""
    return replace(
        one,
        altitude=other.altitude if one.altitude is None else one.altitude,
        speed=other.speed if one.speed is None else one.speed,
    )


def read_log(path: Path, vehicle: str | None) -> DriveOfPoints:
    """Read the GPS poses that `vehicle`, by default the lead, broadcast in an earlier run."""
    from transport.log.records import LogError  # noqa: PLC0415 - not in a vehicle's process

    try:
        result, damage = _poses(path, vehicle)
        poses = sorted(result, key=lambda pose: pose.measured_at_ns)
    except LogError as error:
        raise TraceError(str(error).removeprefix(f"{path}: ")) from error
    except TraceError:
        raise
    except Exception as error:
        raise TraceError("damaged log") from error
    drive = DriveOfPoints(
        geodetic=True,
        skipped=[damage] if damage else [],
        clock="unix",
        zero=poses[0].measured_at_ns / SECOND if poses else 0.0,
    )
    for pose in poses:
        drive.points.append(
            RecordedPoint(
                place=f"message {pose.seq}",
                position=(pose.latitude_deg, pose.longitude_deg),
                altitude=pose.altitude_m,
                time=(pose.measured_at_ns - poses[0].measured_at_ns) / SECOND,
                speed=pose.speed_mps,
            )
        )
    return drive


def _poses(path: Path, vehicle: str | None) -> tuple[list[GpsPose], str]:
    from transport.log.reader import LogReader  # noqa: PLC0415 - not in a vehicle's process

    log = LogReader(path)
    senders = [name for name in log.vehicles if log.counts.get((name, "gps"))]
    name = vehicle or _lead(log.attachments().get(ATTACHED_AS, b""), senders)
    if name not in senders:
        raise TraceError(f"given vehicle {name}, allowed {', '.join(senders) or 'none'}")
    poses = [m for _, _, m in log.messages(("gps",), (name,)) if isinstance(m, GpsPose)]
    return poses, log.damage.removeprefix(f"{path}: ")


def _lead(scenario: bytes, senders: list[str]) -> str:
    """Return the name of the lead of a logged run; without it the first vehicle."""
    convoy: dict[str, Any] = {}
    with contextlib.suppress(ValueError):  # a damaged text
        convoy = tomllib.loads(scenario.decode()).get("convoy", {})
    names = convoy.get("names") or senders[:1] or ["v1"]
    return str(names[0])
