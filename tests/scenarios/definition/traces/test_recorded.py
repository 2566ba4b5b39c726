"""Recorded drives: the same drive from every format, bad lines, and the lead's speed."""

from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.check.findings import warnings
from scenarios.definition.errors import ScenarioError
from scenarios.definition.road.lead_speed import recorded
from scenarios.definition.schema.path_tables import TracePath
from scenarios.definition.traces.drive import TraceError
from scenarios.definition.traces.reading import read_trace
from tests.made.scenarios.recorded_drives import (
    CSV,
    ORIGIN,
    WRITERS,
    as_nmea,
    as_plane_csv,
    drive,
    driven,
    sentence,
    write_log,
)


def table_of(vehicle: str) -> TracePath:
    return TracePath(kind="trace", file="run.mcap", vehicle=vehicle)


@pytest.mark.parametrize("name", WRITERS)
def test_the_same_drive_comes_from_every_format(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(WRITERS[name](drive()))
    trace = read_trace(path, origin=ORIGIN)
    times, east, north, speeds = (np.array(column) for column in zip(*drive(), strict=True))
    assert trace.table.left_out == ()
    assert np.allclose(trace.table.east_m, east, atol=1e-3)
    assert np.allclose(trace.table.north_m, north, atol=1e-3)
    assert np.allclose(trace.table.time_s, times, atol=1e-5)
    if "gpx" not in name:  # GPX 1.1 has no speeds
        assert np.allclose(trace.table.speed_mps, speeds, atol=1e-5)


def test_the_log_of_a_run_is_a_recorded_drive(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write_log(path, drive())
    east, north = ([row[k] for row in drive()] for k in (1, 2))
    lead = read_trace(path, origin=ORIGIN)
    assert np.allclose(lead.table.east_m, east, atol=1e-6)
    assert np.allclose(lead.table.speed_mps, 12.0)
    assert lead.table.time_s[-1] == pytest.approx(20.0)
    second = read_trace(path, table_of("v2"), origin=ORIGIN)
    assert np.allclose(second.table.north_m, np.add(north, 50.0), atol=1e-6)
    with pytest.raises(TraceError, match=r"run\.mcap: given vehicle v9, allowed v1, v2"):
        read_trace(path, table_of("v9"))


def test_without_an_origin_the_plane_touches_at_the_first_point(tmp_path: Path) -> None:
    path = tmp_path / "drive.nmea"
    path.write_bytes(as_nmea(drive()))
    trace = read_trace(path)
    assert trace.origin is not None
    assert (trace.origin.latitude_deg, trace.origin.longitude_deg) == pytest.approx((48.1, 11.5))
    assert trace.origin.altitude_m == pytest.approx(500.0)  # above the ellipsoid: 455 m + 45 m
    assert (trace.table.east_m[0], trace.table.north_m[0]) == pytest.approx((0.0, 0.0), abs=1e-6)


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
    assert [record.number for record in trace.left_out.records] == [
        31,
        91,
        121,
        151,
    ]
    assert (
        len(trace.table.east_m) == 200
    )  # RMC stands in for three of the lost, line 91's is lost too
    (warning,) = warnings(driven(path, "closed = false"))
    assert "4 records are left out" in warning
    assert all(f"line {number}" in warning for number in (31, 91, 121, 151))


# --- The lead on a recorded drive


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
        assert route.profile.at(10.0)[0] == pytest.approx(10.0, abs=0.05)
        assert route.profile.at(22.5)[0] == pytest.approx(0.0, abs=0.05)
        assert route.profile.at(38.0)[0] == pytest.approx(10.0, abs=0.05)
        assert route.profile.distance(40.0) == pytest.approx(way, rel=0.01)


def test_speed_in_other_units_follows_from_the_times(tmp_path: Path) -> None:
    path = tmp_path / "kmh.csv"
    path.write_bytes(as_plane_csv([(t, e, n, 3.6 * v) for t, e, n, v in drive()]))
    scenario = driven(path, speed='lead = "recorded"')
    assert scenario.route.profile.at(10.0)[0] == pytest.approx(12.0, abs=0.05)
    assert any("3.60 times" in line and "km/h" in line for line in warnings(scenario))


def test_a_record_without_times_has_no_speed(tmp_path: Path) -> None:
    path = tmp_path / "plane.csv"
    path.write_text(CSV + "".join(f"{2 * k},0\n" for k in range(30)))
    with pytest.raises(ScenarioError, match=r"times, .*plane\.csv has none: .*speed\.set_mps"):
        driven(path, speed='lead = "recorded"')
    assert driven(path).route.profile.speeds == (20.0,)


def test_a_moving_lead_reaches_its_first_point_at_its_first_speed(
    tmp_path: Path,
) -> None:
    path = tmp_path / "start.csv"
    path.write_bytes(as_plane_csv(drive()))
    route = driven(path, speed='lead = "recorded"').route
    assert route.smoothed is not None
    assert route.start < route.smoothed.start
    assert route.profile.speeds[0] == pytest.approx(12.0, abs=0.01)
    assert route.run_in == pytest.approx(route.profile.times[1])
    assert route.profile.distance(route.run_in) == pytest.approx(route.smoothed.start - route.start)


def test_a_pause_of_ten_minutes_slows_the_lead_down_around_it_only() -> None:
    times = 0.5 * np.arange(60)
    profile, _ = recorded((times + 600.0 * (times >= 15.0)).tolist(), (10.0 * times).tolist(), ())
    speeds = [profile.at(t)[0] for t in (0.0, 5.0, 300.0, 622.0, 629.0)]
    assert speeds == pytest.approx([10.0, 10.0, 0.0, 10.0, 10.0], abs=0.01)
