"""A recorded drive: read from any format, checked, and projected into the plane."""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scenarios.definition.traces.cleaning import Cleaned, cleaned, without_leaps
from scenarios.definition.traces.old_formats import (
    DriveOfPoints,
    RecordedPoint,
    read_csv,
    read_gpx,
    read_log,
    read_nmea,
)
from scenarios.definition.traces.recorded_drive import Clock, TraceError
from vehicles.geometry.geodesy import LocalPlane, Origin

MAX_BYTES = 200_000_000
"""Largest file of a drive."""

MAX_JUMP = 1000.0
"""Largest distance (m) between two points."""

LEAST_EXTENT = 1.0
"""Smallest extent (m) of a path."""

MCAP_MAGIC = b"\x89MCAP0\r\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveInPlane:
    """A recorded drive in the east-north plane of `origin` (None: the file has plane coordinates).

    `time_s` (from the first point on, never decreasing) and `speed_mps` are empty unless the file
    has them for all points. `skipped` lists invalid lines, `remarks` other changes.
    `source_numbers` are the places of the points in the file. Times count from `epoch_s` on the
    `clock`, or without one on that of the file.
    """

    source: str
    clock: Clock | None = None
    epoch_s: float = 0.0
    source_unit: str = "point"
    source_numbers: tuple[int, ...] = ()
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


def is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # such as a name that is too long for any file
        return False


def read_trace(
    path: Path, *, origin: Origin | None = None, vehicle: str | None = None
) -> DriveInPlane:
    """Read the recorded drive at `path` into the plane of `origin`, by default its first point.

    Name and content of the file determine the format. `vehicle` selects one of a log. Invalid lines
    are skipped and listed. Raises TraceError with a line that starts with the file.
    """
    try:
        drive = _sifted(_read(path, vehicle))
        points, leaping = without_leaps(drive.points)
        drive = replace(drive, points=points, skipped=[*drive.skipped, *leaping])
        _check_order(drive)
        trace = _laid_out(path.name, drive, origin)
        _check_shape(trace)
    except TraceError as error:
        raise TraceError(f"{path}: {error}") from error
    return trace


def _read(path: Path, vehicle: str | None) -> DriveOfPoints:
    data = _content(path)
    if data.startswith(MCAP_MAGIC):
        return read_log(path, vehicle)
    if vehicle is not None:
        raise TraceError(f"given vehicle {vehicle}, allowed only for the MCAP log of a run")
    if b"\0" in data:
        raise TraceError("binary data, allowed CSV, GPX, NMEA 0183 or an MCAP log of a run")
    # Invalid bytes affect only their own line.
    text = data.decode("utf-8-sig", errors="replace")
    if not text.strip():
        raise TraceError("empty file")
    return _reader(path.suffix.lower(), text)(text)


def _content(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if is_file(path) and size <= MAX_BYTES:
            return path.read_bytes()
    except FileNotFoundError as error:
        raise TraceError("no such file") from error
    except OSError as error:
        raise TraceError((error.strerror or "cannot be read").lower()) from error
    except ValueError as error:  # a zero byte in its name
        raise TraceError(str(error)) from error
    too_large = f"larger than {MAX_BYTES // 1_000_000} MB"
    raise TraceError(too_large if is_file(path) else "not a file")


def _reader(suffix: str, text: str) -> Callable[[str], DriveOfPoints]:
    by_suffix = {".csv": read_csv, ".gpx": read_gpx, ".nmea": read_nmea}
    if suffix in by_suffix:
        return by_suffix[suffix]
    if text.lstrip().startswith("<"):
        return read_gpx
    return read_nmea if any(line.startswith("$") for line in text.splitlines()) else read_csv


def _sifted(drive: DriveOfPoints) -> DriveOfPoints:
    """Remove points off the earth, points without time among timed ones, and repeated fixes."""
    sifted = replace(drive, points=[], skipped=list(drive.skipped))
    timed = sum(point.time is not None for point in drive.points)
    mostly_timed = 2 * timed > len(drive.points)
    for point in drive.points:
        if drive.geodetic and not _on_earth(*point.position):
            latitude, longitude = point.position
            sifted.skipped.append(f"{point.place}: latitude {latitude}, longitude {longitude}")
        elif mostly_timed and point.time is None:
            sifted.skipped.append(f"{point.place}: no time")
        elif not (sifted.points and _is_repeated(sifted.points[-1], point)):
            sifted.points.append(point)
    if not sifted.points:
        reason = f", {sifted.skipped[0]}" if sifted.skipped else ""
        raise TraceError(f"no valid point{reason}")
    return sifted


def _is_repeated(before: RecordedPoint, point: RecordedPoint) -> bool:
    """Whether a fix is repeated, since the recorder polls faster than the receiver measures."""
    same_time = point.time is not None and point.time == before.time
    return same_time and point.position == before.position


def _on_earth(latitude: float, longitude: float) -> bool:
    return abs(latitude) <= 90.0 and abs(longitude) <= 360.0  # False for NaN, too


def _check_order(drive: DriveOfPoints) -> None:
    for before, after in itertools.pairwise(drive.points):
        if before.time is not None and after.time is not None and after.time < before.time:
            back = before.time - after.time
            raise TraceError(f"{after.place}: time runs back by {back:.3f} s")


def _laid_out(source: str, drive: DriveOfPoints, origin: Origin | None) -> DriveInPlane:
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
    remarks = list(_remarks(left, points))
    if speeds and not any(speeds):
        speeds = ()
        instead = "speeds follow from the times" if timed else "speeds are ignored"
        remarks.append(f"every recorded speed is 0 while the position changes: {instead}")
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
        epoch_s=drive.zero + first if timed else 0.0,
        source_unit=points[0].place.split()[0],
        source_numbers=tuple(int(points[k].place.split()[1]) for k in kept),
        noise_m=left.noise,
        jumping_points=sum(jump.last - jump.first + 1 for jump in left.jumps),
        standing_points=stood,
        remarks=tuple(remarks),
    )


def _speed_at(left: Cleaned, speeds: tuple[float, ...]) -> Iterator[float]:
    """Yield the speeds of kept points, 0 at standstill."""
    still = {k for stand in left.stands for k in stand.core}
    return (0.0 if k in still else speeds[k] for k in left.kept)


def _remarks(left: Cleaned, points: list[RecordedPoint]) -> Iterator[str]:
    def where(k: int) -> str:
        begun, at = points[left.kept[0]].time, points[k].time
        if begun is None or at is None:
            return points[k].place
        return f"{points[k].place} ({at - begun:.1f} s)"

    if left.jumps:
        count = sum(jump.last - jump.first + 1 for jump in left.jumps)
        worst = max(left.jumps, key=lambda jump: jump.size)
        points_jump = "1 point jumps and is" if count == 1 else f"{count} points jump and are"
        others = f", the first at {where(left.jumps[0].first)}" if count > 1 else ""
        yield f"{points_jump} left out, by {worst.size:.1f} m at {where(worst.first)}{others}"
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
            yield f"the car stands{span} from {where(first)} on: {count} points become one place"


def _speeds(points: list[RecordedPoint]) -> tuple[float, ...]:
    """Return a speed per point if most have one; the others repeat the previous one."""
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
    """Project points into the plane at the origin's height, to ignore noise in height."""
    places = []
    for point in points:
        try:
            places.append(plane.to_plane(*point.position, altitude))
        except ValueError as error:
            raise TraceError(f"{point.place}: {error}") from error
    return places


def _check_shape(trace: DriveInPlane) -> None:
    places = list(zip(trace.east_m, trace.north_m, strict=True))
    named = [f"{trace.source_unit} {number}" for number in trace.source_numbers]
    if len(places) == 1:
        raise TraceError(f"only one valid point, {named[0]}")
    for (before, after), name in zip(itertools.pairwise(places), named[1:], strict=True):
        jump = math.dist(before, after)
        if jump >= MAX_JUMP:
            raise TraceError(f"{name}: {jump / 1000:.1f} km from the point before")
    extent = max(math.dist(places[0], place) for place in places)
    if extent < LEAST_EXTENT:
        raise TraceError(f"all {len(places)} points lie within {extent:.2f} m, so there is no path")
