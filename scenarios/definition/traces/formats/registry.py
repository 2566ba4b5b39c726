"""The text of a file, its format, and the names of other formats."""

import codecs
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from scenarios.definition.traces.drive import DriveTable, TraceError
from scenarios.definition.traces.formats.geojson import read_geojson
from scenarios.definition.traces.formats.logs import MCAP_MAGIC, read_mcap
from scenarios.definition.traces.formats.markup import read_fcd, read_gpx, read_kml
from scenarios.definition.traces.formats.nmea import read_nmea
from scenarios.definition.traces.formats.table import read_table

FORMATS = (
    "CSV, GPX, KML, GeoJSON, NMEA 0183, SUMO FCD or MCAP (log of a run, LocationFix, NavSatFix, "
    "Odometry, PoseStamped)"
)
"""Formats that are read, for messages."""

BYTES_MAX, HEAD = 200_000_000, 20_000
"""Largest file of a drive, and number of characters in which a format is recognised."""

CONTROLS = bytes({*range(1, 32)} - {9, 10, 11, 12, 13, 27})
CONTROLS_MAX = 0.05
"""Share of control characters in a text; random bytes have 0.1."""

BOMS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),  # begins with the mark of UTF-16
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)

PACKED = {
    b"PK\x03\x04": "a ZIP or KMZ archive", b"\x1f\x8b": "a gzip file", b"BZh": "a bzip2 file",
    b"\xfd7zXZ": "an xz file", b"7z\xbc\xaf": "a 7z archive",
    b"\x28\xb5\x2f\xfd": "a Zstandard file",
}  # fmt: skip
"""Names of packed files by their first bytes."""

BINARY = re.compile(rb"%PDF|\x89PNG|\xff\xd8\xff|GIF8|SQLite format 3|#ROSBAG|.{8}\.FIT", re.DOTALL)
"""First bytes of common binary files."""

SENTENCE = r"\$[A-Z]{2}(?:GGA|RMC|GLL|GNS),"
"""Begin of an NMEA sentence with a position."""

ZEROS_AT_AN_END = re.compile(rb"(?<![^\r\n])\0++|(?<!\0)\0++(?=[\r\n$]|\Z)")
"""Zero bytes at the begin or end of a line, or before a sentence of NMEA 0183."""


def _tag(*names: str) -> str:
    return rf"<(?:[\w.-]+:)?(?:{'|'.join(names)})[\s>/]"


class Format(NamedTuple):
    """A text format: name, suffixes of files, what occurs in its head, and its reader."""

    name: str
    suffixes: tuple[str, ...]
    pattern: str
    read: Callable[..., DriveTable]
    has_vehicles: bool = False


TEXT_FORMATS = (
    Format("NMEA 0183", (".nmea", ".ubx"), rf"{SENTENCE}|\A\s*\$P?[A-Z]{{3,5}},", read_nmea),
    Format("GPX", (".gpx",), _tag("gpx", "trkpt", "rtept", "wpt"), read_gpx),
    Format(
        "KML", (".kml",), _tag("kml", "Placemark", "LineString", "coordinates", "coord"), read_kml
    ),
    Format("SUMO FCD", (".xml",), _tag("fcd-export", "timestep"), read_fcd, has_vehicles=True),
    Format("GeoJSON", (".geojson", ".json"), r'\A\s*(\[\s*)?\{|"coordinates"\s*:', read_geojson),
    Format("CSV", (".csv", ".tsv", ".txt", ".pos", ".dat"), "", read_table, has_vehicles=True),
)
"""The first format whose pattern occurs reads a text; without any its suffix decides."""


def read_recorded(
    path: Path, *, vehicle: str | None = None, topic: str | None = None
) -> DriveTable:
    """Read a recorded drive by the format of its content.

    `vehicle` selects one of a file's, `topic` the positions of an MCAP file. Raises TraceError for
    a file that is missing, too large, or of another format.
    """
    data = _content(path)
    if data.startswith(MCAP_MAGIC):
        return replace(read_mcap(path, vehicle, topic), format_name="MCAP")
    if topic is not None:
        raise TraceError(f"given topic {topic}, allowed only for an MCAP file")
    text = decoded(data)
    del data  # large
    row = _format(text, path.suffix.lower())
    if vehicle is not None and not row.has_vehicles:
        raise TraceError(f"given vehicle {vehicle}, allowed only for CSV, SUMO FCD and MCAP files")
    drive = row.read(text, vehicle) if row.has_vehicles else row.read(text)
    return replace(drive, format_name=row.name)


def _format(text: str, suffix: str) -> Format:
    head = text[:HEAD]
    for row in TEXT_FORMATS[:-1]:
        if re.search(row.pattern, text if row.name.startswith("NMEA") else head):
            return row
    if re.match(r"\s*File created on .*\s+\[header\]", head):
        raise TraceError("a VBO file of Racelogic: convert it to CSV or NMEA 0183 first")
    if root := re.match(r"\s*(?:<[?!][^>]*>\s*)*<([\w.:-]+)", head):
        raise TraceError(f"XML with root {root[1]}, unknown content, allowed {FORMATS}")
    lines = [line for line in head.splitlines() if line.strip()][:100]
    rows = [line for line in lines if re.search(r"\d", line) and re.search(r"\S[,;|\t ]+\S", line)]
    if 2 * len(rows) >= len(lines):
        return TEXT_FORMATS[-1]
    chosen = next((row for row in TEXT_FORMATS if suffix in row.suffixes), None)
    if chosen is None:
        raise TraceError(f"unknown content, allowed {FORMATS}")
    return chosen


def _content(path: Path) -> bytes:
    try:
        if path.is_dir():
            raise TraceError(f"a folder, allowed a file: {FORMATS}")
        size = path.stat().st_size
        if path.is_file() and size <= BYTES_MAX:
            return path.read_bytes()
    except FileNotFoundError as error:
        raise TraceError("no such file") from error
    except OSError as error:
        raise TraceError((error.strerror or "cannot be read").lower()) from error
    except ValueError as error:  # a zero byte in its name
        raise TraceError(str(error)) from error
    too_large = f"larger than {BYTES_MAX // 1_000_000} MB: give a part of it"
    raise TraceError(too_large if path.is_file() else "not a file")


def decoded(data: bytes) -> str:
    """Decode the content of a file; damaged bytes spoil only their own line.

    UTF-8 and UTF-16 are recognised with and without a byte order mark, and bytes that are not
    UTF-8 are Latin-1. Zero bytes within a line become one U+FFFD, others are removed. Raises
    TraceError for an empty file and for binary data.
    """
    packed = next((name for magic, name in PACKED.items() if data.startswith(magic)), None)
    if packed:
        raise TraceError(f"{packed}: unpack it first, and give the file inside")
    mark, encoding = next(((m, e) for m, e in BOMS if data.startswith(m)), (b"", ""))
    text, data = "", data[len(mark) :]
    encoding = encoding or _utf_16(data[:4096])
    if encoding != "utf-8":
        text = data.decode(encoding, errors="replace").replace("\0", "")
        data = text[:4096].encode()  # a sample, to recognise binary data
    elif b"\0" in data:
        data = re.sub(rb"\0++", "\ufffd".encode(), ZEROS_AT_AN_END.sub(b"", data))
    if not data.strip():
        raise TraceError("empty file")
    controls = len(data) - len(data.translate(None, CONTROLS))
    is_binary = BINARY.match(data) or controls > CONTROLS_MAX * len(data)
    if is_binary and not re.search(SENTENCE.encode(), data):
        raise TraceError(f"binary data, allowed {FORMATS}")
    if not text:
        text = data.decode(errors="surrogateescape")
        text = re.sub("[\udc80-\udcff]", lambda byte: chr(ord(byte[0]) - 0xDC00), text)
    return text.replace("\ufeff", "")  # marks of joined files, or behind zero bytes


def _utf_16(sample: bytes) -> str:
    """Recognise UTF-16 without a byte order mark by the zero bytes at every second place."""
    zeros = [half.count(0) / max(len(half), 1) for half in (sample[::2], sample[1::2])]
    if max(zeros) > 0.7 and min(zeros) < 0.1:
        return "utf-16-le" if zeros[1] > zeros[0] else "utf-16-be"
    return "utf-8"
