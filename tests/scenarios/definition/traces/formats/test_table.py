"""Tables of positions: separators, headers, names, units and spoiled lines."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scenarios.definition.traces.drive import DriveTable, TraceError
from scenarios.definition.traces.formats.table import read_table

NOON = 1_774_785_600.0
"""29 March 2026, 12:00 UTC."""

PLANE = ([1.0, 1.5], [2.0, 2.5])
BERLIN = ([52.5, 52.6], [13.4, 13.5])


def same(values: NDArray[Any], expected: "Sequence[Any] | NDArray[Any]") -> None:
    np.testing.assert_allclose(values, np.array(expected, dtype=float), atol=1e-9)


SEPARATED = {
    "comma": "t_s,x_m,y_m\n0,1,2\n1,1.5,2.5",
    "comma and space": "t_s, x_m, y_m\n0, 1, 2\n1, 1.5, 2.5",
    "semicolon": "t_s;x_m;y_m\n0;1;2\n1;1.5;2.5",
    "tab": "t_s\tx_m\ty_m\n0\t1\t2\n1\t1.5\t2.5",
    "spaces": "t_s   x_m    y_m\n  0     1      2\n 1   1.5    2.5\n",
    "bar": "t_s|x_m|y_m\n0|1|2\n1|1.5|2.5",
    "sep=;": "sep=;\nt_s;x_m;y_m\n0;1;2\n1;1.5;2.5",
    "decimal commas, semicolon": "t_s;x_m;y_m\n0,0;1,0;2,0\n1,0;1,5;2,5",
    "decimal commas, tab": "t_s\tx_m\ty_m\n0,0\t1,0\t2,0\n1,0\t1,5\t2,5",
    "decimal commas, quoted": 't_s,x_m,y_m\n"0,0","1,0","2,0"\n"1,0","1,5","2,5"',
    "a comma in a name": "t_s;x_m;y_m;note, by driver\n0;1;2;ok\n1;1.5;2.5;ok",
    "a quoted separator": 't_s,"note, by driver",x_m,y_m\n0,"a, b",1,2\n1,"c",1.5,2.5',
    "quoted cells": '"t_s";"x_m";"y_m"\n"0";"1";"2"\n"1";"1.5";"2.5"',
    "Windows": "t_s,x_m,y_m\r\n0,1,2\r\n1,1.5,2.5\r\n",
    "trailing separators": "t_s,x_m,y_m,\n0,1,2,\n1,1.5,2.5,",
    "trailing separators of rows": "t_s,x_m,y_m\n0,1,2,\n1,1.5,2.5,",
    "blank lines": "\n\nt_s,x_m,y_m\n\n0,1,2\n,,\n1,1.5,2.5\n\n",
    "behind #": "# t_s,x_m,y_m\n0,1,2\n1,1.5,2.5",
    "behind %": "%t_s x_m y_m\n0 1 2\n1 1.5 2.5",
    "numpy.savetxt with spaces": "# t_s,x_m,y_m\n0.0e+00 1.0e+00 2.0e+00\n1.0e+00 1.5e+00 2.5e+00",
    "names in spaces, cells in commas": "# t_s x_m y_m\n0,1,2\n1,1.5,2.5",
    "comments before": "# a test\n# x, y in metres, 2026\n#\n# t_s;x_m;y_m\n0;1;2\n1;1.5;2.5",
    "comments between": "t_s,x_m,y_m\n# start\n0,1,2\n% lap\n1,1.5,2.5",
    "lines before": "Logger 5, build 3\nCar: 12\n\nt_s,x_m,y_m\n0,1,2\n1,1.5,2.5",
    "columns in between": "id,y_m,note,t_s,w,x_m\n7,2,a,0,,1\n8,2.5,b,1,,1.5",
}


@pytest.mark.parametrize("text", SEPARATED.values(), ids=SEPARATED)
def test_separators_and_headers(text: str) -> None:
    drive = read_table(text)
    assert not drive.geodetic
    same(drive.position, PLANE)
    same(drive.time_s, [0.0, 1.0])
    assert drive.left_out.counts.total() == 0
    assert drive.remarks == ()


NAMED_POSITIONS = {
    **dict.fromkeys(
        (
            "x,y", "X;Y", "x_m,y_m", "X [m],Y [m]", "east,north", "Easting,Northing",
            "east_m,north_m",
            "utm_e,utm_n", "utm_easting,utm_northing", "e,n", "pos_x,pos_y", "x(m)\ty(m)",
            "/odom/pose/pose/position/x,/odom/pose/pose/position/y", "pose.x,pose.y",
            "e-baseline(m)  n-baseline(m)", "local_x,local_y",
        ),
        (False, PLANE),
    ),
    **dict.fromkeys(
        (
            "lat,lon", "LAT,LNG", "Latitude,Longitude", "latitude_deg,longitude_deg",
            "lat_deg,lon_deg",
            "latitude(deg) longitude(deg)", "Latitude (deg);Longitude (deg)", "lat,long",
            "/gps/fix/latitude,/gps/fix/longitude", "field.latitude,field.longitude",
            "gps_lat,gps_lon", "GPSLatitude,GPSLongitude", "gpsLat,gpsLng", "latDeg,lonDeg",
            "position.latitude,position.longitude", "Latitude [°],Longitude [°]",
        ),
        (True, ([1.0, 1.5], [2.0, 2.5])),
    ),
}  # fmt: skip


@pytest.mark.parametrize("header", NAMED_POSITIONS)
def test_names_of_positions(header: str) -> None:
    mark = next((sign for sign in ",;\t" if sign in header), " ")
    drive = read_table(f"{header}\n1{mark}2\n1.5{mark}2.5\n")
    geodetic, position = NAMED_POSITIONS[header]
    assert drive.geodetic == geodetic
    same(drive.position, position)
    assert not np.isfinite(drive.time_s).any()


def test_latitudes_win_over_a_plane_and_pairs_have_one_prefix() -> None:
    drive = read_table("x,y,lat,lon\n1,2,52.5,13.4\n1.5,2.5,52.6,13.5")
    same(drive.position, BERLIN)
    drive = read_table("/imu/acc/x,/imu/acc/y,/pose/x,/gps/y,/pose/y\n9,9,1,9,2\n9,9,1.5,9,2.5")
    same(drive.position, PLANE)


NAMED_TIMES = {
    "time,x,y\n0,1,2\n1,1.5,2.5": [0.0, 1.0],
    "T,x,y\n0,1,2\n1,1.5,2.5": [0.0, 1.0],
    "Time (s),x,y\n0,1,2\n1,1.5,2.5": [0.0, 1.0],
    "Time (ms),x,y\n0,1,2\n1000,1.5,2.5": [0.0, 1.0],
    "t_ms,x,y\n0,1,2\n1000,1.5,2.5": [0.0, 1.0],
    "elapsed_time,x,y\n0,1,2\n1,1.5,2.5": [0.0, 1.0],
    "timestamp,x,y\n1774785600,1,2\n1774785601,1.5,2.5": [NOON, NOON + 1.0],
    "timestamp,x,y\n1774785600000,1,2\n1774785601000,1.5,2.5": [NOON, NOON + 1.0],
    "UTC;x;y\n2026-03-29T12:00:00Z;1;2\n2026-03-29T12:00:01Z;1.5;2.5": [NOON, NOON + 1.0],
    "Date,Time,x,y\n2026-03-29,12:00:00,1,2\n2026-03-29,12:00:01,1.5,2.5": [NOON, NOON + 1.0],
    "Date,Time,x,y\n29.03.2026,12:00,1,2\n29.03.2026,12:01,1.5,2.5": [NOON, NOON + 60.0],
    "date,x,y\n2026-03-29 12:00:00,1,2\n2026-03-29 12:00:01,1.5,2.5": [NOON, NOON + 1.0],
    "date,time,x,y\n2026-03-29 12:00:00,0,1,2\n2026-03-29 12:00:01,1,1.5,2.5": [0.0, 1.0],
    "time x y\n2026-03-29 12:00:00 1 2\n2026-03-29 12:00:01 1.5 2.5": [NOON, NOON + 1.0],
    "sec,nanosec,x,y\n1774785600,0,1,2\n1774785600,500000000,1.5,2.5": [NOON, NOON + 0.5],
    "stamp.secs,stamp.nsecs,x,y\n5,0,1,2\n5,500000000,1.5,2.5": [5.0, 5.5],
    "time,stamp,x,y\n0,1774785600,1,2\n3,1774785601,1.5,2.5": [NOON, NOON + 1.0],
    "time,header.stamp,x,y\n0,0,1,2\n3,0,1.5,2.5": [0.0, 3.0],
    "t_s,time,x,y\n0,50,1,2\n1,60,1.5,2.5": [0.0, 1.0],
    "iTOW,x,y\n43200,1,2\n43400,1.5,2.5": [43.2, 43.4],
    "utc_time,x,y\n12:00:00,1,2\n12:00:01,1.5,2.5": [43_200.0, 43_201.0],
}


@pytest.mark.parametrize(("text", "times"), NAMED_TIMES.items())
def test_names_of_times(text: str, times: list[float]) -> None:
    drive = read_table(text)
    same(drive.position, PLANE)
    same(drive.time_s + drive.zero_s, times)
    assert drive.clock == ("unix" if times[0] >= NOON else "day" if times[0] > 1e4 else None)


ROS = {
    "rostopic echo -p": (
        "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.status.status,"
        "field.latitude,field.longitude,field.altitude,field.position_covariance0\n"
        "1774785600300000000,0,1774785600000000000,gps,0,52.5,13.4,34.0,1.0\n"
        "1774785600700000000,1,1774785600500000000,gps,0,52.6,13.5,34.5,1.0\n"
    ),
    "bag to csv": (
        "Time,header.seq,header.stamp.secs,header.stamp.nsecs,header.frame_id,status.status,"
        "latitude,longitude,altitude,position_covariance_type\n"
        "1774785600.3,0,1774785600,0,gps,0,52.5,13.4,34.0,2\n"
        "1774785600.7,1,1774785600,500000000,gps,0,52.6,13.5,34.5,2\n"
    ),
    "ROS 2": (
        "header.stamp.sec,header.stamp.nanosec,latitude,longitude,altitude\n"
        "1774785600,0,52.5,13.4,34.0\n1774785600,500000000,52.6,13.5,34.5\n"
    ),
    "PlotJuggler": (
        "__time,/gps/fix/latitude,/gps/fix/longitude,/gps/fix/altitude\n"
        "1774785600.0,52.5,13.4,34.0\n1774785600.5,52.6,13.5,34.5\n"
    ),
    "message path": (
        "timestamp,/fix.latitude,/fix.longitude,/fix.altitude\n"
        "2026-03-29T12:00:00.000000000Z,52.5,13.4,34.0\n"
        "2026-03-29T12:00:00.500000000Z,52.6,13.5,34.5\n"
    ),
    "RTKLIB": (
        "% program   : rnx2rtkp ver.2.4.3\n% obs start : 2026/03/29 12:00:18.0 GPST (week2412)\n%\n"
        "%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)\n"
        "2026/03/29 12:00:18.000   52.500000000   13.400000000    34.0000   1  10   0.0100\n"
        "2026/03/29 12:00:18.500   52.600000000   13.500000000    34.5000   1  10   0.0100\n"
    ),
    "RTKLIB, UTC": (
        "%  UTC                   latitude(deg) longitude(deg)  height(m)   Q  ns\n"
        "2026/03/29 12:00:00.000   52.5   13.4    34.0   1  10\n"
        "2026/03/29 12:00:00.500   52.6   13.5    34.5   1  10\n"
    ),
    "RTKLIB, commas": (
        "%  GPST,latitude(deg),longitude(deg),height(m),Q,ns\n"
        "2026/03/29 12:00:18.000,52.5,13.4,34.0,1,10\n2026/03/29 12:00:18.500,52.6,13.5,34.5,1,10\n"
    ),
}


LOGGERS = {
    "racing line": (
        "# s_m; x_m; y_m; psi_rad; kappa_radpm; vx_mps; ax_mps2\n0.0; 1; 2; 0; 0; 20; 1\n"
        "0.7; 1.5; 2.5; 0; 0; 20; 1\n",
        (PLANE, math.nan, 20.0),
    ),
    "a row of units": (
        "time,lat,lon,speed\ns,deg,deg,km/h\n0,52.5,13.4,36\n1,52.6,13.5,36\n",
        (BERLIN, 1.0, 10.0),
    ),
    "lap timer": (
        '# Data: A\n# Vehicle: B\n"Time","UTC Time","Lap","Latitude","Longitude","MPH"\n'
        "0.0,1774785600.0,0,52.5,13.4,10\n0.1,1774785600.1,0,52.6,13.5,10\n",
        (BERLIN, 0.1, 4.4704),
    ),
    "phone": (
        "GPS Time, Device Time, Longitude, Latitude,GPS Speed (Meters/second)\n"
        "Sun Mar 29 14:00:00 GMT+02:00 2026,29-Mar-2026 12:00:00.123,13.4,52.5,3.0\n"
        "Sun Mar 29 14:00:01 GMT+02:00 2026,29-Mar-2026 12:00:01.123,13.5,52.6,3.0\n",
        (BERLIN, 1.0, 3.0),
    ),
    "flight recorder": (
        "timestamp,lat,lon,vel_m_s\n1000000,525000000,134000000,3\n1200000,525000100,134000100,3\n",
        (([52.5, 52.50001], [13.4, 13.40001]), 0.2, 3.0),
    ),
    "bicycle computer": (
        "timestamp,position_lat,position_long,speed\n0,536870912,-268435456,3\n",
        (([45.0], [-22.5]), 0.0, 3.0),
    ),
    "poses of a camera": (
        "# timestamp tx ty tz qx qy qz qw\n1774785600.0 1 2 3 0 0 0 1\n"
        "1774785600.1 1.5 2.5 3 0 0 0 1\n",
        (PLANE, 0.1, math.nan),
    ),
}  # fmt: skip


@pytest.mark.parametrize(("text", "expected"), LOGGERS.values(), ids=LOGGERS)
def test_files_of_loggers(
    text: str, expected: tuple[tuple[list[float], list[float]], float, float]
) -> None:
    position, span, speed = expected
    drive = read_table(text)
    same(drive.position, position)
    same(drive.time_s[-1:] - drive.time_s[:1], [span])
    same(drive.speed_mps[-1:], [speed])
    assert drive.left_out.counts.total() == 0


@pytest.mark.parametrize("text", ROS.values(), ids=ROS)
def test_exports_of_known_tools(text: str) -> None:
    drive = read_table(text)
    same(drive.position, BERLIN)
    same(drive.altitude_m, [34.0, 34.5])
    assert drive.clock == "unix"
    np.testing.assert_allclose(drive.time_s + drive.zero_s, [NOON, NOON + 0.5], atol=1e-6)
    assert drive.left_out.counts.total() == 0


@pytest.mark.parametrize(("end", "count"), [("2,7", 3), ("2,7,8.", 4), ("2,", 3), ("2,7\n", 3)])
def test_a_row_that_ends_within_its_position_is_left_out(end: str, count: int) -> None:
    drive = read_table(f"t_s,x_m,y_m\n0,1,2\n1,1.5,2.5\n1.5,3,4\n{end}")
    assert (drive.count, drive.left_out.counts.total()) == (count, 4 - count)
    cut = read_table(f"t_s,x_m,y_m,speed_mps\n0,1,2,5\n1,1.5,2.5,5\n{end}")
    assert (cut.count, cut.left_out.counts.total()) == (2, 1)


def test_scale_and_radians_of_columns() -> None:
    same(read_table("latitudeE7,longitudeE7\n525000000,134000000").position, [[52.5], [13.4]])
    drive = read_table("lat_rad,lon_rad\n0.5,0.25")
    same(drive.position, np.degrees([[0.5], [0.25]]))


SPEEDS = {
    "speed": 10.0, "speed_mps": 10.0, "Speed (m/s)": 10.0, "v": 10.0, "velocity": 10.0,
    "speed_kmh": 10 / 3.6, "Speed (km/h)": 10 / 3.6, "Speed km/h": 10 / 3.6, "speed_km_h": 10 / 3.6,
    "speed_mph": 4.4704, "knots speed": math.nan, "sog (kn)": 10 * 1852 / 3600,
    "Speed [knots]": 10 * 1852 / 3600, "GroundSpeed": 10.0, "gps_speed": 10.0,
}  # fmt: skip


@pytest.mark.parametrize("name", SPEEDS)
def test_names_and_units_of_speeds(name: str) -> None:
    drive = read_table(f"x,y,{name}\n1,2,10\n1.5,2.5,-10")
    same(drive.speed_mps, [SPEEDS[name]] * 2)
    assert len(drive.remarks) == (SPEEDS[name] not in (10.0, math.nan) and SPEEDS[name] > 0)


@pytest.mark.parametrize("name", ["alt", "Altitude", "ele", "elevation_m", "height(m)", "altMSL"])
def test_only_the_position_decides(name: str) -> None:
    cells = ["", "abc", "nan", "-9999", "9999", "1e9", "-501", "30.5", "inf", "-9999.0"]
    rows = "".join(f"{k},{k},{cell},{cell}\n" for k, cell in enumerate(cells))
    drive = read_table(f"x,y,{name},speed\n{rows}")
    assert drive.count == 10
    same(drive.altitude_m, [*[math.nan] * 7, 30.5, math.nan, math.nan])
    same(drive.speed_mps, [*[math.nan] * 7, 30.5, math.nan, math.nan])


SPOILED = {
    "abc,2,3": "x_m is 'abc'",
    ",2,3": "x_m is empty",
    "1": "y_m is empty",
    "nan,2,3": "x_m is 'nan'",
    "1,inf,3": "y_m is 'inf'",
    "x_m,y_m,t_s": "x_m is 'x_m'",
    '"1,2,3': "x_m is '1,2,3'",
    "1,2,3,4": "4 cells, 3 expected",
    "1.02.0,2,3": "x_m is '1.02.0'",
    "\ufffd\ufffd,2,3": "x_m is '\ufffd\ufffd'",
    "1 2 3": "x_m is '1 2 3'",
}


@pytest.mark.parametrize("line", SPOILED)
def test_a_spoiled_line_is_left_out_with_its_reason(line: str) -> None:
    drive = read_table(f"x_m,y_m,t_s\n0,0,0\n{line}\n1,0,1\n2,0,2")
    same(drive.position[0], [0.0, 1.0, 2.0])
    same(drive.numbers, [2, 4, 5])
    ((number, reason),) = [(record.number, record.reason) for record in drive.left_out.records]
    assert (number, reason) == (3, SPOILED[line])


def test_absurd_numbers_are_no_numbers() -> None:
    drive = read_table("t_s,x_m,y_m\n0,0,0\n1e300,1,0\n2,1e300,0\n3,3,0")
    same(drive.time_s, [0.0, math.nan, 3.0])
    same(drive.numbers, [2, 3, 5])


@pytest.mark.parametrize("header", ["x,y", "lat,lon", "time,date,x,y,speed"])
def test_a_header_alone_is_a_drive_without_points(header: str) -> None:
    drive = read_table(f"{header}\n")
    assert drive.count == 0
    assert drive.left_out.counts.total() == 0


def moving(name: str, step: float, first: float = 0.0) -> DriveTable:
    """A drive with 5 m between points."""
    return read_table(
        f"{name},x,y\n" + "".join(f"{first + k * step:.9g},{5 * k},0\n" for k in range(20))
    )


@pytest.mark.parametrize(
    ("name", "step", "interval", "remark"),
    [
        ("time", 0.5, 0.5, ""),
        ("time", 500.0, 0.5, "read in ms"),
        ("timestamp", 500_000.0, 0.5, "read in us"),
        ("t", 5e8, 0.5, "read in ns"),
        ("time", 10.0, 10.0, ""),
        ("time_s", 500.0, 500.0, "column to t_ms"),
        ("t_s", 500.0, 500.0, "column to t_ms"),
        ("t_ms", 0.5, 0.0005, "column to t_s"),
        ("t_ms", 500.0, 0.5, ""),
    ],
)
def test_the_speed_of_the_drive_shows_a_wrong_unit(
    name: str, step: float, interval: float, remark: str
) -> None:
    drive = moving(name, step)
    same(np.diff(drive.time_s), [interval] * 19)
    assert len(drive.remarks) == bool(remark)
    assert remark in " ".join(drive.remarks)


@pytest.mark.parametrize(
    ("text", "given"),
    [
        ("1,2\n3,4", "given 1, 2; name them in the first line"),
        ("0.5;1.0;2.0", "given 0.5, 1.0, 2.0; name them"),
        ("a,b\n1,2", "given a, b; allowed latitude and longitude, x and y"),
        ("lat,height\n1,2", "given lat, height; allowed"),
        ("# nothing\n1 2\n", "given 1 2; name them"),
        ("hello world", "given hello world; allowed"),
        ("x_m\n1\n", "given x_m; allowed"),
        ("\x01,\x02", r"given \\x01, \\x02; name them"),
        ("t_s,x_m,y_m\n0,5,1,5,2,5\n1,5,2,5,3,5\n", "separate the cells of decimal commas by ;"),
        (
            "%  GPST  latitude(d'\")  longitude(d'\")\n2026/03/29 12:00:00.0 52 30 0.0 13 24 0.0\n",
            "export decimal degrees",
        ),
        ("acc_x,acc_y\n1,2\n", "given acc_x, acc_y; allowed"),
    ],
)
def test_a_table_without_positions_is_refused_with_a_remedy(text: str, given: str) -> None:
    with pytest.raises(TraceError, match=given):
        read_table(text)


@pytest.mark.parametrize(("step", "geodetic"), [(1e-4, True), (0.02, False)])
def test_x_and_y_in_degrees(step: float, geodetic: bool) -> None:
    """As exports of QGIS have them; in metres the car would stand."""
    rows = [f"{13.4 + k * step:.7f},{52.5 + k * step:.7f}" for k in range(20)]
    drive = read_table("\n".join(["X,Y", *rows]))
    assert drive.geodetic is geodetic
    assert len(drive.remarks) == geodetic
    same(drive.position[:, 0], [52.5, 13.4] if geodetic else [13.4, 52.5])
