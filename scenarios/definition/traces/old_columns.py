"""Columns from the older readers."""

from pathlib import Path

import numpy as np

from scenarios.definition.traces import old_formats
from scenarios.definition.traces.recorded_drive import (
    Floats,
    LeftOut,
    LeftOutRecords,
    RecordedDrive,
    TraceError,
)


def read_recorded(
    path: Path, vehicle: str | None = None, topic: str | None = None
) -> RecordedDrive:
    if topic or not path.is_file():
        raise TraceError("not a file" if path.exists() else "no such file")
    data = path.read_bytes()
    if data.startswith(b"\x89MCAP"):
        drive = old_formats.read_log(path, vehicle)
    else:
        text = data.decode("utf-8-sig", errors="replace")
        if not text.strip():
            raise TraceError("empty file")
        suffix = path.suffix.lower()
        is_nmea = suffix == ".nmea" or any(line.startswith("$") for line in text.splitlines())
        is_gpx = suffix == ".gpx" or text.lstrip().startswith("<")
        read = (
            old_formats.read_gpx
            if is_gpx
            else old_formats.read_nmea
            if is_nmea
            else old_formats.read_csv
        )
        drive = read(text)
    points = drive.points
    left_out = LeftOutRecords()
    for line in drive.skipped:
        place, _, reason = line.partition(": ")
        left_out.add(LeftOut(int(place.split()[1]), reason, reason))
    return RecordedDrive(
        geodetic=drive.geodetic,
        unit=points[0].place.split()[0] if points else "line",
        numbers=np.array([int(point.place.split()[1]) for point in points], dtype=np.int64),
        position=np.array([point.position for point in points]).reshape(-1, 2).T.copy(),
        altitude_m=_column([point.altitude for point in points]),
        time_s=_column([point.time for point in points]),
        speed_mps=_column([point.speed for point in points]),
        clock=drive.clock,
        zero_s=drive.zero,
        left_out=left_out,
    )


def _column(values: list[float | None]) -> Floats:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def usable_speeds(
    speed_mps: Floats, time_s: Floats, points: Floats
) -> tuple[Floats | None, tuple[str, ...]]:
    known = np.flatnonzero(np.isfinite(speed_mps))
    if 2 * known.size <= points.shape[1]:
        return None, ()
    last = np.maximum(np.searchsorted(known, np.arange(points.shape[1]), side="right") - 1, 0)
    speeds = np.abs(speed_mps[known[last]])
    if speeds.any():
        return speeds, ()
    instead = "speeds follow from the times" if time_s.size else "speeds are ignored"
    return None, (f"every recorded speed is 0 while the position changes: {instead}",)
