"""The format of a file: by its content, and else by its name."""

from pathlib import Path

import pytest

from scenarios.definition.traces.drive import TraceError
from scenarios.definition.traces.formats.registry import BYTES_MAX, read_recorded
from tests.made.scenarios.recorded_drives import as_nmea, drive, write_log

CSV = b"latitude_deg,longitude_deg\n52.1,13.1\n52.2,13.2\n"
GPX = b'<gpx><trkpt lat="52.1" lon="13.1"/><trkpt lat="52.2" lon="13.2"/></gpx>'
KML = b"<kml><LineString><coordinates>13.1,52.1 13.2,52.2</coordinates></LineString></kml>"
GEOJSON = b'{"type": "LineString", "coordinates": [[13.1, 52.1], [13.2, 52.2]]}'


@pytest.mark.parametrize(
    ("name", "content", "format_name"),
    [
        (f"drive{suffix}", content, format_name)
        for content, format_name in (
            (CSV, "CSV"),
            (GPX, "GPX"),
            (b'<?xml version="1.0"?>\n<!-- a -->' + GPX, "GPX"),
            (KML, "KML"),
            (KML.replace(b"<kml", b'<?xml version="1.0"?><kml:kml'), "KML"),
            (GEOJSON, "GeoJSON"),
        )
        for suffix in (".csv", ".gpx", ".nmea", ".txt", ".kml", ".json", "")
    ],
)
def test_the_content_decides(tmp_path: Path, name: str, content: bytes, format_name: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    read = read_recorded(path)
    assert read.format_name == format_name
    assert read.position.tolist() == [[52.1, 52.2], [13.1, 13.2]]


@pytest.mark.parametrize("suffix", [".csv", ".gpx", ".nmea", ".txt", ".log"])
def test_sentences_are_read_from_any_file(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"drive{suffix}"
    path.write_bytes(b"# logger 1.0\n" + as_nmea(drive()))
    assert (read_recorded(path).format_name, read_recorded(path).count) == ("NMEA 0183", 201)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "^empty file$"),
        (
            b"some words\nwithout a drive\n",
            "^unknown content, allowed CSV, GPX, KML, GeoJSON, NMEA",
        ),
        (b"<!DOCTYPE html><html><p>1, 2</p>", "^XML with root html"),
        (b"PK\x03\x04", "unpack it first"),
        (b"\x89PNG\r\n\x1a\n\0\0", "^binary data, allowed CSV"),
    ],
)
def test_unknown_content_is_refused(tmp_path: Path, content: bytes, reason: str) -> None:
    path = tmp_path / "drive.xyz"
    path.write_bytes(content)
    with pytest.raises(TraceError, match=reason):
        read_recorded(path)


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TraceError, match=r"^no such file$"):
        read_recorded(tmp_path / "a")
    with pytest.raises(TraceError, match=r"^a folder, allowed a file"):
        read_recorded(tmp_path)
    with pytest.raises(TraceError, match=r"^not a file$"):
        read_recorded(Path("/dev/null"))
    with pytest.raises(TraceError, match="too long"):
        read_recorded(tmp_path / ("a" * 300))
    with pytest.raises(TraceError, match="null"):
        read_recorded(Path("a\0b"))
    with (tmp_path / "large").open("wb") as file:
        file.truncate(BYTES_MAX + 1)
    with pytest.raises(TraceError, match=r"^larger than 200 MB"):
        read_recorded(tmp_path / "large")


def test_vehicle_and_topic_select_in_logs_only(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(CSV)
    with pytest.raises(TraceError, match="given vehicle v2, allowed only for"):
        read_recorded(tmp_path / "a.csv", vehicle="v2")
    with pytest.raises(TraceError, match="given topic /gps, allowed only for an MCAP file"):
        read_recorded(tmp_path / "a.csv", topic="/gps")
    write_log(tmp_path / "run.mcap", drive()[:3])
    read = read_recorded(tmp_path / "run.mcap", vehicle="v2")
    assert (read.format_name, read.count) == ("MCAP", 3)
