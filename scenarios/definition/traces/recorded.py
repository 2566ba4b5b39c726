"""Recorded drives for the lead: read from any of the formats, checked, laid into the plane."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from scenarios.definition.traces.formats import (
    Recording,
    Sample,
    TraceError,
    read_csv,
    read_gpx,
    read_log,
)
from scenarios.definition.traces.nmea import read_nmea
from vehicles.geometry.geodesy import LocalPlane, Origin

MAX_BYTES = 200_000_000
"""Larger files are refused: no drive is that long."""

MAX_JUMP = 1000.0
"""A way (m) from one point to the next that no receiver leaves out."""

LEAST_EXTENT = 1.0
"""Points that all lie within this distance (m) of the first make no path."""

MCAP_MAGIC = b"\x89MCAP0\r\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedTrace:
    """A recorded drive in the east-north plane of `origin` (None: the file has plane coordinates).

    east_m, north_m and, where the file has them for every point, time_s (from the first point
    on, never decreasing) and speed_mps, an entry each per point. `skipped` names the bad lines.
    """

    source: str
    origin: Origin | None
    east_m: tuple[float, ...]
    north_m: tuple[float, ...]
    time_s: tuple[float, ...] = ()
    speed_mps: tuple[float, ...] = ()
    skipped: tuple[str, ...] = ()


def read_trace(
    path: Path, *, origin: Origin | None = None, vehicle: str | None = None
) -> RecordedTrace:
    """Read the recorded drive at `path` into the plane of `origin`, by default its first point.

    The format is told by the file's name and content. `vehicle` chooses from the log of a run.
    Bad lines are skipped and listed. Raises TraceError, one line that starts with the file.
    """
    try:
        recording = _sifted(_read(path, vehicle))
        _check_order(recording)
        trace = _laid_out(path.name, recording, origin)
        _check_shape(trace, recording.samples)
    except TraceError as error:
        raise TraceError(f"{path}: {error}") from error
    return trace


def _read(path: Path, vehicle: str | None) -> Recording:
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
    if path.exists() and not path.is_file():
        raise TraceError("not a file")
    try:
        if path.stat().st_size > MAX_BYTES:
            raise TraceError(f"larger than {MAX_BYTES // 1_000_000} MB")
        return path.read_bytes()
    except FileNotFoundError as error:
        raise TraceError("no such file") from error
    except OSError as error:
        raise TraceError((error.strerror or "cannot be read").lower()) from error


def _reader(suffix: str, text: str) -> Callable[[str], Recording]:
    by_suffix = {".csv": read_csv, ".gpx": read_gpx, ".nmea": read_nmea}
    if suffix in by_suffix:
        return by_suffix[suffix]
    if text.lstrip().startswith("<"):
        return read_gpx
    return read_nmea if any(line.startswith("$") for line in text.splitlines()) else read_csv


def _sifted(recording: Recording) -> Recording:
    """Pass over samples that are nowhere on earth, or that alone have no time."""
    sifted = Recording(recording.geodetic, [], list(recording.skipped))
    timed = sum(sample.time is not None for sample in recording.samples)
    mostly_timed = 2 * timed > len(recording.samples)
    for sample in recording.samples:
        if recording.geodetic and not _on_earth(*sample.position):
            latitude, longitude = sample.position
            sifted.skipped.append(f"{sample.place}: latitude {latitude}, longitude {longitude}")
        elif mostly_timed and sample.time is None:
            sifted.skipped.append(f"{sample.place}: no time")
        else:
            sifted.samples.append(sample)
    if not sifted.samples:
        reason = f", {sifted.skipped[0]}" if sifted.skipped else ""
        raise TraceError(f"no valid point{reason}")
    return sifted


def _on_earth(latitude: float, longitude: float) -> bool:
    return abs(latitude) <= 90.0 and abs(longitude) <= 360.0  # False for NaN, too


def _check_order(recording: Recording) -> None:
    for before, after in itertools.pairwise(recording.samples):
        if before.time is not None and after.time is not None and after.time < before.time:
            back = before.time - after.time
            raise TraceError(f"{after.place}: time runs back by {back:.3f} s")


def _laid_out(source: str, recording: Recording, origin: Origin | None) -> RecordedTrace:
    samples = recording.samples
    if recording.geodetic:
        origin = origin or _first_point(samples)
        east, north = zip(*_in_plane(samples, LocalPlane(origin), origin.altitude_m), strict=True)
    else:
        origin = None
        east, north = zip(*(sample.position for sample in samples), strict=True)
    times = [sample.time for sample in samples if sample.time is not None]
    return RecordedTrace(
        source=source,
        origin=origin,
        east_m=east,
        north_m=north,
        time_s=tuple(time - times[0] for time in times) if len(times) == len(samples) else (),
        speed_mps=_speeds(samples),
        skipped=tuple(recording.skipped),
    )


def _speeds(samples: list[Sample]) -> tuple[float, ...]:
    """Give a speed per sample, where most have one; the others have that of the one before."""
    known = [sample.speed for sample in samples if sample.speed is not None]
    if 2 * len(known) <= len(samples):
        return ()
    speeds = [known[0]]
    for sample in samples:
        speeds.append(speeds[-1] if sample.speed is None else abs(sample.speed))
    return tuple(speeds[1:])


def _first_point(samples: list[Sample]) -> Origin:
    latitude, longitude = samples[0].position
    altitude = samples[0].altitude or 0.0
    if not abs(latitude) <= 89.0:
        raise TraceError(f"{samples[0].place}: latitude {latitude:g} deg, allowed -89 to 89")
    if not -500.0 <= altitude <= 10_000.0:
        raise TraceError(f"{samples[0].place}: altitude {altitude:g} m, allowed -500 to 10000")
    return Origin(latitude, (longitude + 180.0) % 360.0 - 180.0, altitude)


def _in_plane(
    samples: list[Sample], plane: LocalPlane, altitude: float
) -> list[tuple[float, float]]:
    """Lay points into the plane at the origin's height, so that noise in height does not matter."""
    points = []
    for sample in samples:
        try:
            points.append(plane.to_plane(*sample.position, altitude))
        except ValueError as error:
            raise TraceError(f"{sample.place}: {error}") from error
    return points


def _check_shape(trace: RecordedTrace, samples: list[Sample]) -> None:
    points = list(zip(trace.east_m, trace.north_m, strict=True))
    if len(points) == 1:
        raise TraceError(f"only one valid point, {samples[0].place}")
    for (before, after), sample in zip(itertools.pairwise(points), samples[1:], strict=True):
        jump = math.dist(before, after)
        if jump >= MAX_JUMP:
            raise TraceError(f"{sample.place}: {jump / 1000:.1f} km from the point before")
    extent = max(math.dist(points[0], point) for point in points)
    if extent < LEAST_EXTENT:
        raise TraceError(f"all {len(points)} points lie within {extent:.2f} m, so there is no path")
