"""The lead's recorded drive: read from any of the formats, checked, and laid into the plane."""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scenarios.definition.errors import Refused
from scenarios.definition.library import TRACES
from scenarios.definition.schema.path import PointsPath, TracePath
from scenarios.definition.schema.tables import OriginTable, ScenarioTables, VehicleTable
from scenarios.definition.traces.cleaning import Cleaned, cleaned
from scenarios.definition.traces.formats import (
    Clock,
    RecordedDrive,
    RecordedPoint,
    TraceError,
    read_csv,
    read_gpx,
    read_log,
    read_nmea,
)
from vehicles.geometry.bridges import lengths
from vehicles.geometry.geodesy import REACH, LocalPlane, Origin
from vehicles.geometry.smoothing import MERGED_NOISE

MAX_BYTES = 200_000_000
"""Larger files are refused: no drive is that long."""

MAX_JUMP = 1000.0
"""A distance (m) from one point to the next that no receiver leaves out."""

LEAST_EXTENT = 1.0
"""Points that all lie within this distance (m) of the first make no path."""

FAR = 10_000.0
"""Coordinates in a plane that begin further from its origin than this (m) are laid at it: so far
out a map's easting and northing are meant, such as UTM's. Where the scenario says where on earth
the origin is, they are as long as the plane reaches."""

CURVATURE_NOISE = 0.004
"""Smoothing leaves so much noise in the curvature (1/m) at most: 0.4 m/s² of lateral acceleration
at 10 m/s."""

ELSEWHERE = 5_000.0
"""A second drive that comes no nearer than this (m) to the start of the lead's is elsewhere."""

MCAP_MAGIC = b"\x89MCAP0\r\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveInPlane:
    """A recorded drive in the east-north plane of `origin` (None: the file has plane coordinates).

    east_m, north_m and, where the file has them for every point, time_s (from the first point
    on, never decreasing) and speed_mps, an entry each per point. `skipped` names the bad lines,
    `remarks` say what was left out, and `place_numbers` where in the file the points stand. With a
    `clock`, the times count from `began_at_s` on it.
    """

    source: str
    clock: Clock | None = None
    began_at_s: float = 0.0
    place_word: str = "point"
    place_numbers: tuple[int, ...] = ()
    noise_m: float = 0.0
    jumping_points: int = 0
    standing_points: int = 0
    remarks: tuple[str, ...] = ()
    origin: Origin | None
    east_m: tuple[float, ...]
    north_m: tuple[float, ...]
    time_s: tuple[float, ...] = ()
    speed_mps: tuple[float, ...] = ()
    skipped: tuple[str, ...] = ()


def with_points(tables: ScenarioTables, folder: Path) -> ScenarioTables:
    """Replace a path that names a trace by its points, and fill in the origin; raises Refused.

    A trace is sought in `folder`, then among the shipped ones. Without an origin in the scenario
    the plane touches the earth at the first point.
    """
    table = tables.path
    given = Origin(**tables.origin.model_dump()) if tables.origin else None
    if isinstance(table, TracePath):
        try:
            trace = read_trace(_file(table.file, folder), origin=given, vehicle=table.vehicle)
        except TraceError as error:
            raise Refused("path.file", str(error)) from error
        given = trace.origin or given
        table = points_of(trace, table)
    if isinstance(table, PointsPath):
        table = _laid_near(table, REACH if tables.origin else FAR)
    return tables.model_copy(update={"origin": _origin_table(given), "path": table})


def with_replays(tables: ScenarioTables, folder_of: Callable[[str], Path]) -> ScenarioTables:
    """Read the drives of the vehicles that are replayed into the lead's plane; raises Refused.

    `folder_of` gives the folder in which the file that a key names is sought.
    """
    read = {
        name: own.model_copy(update={"drive": _second(tables, name, own, folder_of)})
        for name, own in tables.vehicle.items()
        if own.replay is not None and own.drive is None
    }
    return tables.model_copy(update={"vehicle": {**tables.vehicle, **read}}) if read else tables


def _second(
    tables: ScenarioTables, name: str, own: VehicleTable, folder_of: Callable[[str], Path]
) -> PointsPath:
    key, lead = f"vehicle.{name}.replay", tables.path
    origin = Origin(**(tables.origin or OriginTable()).model_dump())
    table = TracePath(kind="trace", file=own.replay or "")
    try:
        trace = read_trace(
            _file(table.file, folder_of(key)), origin=origin, vehicle=own.replay_vehicle
        )
    except TraceError as error:
        raise Refused(key, str(error)) from error
    points = points_of(trace, table)
    if not isinstance(lead, PointsPath):
        return points
    if lead.source and lead.geodetic != (trace.origin is not None):
        kinds = "latitudes" if lead.geodetic else "plane coordinates"
        raise Refused(
            key, f"{table.file}: given in another plane, allowed {kinds} as {lead.source} has"
        )
    if trace.origin is None:
        points = _moved(points, lead.east_offset_m, lead.north_offset_m)
    east, north = lead.east_m[0], lead.north_m[0]
    away = min(
        math.hypot(x - east, y - north) for x, y in zip(points.east_m, points.north_m, strict=True)
    )
    if away > ELSEWHERE:
        raise Refused(
            key,
            f"{table.file}: comes no nearer than {away / 1000.0:.1f} km to the start of the lead's "
            f"path, allowed at most {ELSEWHERE / 1000.0:g} km: is it of the same road?",
        )
    return points


def points_of(trace: DriveInPlane, table: TracePath) -> PointsPath:
    """Return the points that a scenario has in place of a trace.

    Without a width of smoothing it is the usual one, or what their noise needs.
    """
    remarks, smoothing = trace.remarks, table.smoothing_m
    needed = _needed_smoothing(trace)
    if "smoothing_m" not in table.model_fields_set and needed > smoothing:
        smoothing = needed
        remarks = (
            *remarks,
            f"the points scatter by {trace.noise_m:.2g} m, so path.smoothing_m is {needed:g} where "
            f"it is left out, not {table.smoothing_m:g}: tighter curves are cut",
        )
    return PointsPath(
        kind="points",
        source=table.file,
        skipped_lines=len(trace.skipped),
        skipped_first=trace.skipped[0] if trace.skipped else "",
        geodetic=trace.origin is not None,
        remarks=remarks,
        smoothing_m=smoothing,
        **{key: getattr(trace, key) for key in _KEPT},
        **table.model_dump(include={"closed", "laps"}),
    )


def _needed_smoothing(trace: DriveInPlane) -> float:
    """Half width (m) that leaves CURVATURE_NOISE of the points' noise; see `smooth_path`."""
    steps = lengths(np.array((trace.east_m, trace.north_m)))
    moved = steps[steps > 0.0]
    spacing = max(float(np.median(moved)) if moved.size else 0.0, MERGED_NOISE * trace.noise_m)
    kept = 20.0 * trace.noise_m * math.sqrt(spacing) / CURVATURE_NOISE
    return float(math.ceil(math.pow(kept, 0.4)))


_KEPT = (
    "east_m", "north_m", "time_s", "speed_mps", "clock", "began_at_s", "place_word",
    "place_numbers", "noise_m", "jumping_points", "standing_points",
)  # fmt: skip
"""What points have in common with the drive that they are from."""


def _laid_near(table: PointsPath, far: float) -> PointsPath:
    """Subtract from points that begin further than `far` m from the origin where they begin."""
    if not table.east_m or not table.north_m:
        return table
    if math.hypot(table.east_m[0], table.north_m[0]) <= far:
        return table
    moved = _moved(table, float(round(table.east_m[0])), float(round(table.north_m[0])))
    east, north = moved.east_offset_m, moved.north_offset_m
    remark = (
        f"the coordinates begin {math.hypot(east, north) / 1000.0:.0f} km from their origin, so "
        f"the plane has its own: {east:.0f} m are subtracted from all eastings, {north:.0f} m from "
        "all northings"
    )
    return moved.model_copy(update={"remarks": (*table.remarks, remark)})


def _moved(table: PointsPath, east: float, north: float) -> PointsPath:
    """Subtract an offset (m) from points, and keep it."""
    return table.model_copy(
        update={
            "east_m": tuple(x - east for x in table.east_m),
            "north_m": tuple(y - north for y in table.north_m),
            "east_offset_m": table.east_offset_m + east,
            "north_offset_m": table.north_offset_m + north,
        }
    )


def _file(given: str, folder: Path) -> Path:
    own, shipped = folder / given, TRACES / given
    return shipped if _is_file(shipped) and not _is_file(own) else own


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # such as a name that is too long for any file
        return False


def _origin_table(origin: Origin | None) -> OriginTable:
    if origin is None:
        return OriginTable()
    return OriginTable(
        latitude_deg=origin.latitude_deg,
        longitude_deg=origin.longitude_deg,
        altitude_m=origin.altitude_m,
    )


def read_trace(
    path: Path, *, origin: Origin | None = None, vehicle: str | None = None
) -> DriveInPlane:
    """Read the recorded drive at `path` into the plane of `origin`, by default its first point.

    The format is told by the file's name and content. `vehicle` chooses from the log of a run.
    Bad lines are skipped and listed. Raises TraceError, one line that starts with the file.
    """
    try:
        drive = _sifted(_read(path, vehicle))
        _check_order(drive)
        trace = _laid_out(path.name, drive, origin)
        _check_shape(trace)
    except TraceError as error:
        raise TraceError(f"{path}: {error}") from error
    return trace


def _read(path: Path, vehicle: str | None) -> RecordedDrive:
    data = _content(path)
    if data.startswith(MCAP_MAGIC):
        return read_log(path, vehicle)
    if vehicle is not None:
        raise TraceError(f"given vehicle {vehicle}, allowed only for the MCAP log of a run")
    if b"\0" in data:
        raise TraceError("binary data, allowed CSV, GPX, NMEA 0183 or an MCAP log of a run")
    # Bytes that are no text spoil their own line only.
    text = data.decode("utf-8-sig", errors="replace")
    if not text.strip():
        raise TraceError("empty file")
    return _reader(path.suffix.lower(), text)(text)


def _content(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if _is_file(path) and size <= MAX_BYTES:
            return path.read_bytes()
    except FileNotFoundError as error:
        raise TraceError("no such file") from error
    except OSError as error:
        raise TraceError((error.strerror or "cannot be read").lower()) from error
    except ValueError as error:  # a zero byte in its name
        raise TraceError(str(error)) from error
    too_large = f"larger than {MAX_BYTES // 1_000_000} MB"
    raise TraceError(too_large if _is_file(path) else "not a file")


def _reader(suffix: str, text: str) -> Callable[[str], RecordedDrive]:
    by_suffix = {".csv": read_csv, ".gpx": read_gpx, ".nmea": read_nmea}
    if suffix in by_suffix:
        return by_suffix[suffix]
    if text.lstrip().startswith("<"):
        return read_gpx
    return read_nmea if any(line.startswith("$") for line in text.splitlines()) else read_csv


def _sifted(drive: RecordedDrive) -> RecordedDrive:
    """Pass over points that are nowhere on earth, or that alone have no time."""
    sifted = replace(drive, points=[], skipped=list(drive.skipped))
    timed = sum(point.time is not None for point in drive.points)
    mostly_timed = 2 * timed > len(drive.points)
    for point in drive.points:
        if drive.geodetic and not _on_earth(*point.position):
            latitude, longitude = point.position
            sifted.skipped.append(f"{point.place}: latitude {latitude}, longitude {longitude}")
        elif mostly_timed and point.time is None:
            sifted.skipped.append(f"{point.place}: no time")
        else:
            sifted.points.append(point)
    if not sifted.points:
        reason = f", {sifted.skipped[0]}" if sifted.skipped else ""
        raise TraceError(f"no valid point{reason}")
    return sifted


def _on_earth(latitude: float, longitude: float) -> bool:
    return abs(latitude) <= 90.0 and abs(longitude) <= 360.0  # False for NaN, too


def _check_order(drive: RecordedDrive) -> None:
    for before, after in itertools.pairwise(drive.points):
        if before.time is not None and after.time is not None and after.time < before.time:
            back = before.time - after.time
            raise TraceError(f"{after.place}: time runs back by {back:.3f} s")


def _laid_out(source: str, drive: RecordedDrive, origin: Origin | None) -> DriveInPlane:
    points = drive.points
    if drive.geodetic:
        origin = origin or _first_point(points)
        east, north = zip(*_in_plane(points, LocalPlane(origin), origin.altitude_m), strict=True)
    else:
        origin = None
        east, north = zip(*(point.position for point in points), strict=True)
    times = [point.time for point in points if point.time is not None]
    timed = len(times) == len(points)
    left = cleaned(np.array((east, north)), times if timed else ())
    kept, speeds = left.kept, _speeds(points)
    first = times[kept[0]] if timed else 0.0
    stood = sum(one.last - one.first + 1 for one in left.stands)
    return DriveInPlane(
        source=source,
        origin=origin,
        east_m=tuple(left.points[0].tolist()),
        north_m=tuple(left.points[1].tolist()),
        time_s=tuple(times[k] - first for k in kept) if timed else (),
        speed_mps=tuple(_speed_at(left, speeds)) if speeds else (),
        skipped=tuple(drive.skipped),
        clock=drive.clock if timed else None,
        began_at_s=drive.zero + first if timed and drive.clock else 0.0,
        place_word=points[0].place.split()[0],
        place_numbers=tuple(int(points[k].place.split()[1]) for k in kept),
        noise_m=left.noise,
        jumping_points=sum(jump.last - jump.first + 1 for jump in left.jumps),
        standing_points=stood,
        remarks=tuple(_remarks(left, points)),
    )


def _speed_at(left: Cleaned, speeds: tuple[float, ...]) -> Iterator[float]:
    """Give the recorded speeds of the points that are kept: none where the car stands."""
    still = {k for stand in left.stands for k in stand.core}
    return (0.0 if k in still else speeds[k] for k in left.kept)


def _remarks(left: Cleaned, points: list[RecordedPoint]) -> Iterator[str]:
    """Say what jumps and stands were found, and where."""

    def where(k: int) -> str:
        """Where in the file a point is, and how long after the first one that is kept."""
        begun, at = points[left.kept[0]].time, points[k].time
        if begun is None or at is None:
            return points[k].place
        return f"{points[k].place} ({at - begun:.1f} s)"

    if left.jumps:
        count = sum(jump.last - jump.first + 1 for jump in left.jumps)
        worst = max(left.jumps, key=lambda jump: jump.size)
        said = "1 point jumps and is" if count == 1 else f"{count} points jump and are"
        others = f", the first at {where(left.jumps[0].first)}" if count > 1 else ""
        yield f"{said} left out, by {worst.size:.1f} m at {where(worst.first)}{others}"
    for stand in left.stands:
        first, last = stand.core
        begun, ended = points[first].time, points[last].time
        span = f" for {ended - begun:.0f} s" if begun is not None and ended is not None else ""
        count = stand.last - stand.first + 1
        if stand.first == 0:
            begin = where(last)
            yield f"the drive starts at its first movement, at {begin}: {count} points left out"
        elif stand.last == len(points) - 1:
            yield f"the drive ends where it stops, at {where(first)}: {count} points left out"
        else:
            yield f"the car stands{span} from {where(first)} on: {count} points made one place"


def _speeds(points: list[RecordedPoint]) -> tuple[float, ...]:
    """Give a speed per point, where most have one; the others have that of the one before."""
    known = [point.speed for point in points if point.speed is not None]
    if 2 * len(known) <= len(points):
        return ()
    speeds = [known[0]]
    for point in points:
        speeds.append(speeds[-1] if point.speed is None else abs(point.speed))
    return tuple(speeds[1:])


def _first_point(points: list[RecordedPoint]) -> Origin:
    latitude, longitude = points[0].position
    altitude = points[0].altitude or 0.0
    if not abs(latitude) <= 89.0:
        raise TraceError(f"{points[0].place}: latitude {latitude:g} deg, allowed -89 to 89")
    if not -500.0 <= altitude <= 10_000.0:
        raise TraceError(f"{points[0].place}: altitude {altitude:g} m, allowed -500 to 10000")
    return Origin(latitude, (longitude + 180.0) % 360.0 - 180.0, altitude)


def _in_plane(
    points: list[RecordedPoint], plane: LocalPlane, altitude: float
) -> list[tuple[float, float]]:
    """Lay points into the plane at the origin's height, so that noise in height does not matter."""
    places = []
    for point in points:
        try:
            places.append(plane.to_plane(*point.position, altitude))
        except ValueError as error:
            raise TraceError(f"{point.place}: {error}") from error
    return places


def _check_shape(trace: DriveInPlane) -> None:
    places = list(zip(trace.east_m, trace.north_m, strict=True))
    named = [f"{trace.place_word} {number}" for number in trace.place_numbers]
    if len(places) == 1:
        raise TraceError(f"only one valid point, {named[0]}")
    for (before, after), name in zip(itertools.pairwise(places), named[1:], strict=True):
        jump = math.dist(before, after)
        if jump >= MAX_JUMP:
            raise TraceError(f"{name}: {jump / 1000:.1f} km from the point before")
    extent = max(math.dist(places[0], place) for place in places)
    if extent < LEAST_EXTENT:
        raise TraceError(f"all {len(places)} points lie within {extent:.2f} m, so there is no path")
