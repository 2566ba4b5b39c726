"""Formats other than tables: their points, damage, vehicles, and what is refused by name."""

import gzip
import json
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from mcap.writer import CompressionType, Writer

from scenarios.definition.traces.drive import DriveTable, TraceError
from scenarios.definition.traces.formats.registry import BYTES_MAX, decoded, read_recorded
from tests.made.scenarios.recorded_drives import as_nmea, sentence, write_log
from tests.made.scenarios.recorded_drives import drive as made_drive

NOON = 1_774_785_600
NAN = float("nan")


def read(folder: Path, content: str | bytes | object, name: str = "a", **keys: str) -> DriveTable:
    data = content if isinstance(content, str | bytes) else json.dumps(content)
    (folder / name).write_bytes(data.encode() if isinstance(data, str) else data)
    return read_recorded(folder / name, **keys)


def ks_of(drive: DriveTable, *, timed: bool = True) -> list[int]:
    """The k of points at latitude 52.k, longitude 13.k and k m, k s after noon."""
    ks = np.rint((drive.position[0] - 52.0) * 10)
    np.testing.assert_allclose(drive.position, [52.0 + ks / 10, 13.0 + ks / 10])
    np.testing.assert_allclose(drive.altitude_m, ks)
    if timed:
        np.testing.assert_allclose(drive.time_s + drive.zero_s, NOON + ks)
    assert drive.clock == ("unix" if timed else None)
    return [int(k) for k in ks]


# ---- GPX, KML, GeoJSON and SUMO


def point(k: int, name: str = "trkpt", more: str = "") -> str:
    time = f"2026-03-29T12:00:0{k}Z"
    return f'<{name} lat="52.{k}" lon="13.{k}"><ele>{k}</ele><time>{time}</time>{more}</{name}>\n'


def gpx(points: str, head: str = '<?xml version="1.0"?>') -> str:
    return f"{head}<gpx><trk><name>a</name><trkseg>\n{points}</trkseg></trk></gpx>"


THREE = point(1) + point(2) + point(3)
NAMED = gpx(THREE).replace("<name>a", "<name>{}")


def track(ks: range) -> str:
    whens = "".join(f"<when>2026-03-29T12:00:0{k}Z</when>" for k in ks)
    coords = "".join(f"<gx:coord>13.{k} 52.{k} {k}</gx:coord>" for k in ks)
    return f"<gx:Track>{whens}{coords}</gx:Track>"


def shape(coordinates: str, name: str = "LineString") -> str:
    return f"<{name}><coordinates>{coordinates}</coordinates></{name}>"


def stamped(k: int) -> str:
    when = f"<TimeStamp><when>2026-03-29T12:00:0{k}Z</when></TimeStamp>"
    return f"<Placemark>{when}{shape(f'13.{k},52.{k},{k}', 'Point')}</Placemark>"


PLACES = [[13.1, 52.1, 1], [13.2, 52.2, 2], [13.3, 52.3, 3]]
STAMPS = [f"2026-03-29T12:00:0{k}Z" for k in (1, 2, 3)]
LINE = {"type": "LineString", "coordinates": PLACES}


def feature(geometry: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties or None}


def at(place: list[float]) -> dict[str, Any]:
    return {"type": "Point", "coordinates": place}


TIMED: dict[str, Any] = {
    "track": gpx(THREE),
    "another encoding is declared": gpx(
        THREE, '\ufeffjunk <?xml version="1.0" encoding="UTF-16"?>'
    ),
    "prefixes without namespace": gpx(THREE).replace("trk", "g:trk").replace("ele>", "x:ele>"),
    "a track rather than waypoints": gpx(THREE).replace("</gpx>", point(4, "wpt") + "</gpx>"),
    "route": f"<gpx><rte>{THREE.replace('trkpt', 'rtept')}</rte>{point(7, 'wpt')}</gpx>",
    "entities": NAMED.format("Tom & Jerry &nbsp; &bomb; &#228;"),
    "CDATA": NAMED.format("<![CDATA[<trkpt> & ]]>\x01\x02"),
    "DTD": gpx(THREE, '<!DOCTYPE a [<!ENTITY b "&c;"><!ENTITY f SYSTEM "file:///etc/hosts">]>'),
    "KML track": f"<kml><Placemark>{shape('1,2')}{track(range(1, 4))}</Placemark></kml>",
    "KML tracks": f"<kml>{track(range(1, 2))}{track(range(2, 4))}</kml>".replace("gx:", ""),
    "KML stamps": f"<kml>{stamped(1)}{stamped(2)}{stamped(3)}</kml>",
    "coordTimes": feature(LINE, coordTimes=STAMPS),
    "coordinateProperties": feature(LINE, coordinateProperties={"times": STAMPS}),
    "MultiLineString": feature(
        {"type": "MultiLineString", "coordinates": [PLACES]}, coordTimes=[STAMPS]
    ),
    "points": [feature(at(p), Timestamp=t) for p, t in zip(PLACES, STAMPS, strict=True)],
}
UNTIMED: dict[str, Any] = {
    "KML line": f"<kml>{shape('13.1 , 52.1,1 13.2,52.2,2  13.3,52.3,3')}</kml>",
    "KML lines": f"<kml:kml>{shape('13.1,52.1,1')}{shape('13.2,52.2,2 13.3,52.3,3')}</kml:kml>",
    "line": LINE,
    "a line rather than points": [feature(at([1, 2])), feature(LINE)],
    "collection": {"type": "GeometryCollection", "geometries": [LINE]},
    "MultiPoint": {"type": "MultiPoint", "coordinates": PLACES},
    "locations": {"locations": [feature(at(place)) for place in PLACES]},
}


@pytest.mark.parametrize("name", ["a.gpx", "a.csv", "a"])
@pytest.mark.parametrize("content", TIMED.values(), ids=TIMED)
def test_points_with_times(tmp_path: Path, content: Any, name: str) -> None:
    drive = read(tmp_path, content, name)
    assert ks_of(drive) == drive.numbers.tolist() == [1, 2, 3]


@pytest.mark.parametrize("content", UNTIMED.values(), ids=UNTIMED)
def test_lines_without_times(tmp_path: Path, content: Any) -> None:
    assert ks_of(read(tmp_path, content), timed=False) == [1, 2, 3]


@pytest.mark.parametrize(
    ("text", "points", "line"),
    [
        (gpx(THREE)[:-60], [1, 2], 4), (gpx(THREE) + "rubbish <", [1, 2, 3], 5),
        (gpx(THREE).replace("</trkseg>", ""), [1, 2, 3], 5),
        (f"<kml>{track(range(1, 3))}"[:-9], [1, 2], 1),
    ],
)  # fmt: skip
def test_points_before_the_damage_are_read(
    tmp_path: Path, text: str, points: list[int], line: int
) -> None:
    drive = read(tmp_path, text)
    assert ks_of(drive) == points
    assert drive.left_out.records[0].reason.startswith(f"damaged XML at line {line}")


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('lat="52.2"', 'lat="abc"', "latitude is 'abc'"), ('lon="13.2"', "", "no longitude"),
        ('lon="13.2"', 'lon="1e999"', "longitude is '1e999'"),
    ],
)  # fmt: skip
def test_a_point_without_position_is_left_out(
    tmp_path: Path, old: str, new: str, reason: str
) -> None:
    drive = read(tmp_path, gpx(THREE).replace(old, new))
    assert ks_of(drive) == drive.numbers.tolist() == [1, 3]
    assert [(one.number, one.reason) for one in drive.left_out.records] == [(2, reason)]
    places = [PLACES[0], [None, 52], ["x", 52], 5, [{}, []], [10**400, 52], PLACES[1]]
    drive = read(tmp_path, {"type": "LineString", "coordinates": places})
    assert drive.numbers.tolist() == [1, 7]


def test_other_values_never_remove_a_point(tmp_path: Path) -> None:
    inside = "<extensions><x:TPX><x:speed>{}</x:speed></x:TPX></extensions>"
    points = point(1, more="<speed>1.5</speed>") + point(2, more=inside.format("2.5"))
    points += point(3, more=inside.format("fast")).replace("<ele>3", "<ele>NaN")
    points += point(4).replace("12:00:04Z", "noon").replace('lat="52.4"', 'lat="52,4"')
    drive = read(tmp_path, gpx(points))
    np.testing.assert_allclose(drive.position[0], [52.1, 52.2, 52.3, 52.4])
    np.testing.assert_allclose(drive.speed_mps, [1.5, 2.5, NAN, NAN])
    np.testing.assert_allclose(drive.altitude_m, [1, 2, NAN, 4])
    np.testing.assert_allclose(drive.time_s, [0, 1, 2, NAN])


def test_a_vehicle_of_sumo_is_selected(tmp_path: Path) -> None:
    rows = "".join(
        f'<timestep time="{k}"><vehicle id="a" x="{k}" y="1" speed="2"/>'
        f'<vehicle id="b" x="9" y="{k}" speed="3"/></timestep>'
        for k in range(3)
    )
    text = f"<fcd-export>{rows}</fcd-export>"
    with pytest.raises(TraceError, match=r"2 vehicles, a, b: set path\.vehicle"):
        read(tmp_path, text)
    drive = read(tmp_path, text, vehicle="b")
    assert (drive.geodetic, drive.position.tolist()) == (False, [[9] * 3, [0, 1, 2]])
    assert (drive.time_s.tolist(), drive.speed_mps.tolist()) == ([0, 1, 2], [3] * 3)


# ---- NMEA 0183


KS = range(5)


def where(k: int) -> str:
    return f"5230.{k:04d},N,01324.{k:04d},E"


def gga(k: int, at: str = "", place: str | None = None, quality: int = 4) -> str:
    position = where(k) if place is None else place
    clock = at or f"1200{k:02d}.00"
    return sentence(f"GNGGA,{clock},{position},{quality},12,0.8,100.0,M,40.0,M,,")


def rmc(k: int, at: str = "", date: str = "290326", talker: str = "GN") -> str:
    clock = at or f"1200{k:02d}.00"
    return sentence(f"{talker}RMC,{clock},A,{where(k)},{k}.0,90.0,{date},,,A")


def sentences_of(drive: DriveTable) -> list[int]:
    ks = np.rint((drive.position[0] - 52.5) * 600_000)
    np.testing.assert_allclose(drive.position[1], 13.4 + ks / 600_000, rtol=0, atol=1e-12)
    return [int(k) for k in ks]


@pytest.mark.parametrize(
    "lines",
    [
        [line for k in KS for line in (gga(k), rmc(k))],
        [*map(rmc, KS), *map(gga, KS)],  # in blocks
        [line for k in range(6) for line in ([gga(k)] * (k < 5) + [rmc(k - 1)] * (k > 0))],  # late
        [line for k in KS for line in (gga(k), rmc(k, talker="GP"), rmc(k))],
        [line for k in KS for line in ([gga(k)] * (k != 2) + [rmc(k)])],
    ],
)
def test_sentences_of_one_time_become_one_point_with_speed(
    tmp_path: Path, lines: list[str]
) -> None:
    drive = read(tmp_path, "\r\n".join(lines), "a.csv")
    assert sentences_of(drive) == [*KS]
    np.testing.assert_allclose(drive.speed_mps, np.arange(5) * 1852 / 3600)
    np.testing.assert_allclose(drive.time_s + drive.zero_s, NOON + np.arange(5))
    assert (drive.clock, drive.format_name) == ("unix", "NMEA 0183")
    assert not drive.left_out.counts


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("\r".join(map(gga, KS)), [1, 2, 3, 4, 5]), ("".join(map(gga, KS)), [1, 1, 1, 1, 1]),
        ("\r\n".join(f"12:00 \0\0{gga(k)} x" for k in KS), [1, 2, 3, 4, 5]),
        ("!AIVDM,1,1,,A,x,0*00\n" + "\n".join(map(gga, KS)) + "\n", [2, 3, 4, 5, 6]),
    ],
)  # fmt: skip
def test_sentences_are_found_anywhere_in_a_line(
    tmp_path: Path, text: str, numbers: list[int]
) -> None:
    drive = read(tmp_path, text)
    assert (sentences_of(drive), drive.numbers.tolist()) == ([*KS], numbers)
    assert (drive.clock, drive.left_out.counts.total()) == ("day", 0)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (gga(2)[:30], "wrong or missing checksum"),
        (gga(2).replace("5230", "5231"), "wrong or missing checksum"),
        ("rubbish", "not a sentence"), (gga(2, place=",,,", quality=0), "no fix"),
        (gga(2, place="52x0.1,N,01324.0,E"), "position is '52x0.1,N,01324.0,E'"),
    ],
)  # fmt: skip
def test_a_damaged_line_is_left_out(tmp_path: Path, line: str, reason: str) -> None:
    drive = read(tmp_path, "\n".join(line if k == 2 else gga(k) for k in KS))
    assert sentences_of(drive) == [0, 1, 3, 4]
    assert [(one.number, one.reason) for one in drive.left_out.records] == [(3, reason)]


@pytest.mark.parametrize(
    ("clocks", "dates", "times"),
    [
        (("235959.5", "000000.0", "000000.5"), ("290326", "300326", "300326"), (0, 0.5, 1)),
        (("235959.0", "235959.5", "000000.0"), ("290326",) * 3, (0, 0.5, 1)),  # a late date
        (("120000", "120001", "120002"), ("120806", "290326", "290326"), (0, 1, 2)),
        (("120000", "120001", "130001"), ("290326", "290326", "310326"), (0, 1, 176_401)),
        (("120000", "120001", "120002"), ("310226", "", "290326"), (0, 1, 2)),
    ],
)
def test_dates_make_unix_times(
    tmp_path: Path, clocks: tuple[str, ...], dates: tuple[str, ...], times: tuple[float, ...]
) -> None:
    rows = [rmc(k, at, date) for k, (at, date) in enumerate(zip(clocks, dates, strict=True))]
    drive = read(tmp_path, "\n".join(rows))
    assert (drive.clock, drive.zero_s) == ("unix", NOON - 43_200)
    assert (drive.time_s - drive.time_s[0]).tolist() == pytest.approx(list(times))


def test_other_sentences_have_positions_speeds_and_dates(tmp_path: Path) -> None:
    lines = [
        line
        for k in KS
        for line in (
            sentence(f"GNGNS,1200{k:02d}.00,{where(k)},NA,12,0.8,100.0,40.0,,"),
            sentence(f"GPVTG,90,T,,M,{k}.0,N,9,K,A"),
            sentence(f"GPZDA,1200{k:02d}.00,29,03,2026,00,00"),
        )
    ]
    drive = read(tmp_path, "\n".join(lines))
    assert sentences_of(drive) == [*KS]
    np.testing.assert_allclose(drive.speed_mps, np.arange(5) * 1852 / 3600)
    assert (drive.altitude_m.tolist(), drive.zero_s) == ([140.0] * 5, NOON - 43_200)
    unfit = read(tmp_path, "\n".join(gga(k, quality=int(k > 1)).partition("*")[0] for k in KS))
    assert (sentences_of(unfit), len(unfit.remarks)) == ([*KS], 2)


# ---- MCAP


def protobuf(k: int) -> LocationFix:
    fix = LocationFix(latitude=52 + k / 10, longitude=13 + k / 10, altitude=k)
    fix.timestamp.seconds = NOON + k
    return fix


def as_json(k: int, stamp: str = "timestamp") -> bytes:
    fix = {"latitude": 52 + k / 10, "longitude": 13 + k / 10, "altitude": k}
    return json.dumps({stamp: {"sec": NOON + k, "nsec": 0}, **fix}).encode()


def binary(k: int, frames: tuple[bytes, ...], order: str, *, status: bool = True) -> bytes:
    """A message of ROS 2: each value is aligned to its size behind the first four bytes."""
    data = struct.pack(f"{order}iI", NOON + k, 0)
    for frame in frames:
        data += bytes(-len(data) % 4) + struct.pack(f"{order}I", len(frame) + 1) + frame + b"\0"
    if status:
        data += b"\0"
        data += bytes(-len(data) % 2) + struct.pack(f"{order}H", 1)
    place = struct.pack(f"{order}ddd", 52 + k / 10, 13 + k / 10, k)
    data += bytes(-len(data) % 8) + place + bytes(80)
    return (b"\0\1\0\0" if order == "<" else b"\0\0\0\0") + data


def write(
    path: Path, schema: str, encoding: str, messages: Iterable[bytes], topics: Iterable[str]
) -> None:
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, use_chunking=False)
        writer.start()
        number = writer.register_schema(schema, "x", b"")
        for topic in topics:
            channel = writer.register_channel(topic, encoding, number)
            for k, data in enumerate(messages):
                log_time = (NOON + k) * 10**9
                writer.add_message(channel, log_time=log_time, publish_time=log_time, data=data)
        writer.finish()  # type: ignore[no-untyped-call]


POSE = {"position": {"x": 52.0, "y": 13.0, "z": 0}}
KINDS: dict[str, tuple[str, str, list[bytes]]] = {
    "protobuf": ("foxglove.LocationFix", "protobuf", [protobuf(k).SerializeToString() for k in KS]),
    "json": ("foxglove.LocationFix", "json", [*map(as_json, KS)]),
    "times of the log": ("foxglove.LocationFix", "json", [as_json(k, "no") for k in KS]),
    **{
        f"ROS 2, {frame.decode()} {order}": (
            "sensor_msgs/msg/NavSatFix", "cdr", [binary(k, (frame,), order) for k in KS]
        )
        for frame, order in ((b"gps_link", "<"), (b"gps", "<"), (b"", "<"), (b"map", ">"))
    },
    "odometry": (
        "nav_msgs/msg/Odometry", "cdr", [binary(k, (b"map", b"b"), "<", status=False) for k in KS]
    ),
    "pose": (
        "geometry_msgs/msg/PoseStamped", "cdr", [binary(k, (b"m",), "<", status=False) for k in KS]
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_positions_of_other_programs_are_read(tmp_path: Path, kind: str) -> None:
    write(tmp_path / "a.mcap", *KINDS[kind], ["/gps"])
    for topic in (None, "/gps"):
        drive = read_recorded(tmp_path / "a.mcap", topic=topic)
        assert ks_of(drive) == [*KS]
        assert drive.geodetic == (kind not in ("odometry", "pose"))
        assert (drive.unit, drive.left_out.counts.total()) == ("message", 0)


def test_a_topic_is_chosen_if_several_have_positions(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path, "foxglove.LocationFix", "json", [*map(as_json, KS)], ["/front", "/rear"])
    with pytest.raises(TraceError, match=r"2 topics have positions: /front, /rear\..*path\.topic"):
        read_recorded(path)
    assert read_recorded(path, topic="/rear").count == 5
    with pytest.raises(TraceError, match="given topic /gps, allowed /front, /rear"):
        read_recorded(path, topic="/gps")


def test_damaged_and_other_mcap_files(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path, "foxglove.LocationFix", "json", map(as_json, KS), ["/gps"])
    content = path.read_bytes()
    path.write_bytes(content[: content.index(as_json(2)) + 5])
    drive = read_recorded(path)
    assert drive.numbers.tolist() == [1, 2]
    assert [(one.number, one.kind) for one in drive.left_out.records] == [(3, "damaged")]
    write(path, "foxglove.Log", "json", map(as_json, KS), ["/log"])
    with pytest.raises(TraceError, match="no LocationFix, NavSatFix"):
        read_recorded(path)


def test_the_log_of_a_run_keeps_its_times(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write_log(path, made_drive()[:5])
    drive = read_recorded(path, vehicle="v2")
    assert drive.time_s.tolist() == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    assert (drive.clock, drive.format_name, drive.speed_mps.tolist()) == (
        "unix",
        "MCAP",
        [12.0] * 5,
    )
    with pytest.raises(TraceError, match="given vehicle v9, allowed v1, v2"):
        read_recorded(path, vehicle="v9")
    assert read_recorded(path, topic="/convoy/v2/location").count == 5


# ---- Texts, and files that are refused


LINES = "höhe;lat\r\n1,5;52\r\n" * 4


@pytest.mark.parametrize(
    ("data", "text"),
    [
        *((LINES.encode(name), LINES) for name in (
            "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1", "utf-32"
        )),
        (b"caf\xe9,\xc3\xa9\n1,2", "café,é\n1,2"),  # Latin-1 in UTF-8
        (b"\0\0\0$GPGGA,\r\n$GPRMC,", "$GPGGA,\r\n$GPRMC,"),
        (b"1,2\n\0\0\n3,4\0\0\n", "1,2\n\n3,4\n"),
        (b"1,5\0\0\0,6\n7,8", "1,5\ufffd,6\n7,8"),  # digits are lost
        (b"\xff\xfea\0,\0b\0\n\0\x31", "a,b\n\ufffd"),  # half a character
    ],
)  # fmt: skip
def test_encodings_and_damaged_bytes(data: bytes, text: str) -> None:
    assert decoded(data) == text


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b" \r\n\0", "^empty file$"),
        (b"some words\nwithout a drive\n", "^unknown content, allowed CSV, GPX, KML, "),
        (b"<!DOCTYPE html><html><p>1, 2</p>", "^XML with root html"),
        (b"<osm><node/></osm>", "^XML with root osm"),
        (gzip.compress(b"x_m,y_m", mtime=0), "^a gzip file: unpack it first"),
        (b"PK\x03\x04doc.kml", "^a ZIP or KMZ archive: unpack it first"),
        (b"\x89PNG\r\n\x1a\n\0\0", "^binary data, allowed CSV"),
        (b"SQLite format 3\0" + b"plain words", "^binary data, allowed CSV"),
        (b"File created on 01/06/2026 at 10:00:00\n\n[header]\ntime\n", "^a VBO file"),
        (b'{"class":"VERSION","rev":1}\n{"class":"TPV"}\n', "^JSON lines, .*keys: class, rev"),
        (b'[{"time": 1, "lat": 2, "lon": 3}]', "^JSON, but .*keys: time, lat, lon"),
        (b'{"type": "LineString", "coordinates": [[1', "^not valid JSON"),
        (b'{"a": ' + b"[" * 50_000, "^not valid JSON"),
        (b"$PUBX,00,100000.00,5230.0,N,01315.0,E*68\n", "no valid GGA, RMC, GLL or GNS sentence"),
        (b"<gpx></gpx>", "^no points in its tracks"), (b"<kml/>", "^no coordinates in its lines"),
    ],
)  # fmt: skip
def test_other_content_is_refused_by_name(tmp_path: Path, content: bytes, reason: str) -> None:
    with pytest.raises(TraceError, match=reason) as refused:
        read(tmp_path, content, "drive.xyz")
    assert "\n" not in str(refused.value)


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    with (tmp_path / "large").open("wb") as file:
        file.truncate(BYTES_MAX + 1)
    for path, reason in (
        (tmp_path / "a", "^no such file$"), (tmp_path, "^a folder, allowed a file"),
        (Path("/dev/null"), "^not a file$"), (tmp_path / ("a" * 300), "too long"),
        (Path("a\0b"), "null"), (tmp_path / "large", "^larger than 200 MB"),
    ):  # fmt: skip
        with pytest.raises(TraceError, match=reason):
            read_recorded(path)


def test_vehicle_and_topic_select_where_there_are_any(tmp_path: Path) -> None:
    for content in (gpx(THREE), "x,y\n1,2\n2,3\n", as_nmea(made_drive())):
        with pytest.raises(TraceError, match="given vehicle v2, allowed only for"):
            read(tmp_path, content, vehicle="v2")
    with pytest.raises(TraceError, match="given topic /gps, allowed only for an MCAP file"):
        read(tmp_path, gpx(THREE), topic="/gps")
