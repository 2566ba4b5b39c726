"""GPX and KML: tracks, routes and lines of positions in degrees."""

import codecs
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import zip_longest
from typing import Final
from xml.parsers import expat  # reads no external entities, and NOT_AN_ENTITY leaves no others

from scenarios.definition.traces.formats.cells import PointColumns
from scenarios.definition.traces.recorded_drive import (
    DAMAGE,
    LeftOut,
    LeftOutRecords,
    RecordedDrive,
    TraceError,
)

# ---- Text of a file in any common encoding; damaged bytes spoil only their own line


FORMATS: Final = "CSV, GPX, KML, GeoJSON, NMEA 0183 or MCAP (log of a run, LocationFix, NavSatFix)"
"""Formats that are read, for messages."""

BOMS: Final = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),  # begins with the mark of UTF-16
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)

PACKED: Final = {
    b"PK\x03\x04": "a ZIP or KMZ archive",
    b"\x1f\x8b": "a gzip file",
    b"BZh": "a bzip2 file",
    b"\xfd7zXZ": "an xz file",
    b"7z\xbc\xaf": "a 7z archive",
    b"\x28\xb5\x2f\xfd": "a Zstandard file",
}
"""First bytes of packed files."""

BINARY: Final = re.compile(
    rb"%PDF|\x89PNG|\xff\xd8\xff|GIF8|SQLite format 3|#ROSBAG|.{8}\.FIT", re.DOTALL
)
"""First bytes of common binary files."""

SAMPLE_BYTES: Final = 4096
CONTROLS: Final = bytes({*range(1, 32)} - {9, 10, 11, 12, 13, 27})
CONTROLS_MAX: Final = 0.05
"""Share of control characters in a text; random bytes have 0.1."""

SENTENCE: Final = r"\$[A-Z]{2}(?:GGA|RMC|GLL|GNS),"
"""Begin of an NMEA sentence with a position."""

ZEROS_AT_AN_END: Final = re.compile(rb"(?<![^\r\n])\0++|(?<!\0)\0++(?=[\r\n$]|\Z)")
"""Zero bytes at the begin or end of a line, or before a sentence of NMEA 0183."""


def decoded(data: bytes) -> str:
    """Decode the content of a file.

    UTF-8 and UTF-16 are recognised with and without a byte order mark, and bytes that are not
    UTF-8 are Latin-1. Zero bytes within a line become one U+FFFD, others are removed. Raises
    TraceError for an empty file and for binary data.
    """
    packed = next((name for magic, name in PACKED.items() if data.startswith(magic)), None)
    if packed:
        raise TraceError(f"{packed}: unpack it first, and give the file inside")
    mark, encoding = next(((m, e) for m, e in BOMS if data.startswith(m)), (b"", "utf-8"))
    encoding = encoding if mark else _encoding(data[:SAMPLE_BYTES])
    if encoding != "utf-8":
        text = data[len(mark) :].decode(encoding, errors="replace").replace("\0", "")
        data = text[:SAMPLE_BYTES].encode()  # a sample, to recognise binary data
    else:
        data = data[len(mark) :]
        if b"\0" in data:
            data = re.sub(rb"\0++", "\ufffd".encode(), ZEROS_AT_AN_END.sub(b"", data))
        text = ""
    if not data.strip():
        raise TraceError("empty file")
    controls = len(data) - len(data.translate(None, CONTROLS))
    is_binary = BINARY.match(data) or controls > CONTROLS_MAX * len(data)
    if is_binary and not re.search(SENTENCE.encode(), data):
        raise TraceError(f"binary data, allowed {FORMATS}")
    text = text or _with_latin_1(data)
    return text.replace("\ufeff", "")  # marks of joined files, or behind zero bytes


def _encoding(sample: bytes) -> str:
    """Recognise UTF-16 without a byte order mark by the zero bytes at every second place."""
    even, odd = sample[::2], sample[1::2]
    if odd.count(0) > 0.7 * len(odd) and even.count(0) < 0.1 * len(even):
        return "utf-16-le"
    if even.count(0) > 0.7 * len(even) and odd.count(0) < 0.1 * len(odd):
        return "utf-16-be"
    return "utf-8"


def _with_latin_1(data: bytes) -> str:
    """Decode UTF-8, and other bytes as Latin-1."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        text = data.decode(errors="surrogateescape")
    return re.sub("[\udc80-\udcff]", lambda byte: chr(ord(byte[0]) - 0xDC00), text)


# ---- Elements of XML files, up to their first damage


CHUNK_BYTES: Final = 1_000_000

NOT_AN_ENTITY: Final = re.compile(rb"&(?!(?:amp|lt|gt|quot|apos|#\d+|#x[0-9a-fA-F]+);)")
"""A sign & that begins none of the entities of XML itself."""

Starts = Mapping[str, Callable[[dict[str, str]], None]]
Ends = Mapping[str, Callable[[str], object]]


def read_elements(text: str, starts: Starts, ends: Ends, damaged: Callable[[str], None]) -> None:
    """Call `starts` with the attributes and `ends` with the text of elements by their local name.

    Damage ends the reading, and is reported to `damaged` in a line. Entities are never expanded,
    except those of XML.
    """
    data = text.encode(errors="replace").translate(None, CONTROLS)
    data = NOT_AN_ENTITY.sub(b"&amp;", data)
    data = data[max(0, data.find(b"<")) :]
    texts: list[str] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        texts.clear()
        if handle := starts.get(name.rpartition(":")[2]):
            handle(attributes)

    def end(name: str) -> None:
        if handle := ends.get(name.rpartition(":")[2]):
            handle("".join(texts))

    parser = expat.ParserCreate("utf-8")  # whatever the declaration states
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = texts.append
    view = memoryview(data)
    try:
        for begin in range(0, len(data), CHUNK_BYTES):
            parser.Parse(view[begin : begin + CHUNK_BYTES], False)
        parser.Parse(b"", True)
    except expat.ExpatError as error:
        damaged(f"damaged XML at line {error.lineno}: {expat.ErrorString(error.code)}")


# ---- Markup


VALUES: Final = ("ele", "time", "speed")
"""Elements of a point in GPX; its extensions may have the speed."""

SHAPES: Final = ("Track", "LineString", "LinearRing", "Point")
"""Elements of KML with coordinates; the first that a file has makes the drive."""

COMMA: Final = re.compile(r"\s*,\s*")


def read_gpx(text: str) -> RecordedDrive:
    """Read the tracks of a GPX file, or else its routes, or else its waypoints."""
    kinds = {name: PointColumns() for name in ("trkpt", "rtept", "wpt")}
    left_out = LeftOutRecords()
    place: dict[str, str] = {}
    values: dict[str, str] = {}

    def begin(attributes: dict[str, str]) -> None:
        nonlocal place
        place = attributes
        values.clear()

    def end(points: PointColumns, _: str) -> None:
        known = values.get
        points.add(
            place.get("lat"), place.get("lon"), known("ele"), known("time", ""), known("speed")
        )

    starts = dict.fromkeys(kinds, begin)
    ends: dict[str, Callable[[str], object]] = {
        name: partial(end, points) for name, points in kinds.items()
    }
    ends |= {name: partial(values.setdefault, name) for name in VALUES}
    read_elements(text, starts, ends, lambda reason: _damage(left_out, reason, *kinds.values()))
    points = next((points for points in kinds.values() if points.times), None)
    if points is None:
        raise TraceError(f"no points in its tracks, routes and waypoints{_first(left_out)}")
    return points.drive(left_out)


def read_kml(text: str) -> RecordedDrive:
    """Read the tracks of a KML file, or else its lines, rings or points, in their order."""
    shapes = _Shapes()
    starts = {name: partial(shapes.begin, name) for name in (*SHAPES, "Placemark")}
    ends: dict[str, Callable[[str], object]] = {
        "coordinates": shapes.add_coordinates,
        "when": shapes.whens.append,
        "coord": shapes.coords.append,
        "Track": shapes.end_track,
        "Placemark": shapes.end_placemark,
    }
    read_elements(text, starts, ends, shapes.end_at_damage)
    points = next((points for points in shapes.columns.values() if points.times), None)
    if points is None:
        raise TraceError(f"no coordinates in its lines, tracks and points{_first(shapes.left_out)}")
    return points.drive(shapes.left_out)


@dataclass(slots=True)
class _Shapes:
    """Points of a KML file by shape, and the open shape with its times and places."""

    columns: dict[str, PointColumns] = field(
        default_factory=lambda: {name: PointColumns() for name in SHAPES}
    )
    left_out: LeftOutRecords = field(default_factory=LeftOutRecords)
    opened: str = "LineString"
    whens: list[str] = field(default_factory=list)
    coords: list[str] = field(default_factory=list)

    def begin(self, name: str, _: dict[str, str]) -> None:
        self.opened = name
        if name in {"Track", "Placemark"}:
            self.whens.clear()
            self.coords.clear()

    def add_coordinates(self, text: str) -> None:
        points = self.columns.get(self.opened)
        if points is None:  # of a Placemark
            return
        for word in COMMA.sub(",", text).split():
            _add_word(points, word.split(","))

    def end_track(self, _: str) -> None:
        for when, coord in zip_longest(self.whens, self.coords, fillvalue=""):
            _add_word(self.columns["Track"], coord.split(), when)
        self.whens.clear()
        self.coords.clear()

    def end_placemark(self, _: str) -> None:
        times = self.columns["Point"].times
        if self.whens and times and not times[-1]:
            times[-1] = self.whens[-1]

    def end_at_damage(self, reason: str) -> None:
        del self.whens[len(self.coords) :]
        self.end_track("")
        _damage(self.left_out, reason, *self.columns.values())


def _add_word(points: PointColumns, numbers: list[str], time: str = "") -> None:
    """Add a point with longitude, latitude and perhaps altitude."""
    longitude, latitude, altitude, *_ = *numbers, "", "", ""
    points.add(latitude, longitude, altitude, time)


def _damage(left_out: LeftOutRecords, reason: str, *columns: PointColumns) -> None:
    """List damage behind the points so far."""
    count = next((len(points.times) for points in columns if points.times), 0)
    left_out.add(LeftOut(count + 1, DAMAGE, reason))


def _first(left_out: LeftOutRecords) -> str:
    return f", {left_out.records[0].reason}" if left_out.records else ""
