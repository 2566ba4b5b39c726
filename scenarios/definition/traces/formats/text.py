"""Text of a file in any common encoding; damaged bytes spoil only their own line."""

import codecs
import re
from typing import Final

from scenarios.definition.traces.recorded_drive import TraceError

FORMATS: Final = (
    "CSV, GPX, KML, GeoJSON, NMEA 0183, MCAP (log of a run, LocationFix, NavSatFix) or a folder "
    "of KITTI oxts"
)
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
