"""Encodings of text files, damaged bytes and binary data."""

import gzip
import random
import re

import pytest

from scenarios.definition.traces.drive import TraceError
from scenarios.definition.traces.formats.registry import decoded

LINES = "höhe;lat\r\n1,5;52\r\n" * 4


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1", "utf-32"]
)
def test_common_encodings_are_recognised(encoding: str) -> None:
    assert decoded(LINES.encode(encoding)) == LINES


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"caf\xe9,\xc3\xa9\n1,2", "café,é\n1,2"),  # Latin-1 in UTF-8
        (b"\0\0\0$GPGGA,\r\n$GPRMC,", "$GPGGA,\r\n$GPRMC,"),
        (b"log\0\0$GPGGA,", "log$GPGGA,"),
        (b"1,2\n\0\0\0", "1,2\n"),
        (b"1,2\n\0\0\n3,4\0\0\n", "1,2\n\n3,4\n"),
        (b"1,5\0\0\0,6\n7,8", "1,5\ufffd,6\n7,8"),  # digits are lost
        (b"\xff\xfea\0,\0b\0\n\0\x31", "a,b\n\ufffd"),  # half a character
        (b"1,2\n\x01\x02\n" + b"3,4\n" * 20, "1,2\n\x01\x02\n" + "3,4\n" * 20),
    ],
)
def test_damaged_bytes_spoil_their_own_line_only(data: bytes, text: str) -> None:
    assert decoded(data) == text


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "^empty file$"),
        (b" \r\n", "^empty file$"),
        (b"\0" * 100, "^empty file$"),
        (b"\xff\xfe", "^empty file$"),
        (gzip.compress(b"x_m,y_m", mtime=0), "^a gzip file: unpack it first"),
        (b"PK\x03\x04doc.kml", "^a ZIP or KMZ archive: unpack it first"),
        (b"%PDF-1.4\nplain words", "^binary data, allowed CSV, GPX, KML, GeoJSON, NMEA"),
        (b"\x89PNG\r\n\x1a\n" + bytes(30), "^binary data, allowed CSV"),
        (b"SQLite format 3\0" + b"plain words", "^binary data, allowed CSV"),
        (b"\x0e\x10\x43\x08\x78\0\0\0.FIT" + b"plain words", "^binary data, allowed CSV"),
        (random.Random(1).randbytes(3000), "^binary data, allowed CSV"),
    ],
)
def test_other_files_are_refused_in_a_line(data: bytes, reason: str) -> None:
    with pytest.raises(TraceError) as refused:
        decoded(data)
    assert re.search(reason, str(refused.value))
    assert "\n" not in str(refused.value)
