"""Tables of positions: separators, headers, names, units, times, vehicles and spoiled lines."""

import math

import numpy as np
import pytest

from scenarios.definition.traces.drive import DriveTable, TraceError
from scenarios.definition.traces.formats.cells import read_times
from scenarios.definition.traces.formats.table import read_table

NOON = 1_774_785_600.0
"""29 March 2026, 12:00 UTC."""

PLANE = ([1.0, 1.5], [2.0, 2.5])
BERLIN = ([52.5, 52.6], [13.4, 13.5])

SEPARATED = {
    "comma and space": "t_s, x_m, y_m\n0, 1, 2\n1, 1.5, 2.5",
    "tab": "t_s\tx_m\ty_m\n0\t1\t2\n1\t1.5\t2.5",
    "spaces": "t_s   x_m    y_m\n  0     1      2\n 1   1.5    2.5\n",
    "sep=;": "sep=;\r\nt_s;x_m;y_m\r\n0;1;2\r\n1;1.5;2.5",
    "decimal commas, semicolon": "t_s;x_m;y_m\n0,0;1,0;2,0\n1,0;1,5;2,5",
    "decimal commas, quoted": 't_s,x_m,y_m\n"0,0","1,0","2,0"\n"1,0","1,5","2,5"',
    "a comma in a name": "t_s;x_m;y_m;note, by driver\n0;1;2;ok\n1;1.5;2.5;ok",
    "a quoted separator": 't_s,"note, by driver",x_m,y_m\n0,"a, b",1,2\n1,"c",1.5,2.5',
    "trailing separators of rows": "t_s,x_m,y_m\n0,1,2,\n1,1.5,2.5,",
    "blank lines": "\n\nt_s,x_m,y_m\n\n0,1,2\n,,\n1,1.5,2.5\n\n",
    "behind %": "%t_s x_m y_m\n0 1 2\n1 1.5 2.5",
    "numpy.savetxt with spaces": "# t_s,x_m,y_m\n0.0e+00 1.0e+00 2.0e+00\n1.0e+00 1.5e+00 2.5e+00",
    "comments before": "# a test\n# x, y in metres, 2026\n#\n# t_s;x_m;y_m\n0;1;2\n1;1.5;2.5",
    "comments between": "t_s,x_m,y_m\n# start\n0,1,2\n% lap\n1,1.5,2.5",
    "lines before": "Logger 5, build 3\nCar: 12\n\nt_s,x_m,y_m\n0,1,2\n1,1.5,2.5",
    "columns in between": "id,y_m,note,t_s,w,x_m\n7,2,a,0,,1\n8,2.5,b,1,,1.5",
}


@pytest.mark.parametrize("text", SEPARATED.values(), ids=SEPARATED)
def test_separators_and_headers(text: str) -> None:
    drive = read_table(text)
    assert (drive.geodetic, drive.remarks) == (False, ())
    np.testing.assert_allclose(drive.position, PLANE)
    np.testing.assert_allclose(drive.time_s, [0.0, 1.0])
    assert not drive.left_out.counts


@pytest.mark.parametrize(
    ("header", "geodetic"),
    [
        *((name, False) for name in (
            "X [m],Y [m]", "Easting,Northing", "utm_e,utm_n", "e,n", "x(m)\ty(m)",
            "/odom/pose/pose/position/x,/odom/pose/pose/position/y",
            "e-baseline(m)  n-baseline(m)",
        )),
        *((name, True) for name in (
            "lat,lon", "LAT,LNG", "latitude(deg) longitude(deg)", "Latitude [°],Longitude [°]",
            "/gps/fix/latitude,/gps/fix/longitude", "GPSLatitude,GPSLongitude", "latDeg,lonDeg",
        )),
    ],
)  # fmt: skip
def test_names_of_positions(header: str, geodetic: bool) -> None:
    mark = next((sign for sign in ",;\t" if sign in header), " ")
    drive = read_table(f"{header}\n1{mark}2\n1.5{mark}2.5\n")
    assert drive.geodetic == geodetic
    np.testing.assert_allclose(drive.position, PLANE)


def test_latitudes_win_over_a_plane_and_pairs_have_one_prefix() -> None:
    drive = read_table("x,y,lat,lon\n1,2,52.5,13.4\n1.5,2.5,52.6,13.5")
    np.testing.assert_allclose(drive.position, BERLIN)
    drive = read_table("/imu/acc/x,/imu/acc/y,/pose/x,/gps/y,/pose/y\n9,9,1,9,2\n9,9,1.5,9,2.5")
    np.testing.assert_allclose(drive.position, PLANE)


NAMED_TIMES = {
    "T,x,y\n0,1,2\n1,1.5,2.5": (0.0, 1.0),
    "Time (ms),x,y\n0,1,2\n1000,1.5,2.5": (0.0, 1.0),
    "elapsed_time,x,y\n0,1,2\n1,1.5,2.5": (0.0, 1.0),
    "Temps,x,y\n0.0 sec,1,2\n0.2 sec,1.5,2.5": (0.0, 0.2),
    "timestamp,x,y\n1774785600,1,2\n1774785601,1.5,2.5": (NOON, NOON + 1.0),
    "timestamp,x,y\n1774785600000,1,2\n1774785601000,1.5,2.5": (NOON, NOON + 1.0),
    "Date,Time,x,y\n2026-03-29,12:00:00,1,2\n2026-03-29,12:00:01,1.5,2.5": (NOON, NOON + 1.0),
    "date,time,x,y\n2026-03-29 12:00:00,0,1,2\n2026-03-29 12:00:01,1,1.5,2.5": (0.0, 1.0),
    "time x y\n2026-03-29 12:00:00 1 2\n2026-03-29 12:00:01 1.5 2.5": (NOON, NOON + 1.0),
    "sec,nanosec,x,y\n1774785600,0,1,2\n1774785600,500000000,1.5,2.5": (NOON, NOON + 0.5),
    "time,stamp,x,y\n0,1774785600,1,2\n3,1774785601,1.5,2.5": (NOON, NOON + 1.0),
    "time,header.stamp,x,y\n0,0,1,2\n3,0,1.5,2.5": (0.0, 3.0),
    "t_s,time,x,y\n0,50,1,2\n1,60,1.5,2.5": (0.0, 1.0),
    "iTOW,x,y\n43200,1,2\n43400,1.5,2.5": (43.2, 43.4),
    "utc_time,x,y\n12:00:00,1,2\n12:00:01,1.5,2.5": (43_200.0, 43_201.0),
}


@pytest.mark.parametrize(("text", "times"), NAMED_TIMES.items())
def test_names_of_times(text: str, times: tuple[float, float]) -> None:
    drive = read_table(text)
    np.testing.assert_allclose(drive.position, PLANE)
    np.testing.assert_allclose(drive.time_s + drive.zero_s, times, atol=1e-9)
    assert drive.clock == ("unix" if times[0] >= NOON else "day" if times[0] > 1e4 else None)


@pytest.mark.parametrize(
    ("cells", "seconds", "clock"),
    [
        (["12:00:00.2", "12:00:01", "0:00:01,5"], [43200.2, 43201.0, 1.5], "day"),
        (["11:59:59 PM", "12:00:00 AM"], [86399.0, 0.0], "day"),
        (["115959.5", "120000.0", "120000.5", "120001.0"], [43199.5, 43200, 43200.5, 43201], "day"),
        (["0", "1", "1774785600", "3"], [0.0, 1.0, NOON, 3.0], None),
        (["1774785600.1", "1e300", "1774785601"], [NOON + 0.1, math.nan, NOON + 1.0], "unix"),
        (["46110.5", "46110.500005787"], [NOON, NOON + 0.5], "unix"),
        (["1774785600000000001", "1774785600500000001"], [NOON, NOON + 0.5], "unix"),
        (["", "2026-03-29T14:00:00+02:00", "?", "5"], [math.nan, NOON, *[math.nan] * 2], "unix"),
        (["03/29/2026 12:00:00", "03/29/2026 12:00:01"], [NOON, NOON + 1], "unix"),
        (["29.03.2026 12:00", "29.03.2026 12:01"], [NOON, NOON + 60], "unix"),
        (["29-Mar-2026 12:00:00", "29-Mar-2026 12:00:01"], [NOON, NOON + 1], "unix"),
        (["28/03/2026 23:59:59", "29/03/2026 00:00:00"], [NOON - 43_201, NOON - 43_200], "unix"),
        (["05/06/2026 23:59:59", "06/06/2026 00:00:00"], [NOON + 5_918_399, NOON + 5_918_400],
         "unix"),
        (["99:99:99 nonsense", "2026-13-45T12:00:00"], [math.nan, math.nan], None),
    ],
)  # fmt: skip
def test_forms_of_times(cells: list[str], seconds: list[float], clock: str | None) -> None:
    column = read_times(cells)
    assert column.clock == clock
    np.testing.assert_allclose(column.seconds + column.zero_s, seconds, atol=1e-3)


EXPORTS = {
    "rostopic echo -p": (
        "%time,field.header.seq,field.header.stamp,field.latitude,field.longitude,field.altitude\n"
        "1774785600300000000,0,1774785600000000000,52.5,13.4,34.0\n"
        "1774785600700000000,1,1774785600500000000,52.6,13.5,34.5\n"
    ),
    "bag to csv": (
        "Time,header.seq,header.stamp.secs,header.stamp.nsecs,latitude,longitude,altitude\n"
        "1774785600.3,0,1774785600,0,52.5,13.4,34.0\n"
        "1774785600.7,1,1774785600,500000000,52.6,13.5,34.5\n"
    ),
    "PlotJuggler": (
        "__time,/gps/fix/latitude,/gps/fix/longitude,/gps/fix/altitude\n"
        "1774785600.0,52.5,13.4,34.0\n1774785600.5,52.6,13.5,34.5\n"
    ),
    "RTKLIB": (
        "% program   : rnx2rtkp ver.2.4.3\n% obs start : 2026/03/29 12:00:18.0 GPST (week2412)\n%\n"
        "%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)\n"
        "2026/03/29 12:00:18.000   52.500000000   13.400000000    34.0000   1  10   0.0100\n"
        "2026/03/29 12:00:18.500   52.600000000   13.500000000    34.5000   1  10   0.0100\n"
    ),
}


@pytest.mark.parametrize("text", EXPORTS.values(), ids=EXPORTS)
def test_exports_of_known_tools(text: str) -> None:
    drive = read_table(text)
    np.testing.assert_allclose(drive.position, BERLIN)
    np.testing.assert_allclose(drive.altitude_m, [34.0, 34.5])
    np.testing.assert_allclose(drive.time_s + drive.zero_s, [NOON, NOON + 0.5], atol=1e-6)
    assert (drive.clock, drive.left_out.counts.total()) == ("unix", 0)


@pytest.mark.parametrize(
    ("text", "position", "speed"),
    [
        ("# s_m; x_m; y_m; vx_mps\n0.0; 1; 2; 20\n0.7; 1.5; 2.5; 20\n", PLANE, 20.0),
        ("time,lat,lon,speed\ns,deg,deg,km/h\n0,52.5,13.4,36\n1,52.6,13.5,36\n", BERLIN, 10.0),
        ('# A\n"Time","Latitude","Longitude","MPH"\n0,52.5,13.4,10\n1,52.6,13.5,10\n', BERLIN,
         4.4704),
        ("t,lat,lon,vel_m_s\n0,525000000,134000000,3\n1,526000000,135000000,3\n", BERLIN, 3.0),
        ("t,position_lat,position_long,speed\n0,536870912,-268435456,3\n", ([45.0], [-22.5]), 3.0),
        ("lat_rad,lon_rad\n0.5,0.25", np.degrees([[0.5], [0.25]]), math.nan),
        ("x,y,Speed km/h\n1,2,10\n1.5,2.5,-10", PLANE, 10 / 3.6),
        ("x,y,sog (kn)\n1,2,10\n1.5,2.5,-10", PLANE, 10 * 1852 / 3600),
        ("Local_X,Local_Y,v_Vel\n1,2,10\n1.5,2.5,10", 0.3048 * np.array(PLANE), 3.048),
    ],
)  # fmt: skip
def test_units_of_positions_and_speeds(text: str, position: object, speed: float) -> None:
    drive = read_table(text)
    np.testing.assert_allclose(drive.position, np.array(position))
    np.testing.assert_allclose(drive.speed_mps[-1:], [speed])


def test_only_the_position_decides() -> None:
    cells = ["", "abc", "nan", "-9999", "9999", "1e9", "-501", "30.5", "inf", "-9999.0"]
    rows = "".join(f"{k},{k},{cell},{cell}\n" for k, cell in enumerate(cells))
    drive = read_table(f"x,y,Altitude,speed\n{rows}")
    assert drive.count == 10
    np.testing.assert_allclose(drive.altitude_m, [*[math.nan] * 7, 30.5, math.nan, math.nan])
    np.testing.assert_allclose(drive.speed_mps, [*[math.nan] * 7, 30.5, math.nan, math.nan])


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("abc,2,3", "x_m is 'abc'"), (",2,3", "x_m is empty"), ("1", "y_m is empty"),
        ("1,inf,3", "y_m is 'inf'"), ('"1,2,3', "x_m is '1,2,3'"), ("1e300,2,3", "x_m is '1e300'"),
        ("1,2,3,4", "4 cells, 3 expected"),
    ],
)  # fmt: skip
def test_a_spoiled_line_is_left_out_with_its_reason(line: str, reason: str) -> None:
    drive = read_table(f"x_m,y_m,t_s\n0,0,0\n{line}\n1,0,1\n2,0,2")
    assert drive.numbers.tolist() == [2, 4, 5]
    assert [(one.number, one.reason) for one in drive.left_out.records] == [(3, reason)]


@pytest.mark.parametrize(("end", "count"), [("2,7", 3), ("2,7,8.", 4), ("2,", 3), ("2,7\n", 3)])
def test_a_row_that_ends_within_its_position_is_left_out(end: str, count: int) -> None:
    drive = read_table(f"t_s,x_m,y_m\n0,1,2\n1,1.5,2.5\n1.5,3,4\n{end}")
    assert (drive.count, drive.left_out.counts.total()) == (count, 4 - count)


def moving(name: str, step: float) -> DriveTable:
    """A drive with 5 m between points."""
    return read_table(f"{name},x,y\n" + "".join(f"{k * step:.9g},{5 * k},0\n" for k in range(20)))


@pytest.mark.parametrize(
    ("name", "step", "interval", "remark"),
    [
        ("time", 0.5, 0.5, ""), ("time", 500.0, 0.5, "read in ms"), ("t", 5e8, 0.5, "read in ns"),
        ("time", 10.0, 10.0, ""), ("time_s", 500.0, 500.0, "column to t_ms"),
        ("t_ms", 0.5, 0.0005, "column to t_s"),
    ],
)  # fmt: skip
def test_the_speed_of_the_drive_shows_a_wrong_unit(
    name: str, step: float, interval: float, remark: str
) -> None:
    drive = moving(name, step)
    np.testing.assert_allclose(np.diff(drive.time_s), [interval] * 19)
    assert len(drive.remarks) == bool(remark)
    assert remark in " ".join(drive.remarks)


@pytest.mark.parametrize(
    ("text", "given"),
    [
        ("1,2\n3,4", "given 1, 2; name them in the first line"),
        ("a,b\n1,2", "given a, b; allowed latitude and longitude, x and y"),
        ("\x01,\x02", r"given \\x01, \\x02; name them"),
        ("t_s,x_m,y_m\n0,5,1,5,2,5\n1,5,2,5,3,5\n", "separate the cells of decimal commas by ;"),
        ("%  GPST  latitude(d'\")  longitude(d'\")\n2026/03/29 12:00 52 30 0.0 13 24 0.0\n",
         "export decimal degrees"),
        ("acc_x,acc_y\n1,2\n", "given acc_x, acc_y; allowed"),
        ("t,x,y,z\n0,3787412,891817,5036896\n1,3787413,891818,5036897\n", "ECEF"),
    ],
)  # fmt: skip
def test_a_table_without_positions_is_refused_with_a_remedy(text: str, given: str) -> None:
    with pytest.raises(TraceError, match=given):
        read_table(text)


def test_unread_columns_that_may_be_times_are_named() -> None:
    (remark,) = read_table("Moment,x,y\n0,1,2\n1,1.5,2.5").remarks
    assert "Moment" in remark


TWO_CARS = {
    "id column": "t,id,x,y\n0,a,1,2\n0,b,9,9\n1,a,1.5,2.5\n1,b,8,8\n2,a,2,3\n2,b,7,7\n",
    "one after the other": "id,t,x,y\na,0,1,2\na,1,1.5,2.5\na,2,2,3\nb,0,9,9\nb,1,8,8\nb,2,7,7\n",
    "numbered names": (
        "Location,Test road\nVehicle_number,2\n\nt,x_a,y_a,x1,y1,x2,y2\n"
        "0,0,0,1,2,9,9\n1,0,0,1.5,2.5,8,8\n2,0,0,2,3,7,7\n"
    ).replace(",x_a,y_a", ",note,more"),
    "SUMO": (
        "timestep_time;vehicle_id;vehicle_x;vehicle_y;vehicle_speed\n"
        "0;a;1;2;3\n0;b;9;9;3\n1;a;1.5;2.5;3\n1;b;8;8;3\n2;a;2;3;3\n2;b;7;7;3\n"
    ),
}


@pytest.mark.parametrize("text", TWO_CARS.values(), ids=TWO_CARS)
def test_one_of_several_vehicles_is_selected_and_two_are_never_joined(text: str) -> None:
    names = ("1", "2") if "x1" in text else ("a", "b")
    with pytest.raises(TraceError, match=f"2 vehicles, {names[0]}, {names[1]}: set path.vehicle"):
        read_table(text)
    for name, x in zip(names, ([1.0, 1.5, 2.0], [9.0, 8.0, 7.0]), strict=True):
        drive = read_table(text, name)
        assert (drive.position[0].tolist(), drive.time_s.tolist()) == (x, [0.0, 1.0, 2.0])
    with pytest.raises(TraceError, match=f"given vehicle c, allowed {names[0]}, {names[1]}"):
        read_table(text, "c")
