"""Files of a recording in the formats of receivers, recorders and exports.

Independent of the readers of the project.
"""

import json
import operator
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import reduce
from io import BytesIO

from mcap.writer import Writer

from tests.made.spoiled.synthetic_drives import START, Fix, Recording

KNOT = 1852.0 / 3600.0
Cell = float | str | None

TIMES: dict[str, Callable[[float], str]] = {
    "s": lambda t: f"{t - START:.3f}",
    "unix s": lambda t: f"{t:.3f}",
    "unix ns": lambda t: f"{round(t * 1e6)}000",
    "iso z": lambda t: f"{_date(t):%Y-%m-%dT%H:%M:%S.%f}"[:-3] + "Z",
    "iso": lambda t: f"{_date(t):%Y-%m-%dT%H:%M:%S.%f}"[:-3],
}
"""Texts of a Unix time (s)."""


def _date(time: float) -> datetime:
    return datetime.fromtimestamp(0, UTC) + timedelta(microseconds=round(time * 1e6))


@dataclass(frozen=True, kw_only=True)
class Table:
    """A CSV file: names of its columns, and its form.

    `columns` are names of time, position, height and speed; "" leaves a column out. `lead` stands
    before the header. `extra` are cells after each row.
    """

    columns: tuple[str, str, str, str, str] = ("t_s", "x_m", "y_m", "", "speed_mps")
    geodetic: bool = False
    time: str = "s"
    separator: str = ","
    lead: str = ""
    encoding: str = "utf-8"
    extra: tuple[tuple[str, str], ...] = ()

    def write(self, recording: Recording) -> bytes:
        names = [name for name in self.columns if name] + [name for name, _ in self.extra]
        rows = [self._row(fix) for fix in recording.fixes]
        lines = [self.lead + self.separator.join(names), *rows]
        return ("\n".join(lines) + "\n").encode(self.encoding)

    def _row(self, fix: Fix) -> str:
        if fix.row is not None:
            return fix.row
        first, second = fix.latitude_longitude if self.geodetic else (fix.east, fix.north)
        digits = 9 if self.geodetic else 4
        cells = (
            TIMES[self.time](fix.time) if isinstance(fix.time, float) else (fix.time or ""),
            f"{first:.{digits}f}",
            f"{second:.{digits}f}",
            _cell(fix.height),
            _cell(fix.speed),
        )
        used = [cell for cell, name in zip(cells, self.columns, strict=True) if name]
        return self.separator.join([*used, *(value for _, value in self.extra)])


def _cell(value: Cell) -> str:
    return "" if value is None else str(value)


DEGREES = ("time", "latitude", "longitude", "altitude", "speed_mps")

TABLES: dict[str, Table] = {
    "plane csv": Table(),
    "track csv": Table(
        columns=("", "x_m", "y_m", "", ""), lead="# ", extra=(("w_tr_right_m", "7.5"),)
    ),
    "tab csv": Table(separator="\t", time="unix s"),
    "utf-16 csv": Table(encoding="utf-16"),
    "geodetic csv": Table(
        columns=("t_s", "latitude_deg", "longitude_deg", "altitude_m", "speed_mps"), geodetic=True
    ),
    "iso csv": Table(
        columns=("time", "latitude", "longitude", "altitude", ""), geodetic=True, time="iso z"
    ),
    "ns csv": Table(
        columns=("%time", "field.latitude", "field.longitude", "field.altitude", ""),
        geodetic=True, time="unix ns", extra=(("note", '"clear, dry"'),),
    ),
}  # fmt: skip


def pos(recording: Recording) -> bytes:
    """A solution of RTKLIB, in its default form."""
    rows = [
        fix.row
        or f"{_date(fix.time):%Y/%m/%d %H:%M:%S.%f}"[:-3]
        + "  {:13.9f} {:14.9f}".format(*fix.latitude_longitude)
        + f" {_cell(fix.height):>10}   1  12   0.0080   0.0080   0.0150"
        for fix in recording.fixes
        if isinstance(fix.time, float)
    ]
    head = (
        "% program   : RTKLIB ver.2.4.3\n% inp file  : rover.obs\n%\n"
        "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,5:single,ns=# of satellites)\n"
        "%  UTC                   latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)"
        "   sde(m)   sdu(m)\n"
    )
    return (head + "\n".join(rows) + "\n").encode()


def gpx(recording: Recording, time: str = "iso z", speeds: bool = False) -> bytes:
    version = "1.0" if speeds else "1.1"
    namespace = f"http://www.topografix.com/GPX/{version.replace('.', '/')}"
    points = "\n".join(_track_point(fix, time, speeds) for fix in recording.fixes)
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="{version}" creator="test" '
        f'xmlns="{namespace}"><trk><trkseg>\n{points}\n</trkseg></trk></gpx>\n'
    ).encode()


def _track_point(fix: Fix, time: str, speeds: bool) -> str:
    if fix.row is not None:
        return fix.row
    latitude, longitude = fix.latitude_longitude
    at = TIMES[time](fix.time) if isinstance(fix.time, float) else fix.time
    return (
        f'<trkpt lat="{latitude:.9f}" lon="{longitude:.9f}">'
        + ("" if fix.height is None else f"<ele>{fix.height}</ele>")
        + ("" if at is None else f"<time>{at}</time>")
        + (f"<speed>{fix.speed}</speed>" if speeds and fix.speed is not None else "")
        + "</trkpt>"
    )


def kml(recording: Recording, times: bool = False) -> bytes:
    corners = [(*fix.latitude_longitude, _cell(fix.height) or "0") for fix in recording.fixes]
    if times:
        ats = (TIMES["iso z"](fix.time) for fix in recording.fixes if isinstance(fix.time, float))
        when = "".join(f"<when>{at}</when>" for at in ats)
        coords = "".join(f"<gx:coord>{b:.9f} {a:.9f} {h}</gx:coord>" for a, b, h in corners)
        inside = f"<gx:Track>{when}{coords}</gx:Track>"
    else:
        line = " ".join(f"{b:.9f},{a:.9f},{h}" for a, b, h in corners)
        inside = f"<LineString><coordinates>{line}</coordinates></LineString>"
    return (
        '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2" '
        'xmlns:gx="http://www.google.com/kml/ext/2.2"><Document><Placemark>'
        f"{inside}</Placemark></Document></kml>"
    ).encode()


def geojson(recording: Recording) -> bytes:
    corners = [
        [round(longitude, 9), round(latitude, 9)]
        for latitude, longitude in (fix.latitude_longitude for fix in recording.fixes)
    ]
    line = {"type": "LineString", "coordinates": corners}
    feature = {"type": "Feature", "properties": {}, "geometry": line}
    return json.dumps({"type": "FeatureCollection", "features": [feature]}).encode()


# --- NMEA 0183


def sentence(body: str) -> str:
    return f"${body}*{reduce(operator.xor, body.encode(), 0):02X}"


def _sexagesimal(degrees: float, width: int, signs: str) -> str:
    tenths = round(abs(degrees) * 6e8)
    whole, rest = divmod(tenths, 600_000_000)
    return f"{whole:0{width}d}{rest / 1e7:010.7f},{signs[degrees < 0.0]}"


def sentences(fix: Fix) -> tuple[str, str]:
    latitude, longitude = fix.latitude_longitude
    place = f"{_sexagesimal(latitude, 2, 'NS')},{_sexagesimal(longitude, 3, 'EW')}"
    date = _date(fix.time) if isinstance(fix.time, float) else None
    clock = f"{date:%H%M%S.%f}"[:-3] if date else ""
    day = f"{date:%d%m%y}" if date else ""
    knots = f"{fix.speed / KNOT:.4f}" if isinstance(fix.speed, float) else _cell(fix.speed)
    return (
        sentence(f"GNGGA,{clock},{place},4,12,0.8,{_cell(fix.height)},M,40.0,M,,"),
        sentence(f"GNRMC,{clock},A,{place},{knots},90.0,{day},,,A"),
    )


def nmea(recording: Recording, late_epochs: int = 0) -> bytes:
    pairs = [(fix.row, "") if fix.row is not None else sentences(fix) for fix in recording.fixes]
    lines: list[str] = []
    for k in range(len(pairs) + late_epochs):
        lines += [pairs[k][0]] if k < len(pairs) else []
        lines += [pairs[k - late_epochs][1]] if k >= late_epochs else []
    return ("\r\n".join(line for line in lines if line) + "\r\n").encode()


# --- Logs and folders


def location_fixes(recording: Recording) -> bytes:
    buffer = BytesIO()
    writer = Writer(buffer)
    writer.start()
    schema = writer.register_schema("foxglove.LocationFix", "jsonschema", b'{"type": "object"}')
    channel = writer.register_channel("/gps/fix", "json", schema)
    for fix in recording.fixes:
        at = fix.time if isinstance(fix.time, float) else START
        seconds, micros = divmod(round(at * 1e6), 1_000_000)
        latitude, longitude = fix.latitude_longitude
        height = fix.height if isinstance(fix.height, float) else None
        message = {
            "timestamp": {"sec": seconds, "nsec": 1000 * micros},
            "frame_id": "gps",
            "latitude": latitude,
            "longitude": longitude,
            "altitude": height,
        }
        nanoseconds = max(round(at * 1e6), 0) * 1000
        writer.add_message(channel, nanoseconds, json.dumps(message).encode(), nanoseconds)
    writer.finish()  # type: ignore[no-untyped-call]
    return buffer.getvalue()


WRITERS: dict[str, tuple[str, Callable[[Recording], bytes]]] = {
    **{name: (".csv", table.write) for name, table in TABLES.items()},
    "pos csv": (".pos", pos),
    "gpx": (".gpx", gpx),
    "speeds gpx": (".gpx", lambda recording: gpx(recording, speeds=True)),
    "nmea": (".nmea", nmea),
    "kml line": (".kml", kml),
    "kml track log": (".kml", lambda recording: kml(recording, times=True)),
    "geojson line": (".geojson", geojson),
    "mcap log": (".mcap", location_fixes),
}
"""Suffix and writer of each format."""
