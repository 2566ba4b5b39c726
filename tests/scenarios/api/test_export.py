"""Exported files are read back by other libraries, and agree with a second reading of the log."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import duckdb
import gpxpy
import numpy as np
import pandas
import pytest
from click.testing import CliRunner, Result

import scenarios.api as convoy
from scenarios.cli.main import cli
from tests.made import second_reader
from tests.made.second_reader import DEVIATION, SecondReading

TRUE = ("east_m", "north_m", "yaw_rad", "speed_mps")
OWN = (
    *("lateral_error_m", "heading_error_rad", "estimated_gap_m", "measured_gap_m"),
    *("lead_age_s", "predecessor_age_s", "mode"),
)


def command(*arguments: object) -> Result:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


@pytest.fixture(params=["new", "earlier version", "damaged"])
def exported(
    logs: dict[str, Path], request: pytest.FixtureRequest, tmp_path: Path
) -> tuple[Path, SecondReading]:
    log, out = logs[request.param], tmp_path / "export"
    formats = ("--format=csv", "--format=parquet", "--format=gpx")
    done = command("export", log, *formats, "--out", out)
    assert done.exit_code == 0, done.output
    assert bool(done.stderr) == (request.param == "damaged")
    assert all(
        ("(log: damaged, " in line) == bool(done.stderr) for line in done.stdout.splitlines()
    )
    reading = second_reader.read(log)
    assert reading.damaged == (request.param == "damaged")
    return out, reading


def query(text: str) -> list[dict[str, Any]]:
    cursor = duckdb.connect().execute(text)
    names = [column[0] for column in cursor.description or ()]
    return [dict(zip(names, row, strict=True)) for row in cursor.fetchall()]


def rows_of(out: Path, table: str) -> Iterator[list[dict[str, Any]]]:
    yield query(f"select * from read_parquet('{out / table}.parquet')")
    yield query(f"select * from read_csv('{out / table}.csv')")
    frame = pandas.read_csv(out / f"{table}.csv")
    yield [
        {name: None if pandas.isna(value) else value for name, value in row.items()}
        for row in frame.to_dict("records")
    ]


def known(value: Any) -> Any:
    """None for NaN, as in files."""
    return None if isinstance(value, float) and math.isnan(value) else value


def test_the_table_of_vehicles(exported: tuple[Path, SecondReading]) -> None:
    out, reading = exported
    names = {name for name, topic in reading.messages if topic == "truth"}
    truth = {(name, m.true_at_ns): m for name in names for m in reading.of(name, "truth")}
    own = {(name, m.decided_at_ns): m for name in names for m in reading.of(name, "tracking")}
    figures = {(name, m.true_at_ns): m for name in names for m in reading.of(name, DEVIATION)}
    start_at = reading.of("run", "start")[0].start_at_ns
    ours = true_figures(out)
    for rows in rows_of(out, "vehicles"):
        assert {(row["vehicle"], row["at_ns"]) for row in rows} == truth.keys() | own.keys()
        assert len(rows) == len(truth.keys() | own.keys())
        compared = 0
        for row in rows:
            key = row["vehicle"], row["at_ns"]
            assert row["t_s"] == pytest.approx((row["at_ns"] - start_at) / 1e9, abs=1e-12)
            for column in TRUE:
                assert row[column] == (getattr(truth[key], column) if key in truth else None)
            for column in OWN:
                value = second_reader.value(own[key], "tracking", column) if key in own else None
                assert row[column] == known(value)
            assert (row["station_m"] is None) == (row["true_error_m"] is None)
            for column in ("true_error_m", "station_m", "true_gap_m"):
                assert row[column] == ours.get(key, {}).get(column)
            if key in figures and row["true_error_m"] is not None and not reading.damaged:
                error_m = known(figures[key].cross_track_error_m)
                assert row["true_error_m"] == pytest.approx(error_m, rel=1e-12)
                assert row["true_gap_m"] == pytest.approx(known(figures[key].true_gap_m), rel=1e-12)
                compared += 1
        assert compared > 50 or reading.damaged


def true_figures(out: Path) -> dict[tuple[str, int], dict[str, Any]]:
    """Figures of each true pose in Python, which agree with a second reading elsewhere."""
    figures = {}
    for name, record in convoy.open(
        json.loads((out / "export.json").read_text())["log"]
    ).vehicles.items():
        true = record.true
        columns = (true.at_ns, true.error_m, true.station_m, true.gap_m)
        for at, *values in zip(*(column.tolist() for column in columns), strict=True):
            names = ("true_error_m", "station_m", "true_gap_m")
            figures[name, at] = dict(zip(names, map(known, values), strict=True))
    return figures


def test_the_table_of_links(exported: tuple[Path, SecondReading]) -> None:
    out, reading = exported
    names = {name for name, topic in reading.messages if topic == "truth"}
    verdicts = {
        (verdict.sender, name, verdict.pose_seq): verdict
        for name in names
        for verdict in reading.of(name, "verdict")
    }
    start_at = reading.of("run", "start")[0].start_at_ns
    for rows in rows_of(out, "links"):
        seen = set()
        assert any(row["distance_m"] for row in rows)
        for row in rows:
            assert row["distance_m"] is None or 4.0 < row["distance_m"] < 200.0
            key = row["sender"], row["receiver"], row["number"]
            assert row["t_s"] == pytest.approx((row["sent_at_ns"] - start_at) / 1e9, abs=1e-12)
            seen.add(key)
            if key not in verdicts:
                assert row["outcome"] in {"in_flight", "not_arrived", "unrecorded"}
                assert row["delay_s"] is None
                continue
            verdict = verdicts[key]
            assert row["sent_at_ns"] == verdict.sent_at_ns
            assert row["outcome"] == verdict.outcome
            assert row["cause"] == (verdict.reason if row["outcome"] == "dropped" else None)
            assert (row["delay_s"] is None) == (row["outcome"] == "dropped")
            if row["delay_s"] is not None:
                usable_at = verdict.received_at_ns if verdict.late else verdict.visible_at_ns
                delay_ns = usable_at - verdict.sent_at_ns
                assert row["delay_s"] == pytest.approx(delay_ns / 1e9, abs=1e-12)
        assert seen >= verdicts.keys()
        assert len(seen) == len(rows)


def test_tracks(exported: tuple[Path, SecondReading]) -> None:
    out, reading = exported
    for path in out.glob("*.gpx"):
        poses = reading.of(path.stem, "gps")
        gpx = gpxpy.parse(path.read_text(encoding="utf-8"))
        (track,) = gpx.tracks
        assert track.name == path.stem
        points = track.segments[0].points
        assert len(points) == len(poses)
        for point, pose in zip(points, poses, strict=True):
            assert point.latitude == pytest.approx(pose.latitude_deg, abs=1e-10)
            assert point.longitude == pytest.approx(pose.longitude_deg, abs=1e-10)
            assert point.elevation == pytest.approx(pose.altitude_m, abs=1e-4)
            assert point.time is not None
            assert point.time.timestamp() == pytest.approx(pose.measured_at_ns / 1e9, abs=1e-6)


def test_files_state_their_log_and_its_faults(exported: tuple[Path, SecondReading]) -> None:
    out, reading = exported
    origin = json.loads((out / "export.json").read_text(encoding="utf-8"))
    assert origin["scenario"] in {"lane_change", "golden"}
    assert ("cannot be read" in origin["log_faults"]) == bool(reading.damaged)
    for table in ("vehicles", "links"):
        rows = query(f"select * from parquet_kv_metadata('{out / table}.parquet')")
        stored = {row["key"].decode(): row["value"].decode() for row in rows}
        assert {name: stored[name] for name in origin} == origin
        assert pandas.read_parquet(out / f"{table}.parquet").shape[0] > 100
    description = gpxpy.parse((out / "v1.gpx").read_text(encoding="utf-8")).description
    assert origin["log"] in str(description)
    assert ("cannot be read" in str(description)) == bool(reading.damaged)


def test_an_exported_track_drives_a_lead(logs: dict[str, Path], tmp_path: Path) -> None:
    run = convoy.open(logs["new"])
    run.export(tmp_path, ["gpx"])
    again = convoy.run(tmp_path / "v1.gpx", set={"convoy.vehicles": 2}, out=tmp_path / "again")
    assert again.summary.outcome == "completed"
    before, after = (one.vehicles["v1"].true for one in (run, again))
    east, north = (
        np.interp(before.distance_m[:150], after.distance_m, column)
        for column in (after.east_m - after.east_m[0], after.north_m - after.north_m[0])
    )
    assert np.hypot(east - before.east_m[:150], north - before.north_m[:150]).max() < 0.3


def test_files_are_written_once(logs: dict[str, Path], tmp_path: Path) -> None:
    out = tmp_path / "export"
    done = command("export", logs["new"].parent, "--out", out)
    assert done.exit_code == 0
    names = {"vehicles.csv", "links.csv", "export.json", "v1.gpx", "v2.gpx", "v3.gpx", "v4.gpx"}
    assert {path.name for path in out.iterdir()} == names
    assert sorted(done.stdout.split()[1::2]) == sorted(str(out / name) for name in names)
    again = command("export", logs["new"].parent, "--out", out)
    assert again.exit_code == 2
    assert again.stderr.startswith(f"error: {out}")
    with pytest.raises(convoy.Error, match="xlsx"):
        convoy.open(logs["new"]).export(tmp_path / "other", ["xlsx"])  # type: ignore[list-item]
