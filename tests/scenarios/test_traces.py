"""Recorded drives: the same drive from every format, bad lines, refusals, and the lead's speed."""

import math
import operator
from collections.abc import Callable
from functools import cache, reduce
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.check import warnings
from scenarios.errors import ScenarioError
from scenarios.lead_speed import recorded
from scenarios.scenario import Scenario, scenario_from_text
from scenarios.trace_formats import TraceError
from scenarios.traces import read_trace
from transport.codec import encode
from transport.mcap_log import LogWriter
from transport.topics import TOPICS
from vehicles.geodesy import LocalPlane, Origin
from vehicles.messages import GpsPose

ORIGIN = Origin(48.1, 11.5, 500.0)
START = 1_700_000_000  # Unix time (s) at which the drive begins: 22:13:20 UTC

Drive = list[tuple[float, float, float, float]]
"""Time (s), east (m), north (m), speed (m/s)."""


def drive() -> Drive:
    """20 s round a left bend of 150 m radius at 12 m/s, ten points a second."""
    found = []
    for k in range(201):
        angle = 12.0 * 0.1 * k / 150.0
        east, north = 150.0 * math.sin(angle), 150.0 * (1.0 - math.cos(angle))
        found.append((0.1 * k, east, north, 12.0))
    return found


def geodetic(east: float, north: float) -> tuple[float, float]:
    return LocalPlane(ORIGIN).to_geodetic(east, north)[:2]


# --- Writers of each format, on their own: nothing of the project's reading is used


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
        clock = f"2023-11-14T22:13:{20 + t:09.6f}Z"
        if t >= 40.0:
            clock = f"2023-11-14T22:14:{t - 40:09.6f}Z"
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
    """GGA and RMC of a receiver north and east of Greenwich, with a sentence of another kind."""
    lines = []
    for t, e, n, v in points:
        latitude, longitude = geodetic(e, n)
        where = f"{sexagesimal(latitude, 2)},N,{sexagesimal(longitude, 3)},E"
        at = clock(begin + t)
        lines += [
            sentence(f"GNGGA,{at},{where},4,20,0.7,455.0,M,45.0,M,,"),
            sentence("GPGSV,1,1,01,01,40,083,46"),
            sentence(f"GNRMC,{at},A,{where},{v * 3600 / 1852:.6f},90.0,141123,,,A"),
        ]
    return "\r\n".join(lines).encode()


def write_log(path: Path, points: Drive) -> None:
    """A log in which v1 drives `points` and v2 stands beside them."""
    with LogWriter(path) as log:
        for seq, (t, e, n, v) in enumerate(points):
            at = START * 10**9 + round(t * 1e9)
            for vehicle, aside in (("v1", 0.0), ("v2", 50.0)):
                latitude, longitude = geodetic(e + aside, n + aside)
                pose = GpsPose(
                    vehicle=vehicle,
                    seq=seq,
                    measured_at_ns=at,
                    latitude_deg=latitude,
                    longitude_deg=longitude,
                    altitude_m=500.0,
                    heading_deg=0.0,
                    speed_mps=v,
                    yaw_rate_radps=0.0,
                )
                log.write(TOPICS["gps"], vehicle, encode(pose), at)


WRITERS: dict[str, Callable[[Drive], bytes]] = {
    "drive.csv": as_plane_csv,
    "semicolons.csv": as_geodetic_csv,
    "drive.gpx": as_gpx,
    "route.gpx": lambda points: as_gpx(points, "rtept", "rte"),
    "drive.nmea": as_nmea,
    "sentences.txt": as_nmea,
    "midnight.nmea": lambda points: as_nmea(points, 86_395.0),
}


@pytest.mark.parametrize("name", WRITERS)
def test_the_same_drive_comes_from_every_format(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(WRITERS[name](drive()))
    trace = read_trace(path, origin=ORIGIN)
    times, east, north, speeds = (np.array(column) for column in zip(*drive(), strict=True))
    assert trace.skipped == ()
    assert np.allclose(trace.east_m, east, atol=1e-3)
    assert np.allclose(trace.north_m, north, atol=1e-3)
    assert np.allclose(trace.time_s, times, atol=1e-5)
    if "gpx" not in name:  # GPX 1.1 has no speeds
        assert np.allclose(trace.speed_mps, speeds, atol=1e-5)


def test_waypoints_do_where_there_is_no_track(tmp_path: Path) -> None:
    path = tmp_path / "way.gpx"
    path.write_bytes(as_gpx(drive(), "wpt", "x").replace(b"<x>", b"").replace(b"</x>", b""))
    assert len(read_trace(path).east_m) == 201


def test_the_log_of_a_run_is_a_recorded_drive(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write_log(path, drive())
    east, north = ([row[k] for row in drive()] for k in (1, 2))
    lead = read_trace(path, origin=ORIGIN)
    assert np.allclose(lead.east_m, east, atol=1e-6)
    assert np.allclose(lead.speed_mps, 12.0)
    assert lead.time_s[-1] == pytest.approx(20.0)
    second = read_trace(path, origin=ORIGIN, vehicle="v2")
    assert np.allclose(second.north_m, np.add(north, 50.0), atol=1e-6)
    with pytest.raises(TraceError, match=r"run\.mcap: given vehicle v9, allowed v1, v2"):
        read_trace(path, vehicle="v9")


def test_without_an_origin_the_plane_touches_at_the_first_point(tmp_path: Path) -> None:
    path = tmp_path / "drive.nmea"
    path.write_bytes(as_nmea(drive()))
    trace = read_trace(path)
    assert trace.origin is not None
    assert (trace.origin.latitude_deg, trace.origin.longitude_deg) == pytest.approx((48.1, 11.5))
    assert trace.origin.altitude_m == pytest.approx(500.0)  # above the ellipsoid: 455 m + 45 m
    assert (trace.east_m[0], trace.north_m[0]) == pytest.approx((0.0, 0.0), abs=1e-6)


# --- A few bad lines


def test_bad_lines_are_skipped_and_counted_in_one_warning(tmp_path: Path) -> None:
    lines = as_nmea(drive()).decode().splitlines()
    lines[30] = lines[30][:-1] + ("0" if lines[30][-1] != "0" else "1")  # a wrong checksum
    lines[90] = lines[90][:25]  # a cut sentence
    lines[92] = ""
    lines[120] = "\ufffd\x01rubbish"
    lines[150] = sentence("GNGGA,221400.00,,,,,0,00,,,M,,M,,")  # no fix
    path = tmp_path / "noisy.nmea"
    path.write_text("\n".join(lines))
    trace = read_trace(path)
    assert [line.split(":")[0] for line in trace.skipped] == [
        "line 31",
        "line 91",
        "line 121",
        "line 151",
    ]
    assert len(trace.east_m) == 200  # RMC stands in for three of the lost, line 91's is lost too
    (warning,) = warnings(driven(path, "closed = false"))
    assert warning == (
        "noisy.nmea: 4 bad lines skipped, the first is line 31: wrong or missing checksum"
    )


def test_a_bad_cell_spoils_its_line_only(tmp_path: Path) -> None:
    lines = as_plane_csv(drive()).decode().splitlines()
    lines[5] = '0.4,"12,0,0,0'
    lines[7] = "0.6,nan,0,0,12"
    lines[9] = "0.8,9.6"
    path = tmp_path / "drive.csv"
    path.write_text("\n".join(lines))
    trace = read_trace(path)
    assert [line.split(":")[0] for line in trace.skipped] == ["line 6", "line 8", "line 10"]
    assert len(trace.east_m) == 198


# --- Drives that cannot be driven: one clear line each

CSV = "x_m,y_m\n"
GPX = '<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1">{}</gpx>'

BROKEN: dict[str, tuple[str, bytes | None, str]] = {
    "missing file": ("a.csv", None, "no such file"),
    "empty file": ("a.csv", b"", "empty file"),
    "blank lines": ("a.csv", b"\n \n", "empty file"),
    "header only": ("a.csv", CSV.encode(), "no valid point"),
    "one point": ("a.csv", f"{CSV}1,2\n".encode(), "only one valid point, line 2"),
    "NaN only": ("a.csv", f"{CSV}nan,nan\nnan,nan\n".encode(), "line 2: x_m is 'nan'"),
    "infinite": ("a.csv", f"{CSV}inf,1\n-inf,1\n".encode(), "line 2: x_m is 'inf'"),
    "always one place": ("a.csv", (CSV + "5,5\n" * 9).encode(), "all 9 points lie within 0.00 m"),
    "jump": (
        "a.csv",
        f"{CSV}0,0\n1,0\n1,1201\n".encode(),
        "line 4: 1.2 km from the point before",
    ),
    "no usable columns": (
        "a.csv",
        b"easting,northing\n1,2\n",
        "given easting, northing, allowed x_m, y_m or latitude_deg, longitude_deg",
    ),
    "no header": ("a.csv", b"1,2\n3,4\n", "no usable columns: given 1, 2"),
    "time runs back": (
        "a.csv",
        b"t_s,x_m,y_m\n0,0,0\n2,1,0\n1.5,2,0\n",
        "line 4: time runs back by 0.500 s",
    ),
    "nowhere on earth": (
        "a.csv",
        b"latitude_deg,longitude_deg\n95,1\n96,1\n",
        "line 2: latitude 95.0",
    ),
    "binary": ("a.csv", bytes(range(256)) * 4, "binary data"),
    "binary without zeros": ("a.csv", bytes(range(128, 256)) * 9, "no usable columns"),
    "broken log": ("a.mcap", b"\x89MCAP0\r\n" + b"\xff" * 40, "a.mcap: "),
    "cut GPX": ("a.gpx", GPX.encode()[:-3], "not valid GPX"),
    "GPX without points": ("a.gpx", GPX.format("<trk></trk>").encode(), "no points in its tracks"),
    "GPX that is something else": ("a.gpx", b"<html></html>", "no points"),
    "NMEA without a sentence": ("a.nmea", b"hello\nworld\n", "no valid GGA or RMC sentence"),
    "NMEA with wrong checksums": (
        "a.nmea",
        as_nmea(drive()).replace(b",N,", b",S,"),
        "line 1: wrong or missing checksum",
    ),
    "NMEA without a fix": (
        "a.nmea",
        sentence("GNRMC,221400.00,V,,,,,,,141123,,,N").encode(),
        "line 1: no fix",
    ),
}


@pytest.mark.parametrize(("name", "content", "why"), BROKEN.values(), ids=BROKEN)
def test_a_broken_drive_is_refused_in_one_line(
    tmp_path: Path, name: str, content: bytes | None, why: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    text = f'name = "a"\n[path]\nkind = "trace"\nfile = "{name}"\n'
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(text, label="a.toml", folder=tmp_path)
    (line,) = caught.value.lines
    assert line.startswith("a.toml: path.file: ")
    assert name in line
    assert why in line
    assert line.isprintable()


@cache
def written(name: str) -> bytes:
    return WRITERS[name](drive())


@settings(max_examples=60)
@given(
    name=st.sampled_from(sorted(WRITERS)),
    damage=st.lists(
        st.tuples(st.integers(0, 50_000), st.integers(0, 300), st.binary(max_size=12)),
        min_size=1,
        max_size=5,
    ),
)
def test_no_damage_to_a_file_gives_anything_but_a_drive_or_one_clear_line(
    tmp_path_factory: pytest.TempPathFactory, name: str, damage: list[tuple[int, int, bytes]]
) -> None:
    content = written(name)
    for at, removed, put in damage:
        at %= max(len(content), 1)  # noqa: PLW2901 - a place within the file
        content = content[:at] + put + content[at + removed :]
    path = tmp_path_factory.mktemp("damaged") / name
    path.write_bytes(content)
    lines: tuple[str, ...] = ("ok",)
    try:
        assert driven(path).duration_s > 0.0
    except ScenarioError as error:
        lines = error.lines
    (line,) = lines
    assert line.isprintable()
    assert len(line) < 400


def test_a_damaged_log_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write_log(path, drive())
    content = bytearray(path.read_bytes())
    content[20:400] = b"\xff" * 380
    path.write_bytes(content)
    with pytest.raises(TraceError) as caught:
        read_trace(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert str(caught.value).isprintable()


def test_a_folder_is_no_drive(tmp_path: Path) -> None:
    with pytest.raises(TraceError, match="not a file"):
        read_trace(tmp_path)


def test_too_few_points_and_a_drive_that_does_not_close_are_refused(tmp_path: Path) -> None:
    (tmp_path / "few.csv").write_text(CSV + "0,0\n10,0\n20,0\n")
    (tmp_path / "open.csv").write_bytes(as_plane_csv(drive()))
    for name, keys, why in (
        ("few.csv", "", "points"),
        ("open.csv", "closed = true", "does not close"),
    ):
        with pytest.raises(ScenarioError, match=why) as caught:
            driven(tmp_path / name, keys)
        assert len(caught.value.lines) == 1
        assert name in caught.value.lines[0]


def test_a_drive_far_from_the_scenario_s_origin_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "drive.nmea"
    path.write_bytes(as_nmea(drive()))
    with pytest.raises(TraceError, match=r"line 1: latitude 48\.1.* further than 100 km"):
        read_trace(path, origin=Origin(30.0, -96.0, 0.0))


# --- The lead on a recorded drive


def driven(path: Path, keys: str = "", speed: str = "") -> Scenario:
    text = f'name = "a"\n[path]\nkind = "trace"\nfile = "{path.name}"\n{keys}\n[speed]\n{speed}\n'
    return scenario_from_text(text, label="a.toml", folder=path.parent)


def test_the_path_lies_on_exact_points_with_their_curvature(tmp_path: Path) -> None:
    path = tmp_path / "drive.csv"
    path.write_bytes(as_plane_csv(drive()))
    route = driven(path).route
    assert route.smoothed is not None
    assert route.smoothed.deviation_max < 0.02
    assert route.path.at(route.smoothed.start + 120.0).curvature == pytest.approx(1 / 150, rel=0.01)
    # The convoy stands on the straight before it: all start without any error.
    first, lead = (route.path.at(route.start_station(place)) for place in (3, 0))
    assert first.yaw == pytest.approx(lead.yaw, abs=1e-5)


def test_the_lead_drives_the_recorded_speed_place_by_place(tmp_path: Path) -> None:
    points, way = [], 0.0
    for k in range(401):  # 10 m/s, braking to a stop at 20 s, standing 5 s, off again
        t = 0.1 * k
        speed = 10.0 if t < 15 else max(0.0, 10.0 - 2.0 * (t - 15.0))
        speed = min(10.0, 2.0 * (t - 25.0)) if t > 25.0 else speed
        points.append((t, way, 0.0, speed))
        way += 0.1 * speed
    path = tmp_path / "stop.csv"
    written = as_plane_csv(points)
    for content in (written, written.replace(b"speed_mps", b"other")):  # recorded, and derived
        path.write_bytes(content)
        route = driven(path, speed='lead = "recorded"').route
        assert route.smoothed is not None
        assert route.start == pytest.approx(route.smoothed.start)  # straight from the start
        assert route.plan.at(10.0) == pytest.approx(10.0, abs=0.05)
        assert route.plan.at(22.5) == pytest.approx(0.0, abs=0.05)
        assert route.plan.at(38.0) == pytest.approx(10.0, abs=0.05)
        assert route.plan.distance(40.0) == pytest.approx(way, rel=0.01)


def test_speed_in_other_units_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "kmh.csv"
    path.write_bytes(as_plane_csv([(t, e, n, 3.6 * v) for t, e, n, v in drive()]))
    with pytest.raises(
        ScenarioError, match=r"recorded speeds are 3\.60 times what its points need"
    ):
        driven(path, speed='lead = "recorded"')


def test_a_record_without_times_has_no_speed(tmp_path: Path) -> None:
    path = tmp_path / "plane.csv"
    path.write_text(CSV + "".join(f"{2 * k},0\n" for k in range(30)))
    with pytest.raises(ScenarioError, match="allowed only for a trace with times"):
        driven(path, speed='lead = "recorded"')
    assert driven(path).route.plan.speeds == (20.0,)


def test_a_lead_comes_up_to_a_standing_start_at_walking_pace(tmp_path: Path) -> None:
    bend = [(t + 5.0, e, n, 12.0) for t, e, n, _ in drive()]
    standing = [(0.5 * k, 0.0, 0.0, 0.0) for k in range(10)]
    path = tmp_path / "start.csv"
    path.write_bytes(as_plane_csv([*standing, *bend]))
    route = driven(path, speed='lead = "recorded"').route
    assert route.smoothed is not None
    assert route.start < route.smoothed.start
    assert route.plan.speeds[0] == 1.0
    run_in = route.plan.times[1]
    assert route.plan.distance(run_in) == pytest.approx(route.smoothed.start - route.start)


def test_derived_speeds_are_means_of_the_way_over_two_seconds() -> None:
    times = np.arange(0.0, 60.0, 0.5)
    way = 10.0 * times + 15.0 * np.sin(times / 5.0)  # 10 + 3 cos(t/5) m/s
    plan, ratio = recorded(times.tolist(), way.tolist(), ())
    assert ratio == 1.0
    for t in (5.0, 20.0, 41.0):
        mean = (15.0 * (math.sin((t + 1) / 5) - math.sin((t - 1) / 5)) + 20.0) / 2.0
        assert plan.at(t) == pytest.approx(mean, abs=0.02)
    assert plan.distance(59.5) == pytest.approx(way[-1], rel=1e-3)
