"""A synthetic drive in all formats of recorded drives, and a scenario that drives it."""

import math
import operator
from collections.abc import Callable
from functools import reduce
from pathlib import Path

from scenarios.definition.scenario import Scenario, scenario_from_text
from tests.made.message import pose
from transport.log.writer import LogWriter
from vehicles.geometry.geodesy import LocalPlane, Origin

ORIGIN = Origin(48.1, 11.5, 500.0)
START = 1_700_000_000  # Unix time (s) at which the drive begins: 22:13:20 UTC

CSV = "x_m,y_m\n"  # header of a file of positions in the plane

Drive = list[tuple[float, float, float, float]]
"""Time (s), east (m), north (m), speed (m/s)."""


def drive() -> Drive:
    """20 s on a left bend of 150 m radius at 12 m/s, 10 points per second."""
    points = []
    for k in range(201):
        angle = 12.0 * 0.1 * k / 150.0
        east, north = 150.0 * math.sin(angle), 150.0 * (1.0 - math.cos(angle))
        points.append((0.1 * k, east, north, 12.0))
    return points


def geodetic(east: float, north: float) -> tuple[float, float]:
    return LocalPlane(ORIGIN).to_geodetic(east, north)[:2]


# --- Writers of all formats, independent of the readers of the project


def as_plane_csv(points: Drive) -> bytes:
    rows = (f"{t!r},{e!r},{n!r},0.5,{v!r}" for t, e, n, v in points)
    return "\n".join(["t_s,x_m,y_m,yaw_rad,speed_mps", *rows]).encode()


def as_geodetic_csv(points: Drive) -> bytes:
    rows = (f"{geodetic(e, n)[0]!r};{geodetic(e, n)[1]!r};500;{t!r};{v!r}" for t, e, n, v in points)
    header = "latitude_deg;longitude_deg;altitude_m;t_s;speed_mps"
    return "\r\n".join(["\ufeff# a comment", header, "", *rows]).encode()


def as_gpx(points: Drive, point: str = "trkpt", around: str = "trk><trkseg") -> bytes:
    closing = "></".join(reversed(around.split("><")))
    rows = []
    for t, e, n, _ in points:
        minute, second = divmod(20.0 + t, 60.0)
        clock = f"2023-11-14T22:{13 + int(minute)}:{second:09.6f}Z"
        latitude, longitude = geodetic(e, n)
        rows.append(
            f'<{point} lat="{latitude!r}" lon="{longitude!r}"><ele>500</ele>'
            f"<time>{clock}</time></{point}>"
        )
    return (
        '<?xml version="1.0"?><gpx version="1.1" creator="test" '
        f'xmlns="http://www.topografix.com/GPX/1/1"><{around}>{"".join(rows)}</{closing}></gpx>'
    ).encode()


def sentence(body: str) -> str:
    return f"${body}*{reduce(operator.xor, body.encode(), 0):02X}"


def sexagesimal(degrees: float, width: int) -> str:
    whole = int(degrees)
    return f"{whole:0{width}d}{60.0 * (degrees - whole):012.9f}"


def clock(seconds: float) -> str:
    tenths = round(10 * seconds) % 864_000
    return f"{tenths // 36000:02d}{tenths // 600 % 60:02d}{tenths // 10 % 60:02d}.{tenths % 10}0"


def as_nmea(points: Drive, begin: float = 80_000.0) -> bytes:
    lines = []
    for t, e, n, v in points:
        latitude, longitude = geodetic(e, n)
        position = f"{sexagesimal(latitude, 2)},N,{sexagesimal(longitude, 3)},E"
        at = clock(begin + t)
        lines += [
            sentence(f"GNGGA,{at},{position},4,20,0.7,455.0,M,45.0,M,,"),
            sentence("GPGSV,1,1,01,01,40,083,46"),
            sentence(f"GNRMC,{at},A,{position},{v * 3600 / 1852:.6f},90.0,141123,,,A"),
        ]
    return "\r\n".join(lines).encode()


def write_log(path: Path, points: Drive) -> None:
    with LogWriter(path) as log:
        for seq, (t, e, n, v) in enumerate(points):
            at = START * 10**9 + round(t * 1e9)
            for vehicle, offset in (("v1", 0.0), ("v2", 50.0)):
                latitude, longitude = geodetic(e + offset, n + offset)
                place = {"latitude_deg": latitude, "longitude_deg": longitude}
                sent = pose(vehicle, seq, at, **place, altitude_m=500.0, speed_mps=v)
                log.write(at, sent)


WRITERS: dict[str, Callable[[Drive], bytes]] = {
    "drive.csv": as_plane_csv,
    "semicolons.csv": as_geodetic_csv,
    "drive.gpx": as_gpx,
    "route.gpx": lambda points: as_gpx(points, "rtept", "rte"),
    "drive.nmea": as_nmea,
    "sentences.txt": as_nmea,
    "midnight.nmea": lambda points: as_nmea(points, 86_395.0),
}


def driven(path: Path, keys: str = "", speed: str = "") -> Scenario:
    text = f'name = "a"\n[path]\nkind = "trace"\nfile = "{path.name}"\n{keys}\n[speed]\n{speed}\n'
    return scenario_from_text(text, label="a.toml", folder=path.parent)
