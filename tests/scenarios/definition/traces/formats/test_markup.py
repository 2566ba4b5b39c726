"""GPX and KML: shapes, values of points, and damaged files."""

import numpy as np
import pytest

from scenarios.definition.traces.drive import DriveTable, TraceError
from scenarios.definition.traces.formats.markup import read_gpx, read_kml

NAN = float("nan")


def point(k: int, name: str = "trkpt", more: str = "") -> str:
    """Point k at latitude 52.k, longitude 13.k, k m, k s after noon, in a line of its own."""
    time = f"2026-03-29T12:00:0{k}Z"
    return f'<{name} lat="52.{k}" lon="13.{k}"><ele>{k}</ele><time>{time}</time>{more}</{name}>\n'


def gpx(points: str, head: str = '<?xml version="1.0"?>') -> str:
    return f"{head}<gpx><trk><name>a</name><trkseg>\n{points}</trkseg></trk></gpx>"


def points_of(drive: DriveTable) -> list[int]:
    """The k of the points, after a comparison of all their values."""
    ks = np.rint((drive.position[0] - 52.0) * 10).astype(int)
    assert np.allclose(drive.position, [52.0 + ks / 10, 13.0 + ks / 10], rtol=0, atol=1e-12)
    assert np.allclose(drive.altitude_m, ks)
    assert np.allclose(drive.time_s + drive.zero_s, 1_774_785_600 + ks)
    assert drive.clock == "unix"
    return [int(k) for k in ks]


def left_out(drive: DriveTable) -> list[tuple[int, str]]:
    return sorted((record.number, record.reason) for record in drive.left_out.records)


THREE = point(1) + point(2) + point(3)
IN_A_NAME = gpx(THREE).replace("<name>a", "<name>{}")


@pytest.mark.parametrize(
    "text",
    [
        gpx(THREE),
        gpx(THREE, '\ufeffjunk <?xml version="1.0" encoding="UTF-16"?>'),
        gpx(point(1) + "</trkseg><trkseg>" + point(2) + "</trkseg></trk><trk><trkseg>" + point(3)),
        gpx(THREE).replace("trk", "g:trk").replace("ele>", "x:ele>"),  # prefixes without namespace
        gpx(THREE) + point(4, "wpt") + point(5, "rtept"),
        f"<gpx><rte>{THREE.replace('trkpt', 'rtept')}</rte>{point(7, 'wpt')}</gpx>",
        f"<gpx>{THREE.replace('trkpt', 'wpt')}</gpx>",
        IN_A_NAME.format("Tom & Jerry &nbsp; &bomb; &#228;"),
        IN_A_NAME.format("<![CDATA[<trkpt> & ]]>\x01\x02"),
        gpx(THREE, '<!DOCTYPE a [<!ENTITY b "&c;&c;"><!ENTITY f SYSTEM "file:///etc/hosts">]>'),
        gpx(THREE).replace('"', "'").replace("<ele>", "<ele> "),
    ],
)
def test_tracks_or_else_routes_or_waypoints_are_read(text: str) -> None:
    drive = read_gpx(text)
    assert points_of(drive) == [1, 2, 3]
    assert drive.numbers.tolist() == [1, 2, 3]
    assert all("damaged" in reason for _, reason in left_out(drive))


@pytest.mark.parametrize(
    ("text", "points", "line"),
    [
        (gpx(THREE)[:-60], [1, 2], 4),  # truncated
        (gpx(THREE) + "rubbish <", [1, 2, 3], 5),
        (gpx(THREE).replace("</trkseg>", ""), [1, 2, 3], 5),
    ],
)
def test_points_before_the_damage_are_read(text: str, points: list[int], line: int) -> None:
    drive = read_gpx(text)
    assert points_of(drive) == points
    ((_, reason),) = left_out(drive)
    assert reason.startswith(f"damaged XML at line {line}: ")


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('lat="52.2"', 'lat="abc"', "latitude is 'abc'"),
        ('lat="52.2"', 'lat="NaN"', "latitude is 'NaN'"),
        ('lon="13.2"', "", "no longitude"),
        ('lon="13.2"', 'lon="1e999"', "longitude is '1e999'"),
    ],
)
def test_a_point_without_position_is_left_out(old: str, new: str, reason: str) -> None:
    drive = read_gpx(gpx(THREE).replace(old, new))
    assert points_of(drive) == [1, 3]
    assert drive.numbers.tolist() == [1, 3]
    assert left_out(drive) == [(2, reason)]


def test_other_values_never_remove_a_point() -> None:
    inside = "<extensions><x:TPX><x:speed>{}</x:speed></x:TPX></extensions>"
    points = point(1, more="<speed>1.5</speed>") + point(2, more=inside.format("2.5"))
    points += point(3, more=inside.format("fast")).replace("<ele>3", "<ele>NaN")
    points += point(4).replace("12:00:04Z", "noon").replace('lat="52.4"', 'lat="52,4"')
    drive = read_gpx(gpx(points))
    assert np.allclose(drive.position[0], [52.1, 52.2, 52.3, 52.4])
    assert np.allclose(drive.speed_mps, [1.5, 2.5, NAN, NAN], equal_nan=True)
    assert np.allclose(drive.altitude_m, [1, 2, NAN, 4], equal_nan=True)
    assert np.allclose(drive.time_s, [0, 1, 2, NAN], equal_nan=True)
    assert drive.left_out.counts.total() == 0


@pytest.mark.parametrize("text", ["<gpx></gpx>", "<gpx", "<kml/>", gpx("")])
def test_files_without_points_are_refused(text: str) -> None:
    with pytest.raises(TraceError, match="no points in its tracks, routes and waypoints"):
        read_gpx(text)
    with pytest.raises(TraceError, match="no coordinates in its lines, tracks and points"):
        read_kml(text)


# --- KML


def kml(*shapes: str) -> str:
    return "<kml>" + "".join(f"<Placemark>{shape}</Placemark>" for shape in shapes) + "</kml>"


def shape(coordinates: str, name: str = "LineString") -> str:
    return f"<{name}><coordinates>{coordinates}</coordinates></{name}>"


def track(ks: range) -> str:
    whens = "".join(f"<when>2026-03-29T12:00:0{k}Z</when>" for k in ks)
    coords = "".join(f"<gx:coord>13.{k} 52.{k} {k}</gx:coord>" for k in ks)
    return f"<gx:Track>{whens}{coords}</gx:Track>"


LINE = shape("13.1,52.1,1 13.2,52.2,2\n\t13.3,52.3,3\n")


@pytest.mark.parametrize(
    "text",
    [
        kml(LINE),
        kml(LINE.replace(",", " , ")),
        kml(shape("13.1,52.1,1"), shape("13.2,52.2,2 13.3,52.3,3"), shape("1,2,3", "Point")),
        kml(f"<MultiGeometry>{shape('13.1,52.1,1 13.2,52.2,2')}{shape('13.3,52.3,3')}"),
        kml(
            f"<Polygon>{LINE.replace('LineString', 'LinearRing')}</Polygon>", shape("1,2", "Point")
        ),
        kml(*(shape(f"13.{k},52.{k},{k}", "Point") for k in (1, 2, 3))),
    ],
)
def test_lines_are_read_in_their_order(text: str) -> None:
    drive = read_kml(text)
    assert np.allclose(drive.position, [[52.1, 52.2, 52.3], [13.1, 13.2, 13.3]])
    assert drive.altitude_m.tolist() == [1, 2, 3]
    assert drive.clock is None


@pytest.mark.parametrize(
    "text",
    [
        kml(LINE, track(range(1, 4))),
        kml(f"<gx:MultiTrack>{track(range(1, 2))}{track(range(2, 4))}</gx:MultiTrack>"),
        kml(track(range(1, 4))).replace("gx:", ""),
        kml(track(range(1, 4)))[: kml(track(range(1, 4))).index("</gx:Track>")],
        kml(
            *(
                f"<TimeStamp><when>2026-03-29T12:00:0{k}Z</when></TimeStamp>"
                + shape(f"13.{k},52.{k},{k}", "Point")
                for k in (1, 2, 3)
            )
        ),
    ],
)
def test_tracks_and_stamped_points_have_times(text: str) -> None:
    assert points_of(read_kml(text)) == [1, 2, 3]
