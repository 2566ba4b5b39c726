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
from tests.made.second_reader import SecondReading


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


@pytest.mark.parametrize("table", ["vehicles", "links"])
def test_files_have_the_rows_of_the_tables_of_python(
    exported: tuple[Path, SecondReading], table: str
) -> None:
    """An unknown value is null or empty."""
    out, reading = exported
    run = convoy.open(json.loads((out / "export.json").read_text(encoding="utf-8"))["log"])
    expected = run.states if table == "vehicles" else run.messages
    for rows in rows_of(out, table):
        assert len(rows) == len(expected) > 100
        for name, column in expected.items():
            for row, value in zip(rows, column.tolist(), strict=True):
                if isinstance(value, float) and not math.isnan(value):
                    assert row[name] == pytest.approx(value, rel=1e-12, abs=1e-12)
                else:
                    assert row[name] == (None if isinstance(value, float) else value)
    if table == "vehicles":
        names = {name for name, topic in reading.messages if topic == "truth"}
        instants = {(name, one.true_at_ns) for name in names for one in reading.of(name, "truth")}
        assert instants <= set(zip(expected.vehicle, expected.at_ns.tolist(), strict=True))
        true, own = run.vehicles["v2"].true, expected.vehicle == "v2"
        places = np.searchsorted(expected.at_ns[own], true.at_ns)
        assert np.array_equal(expected.true_gap_m[own][places], true.gap_m, equal_nan=True)
    else:
        known = expected.distance_m[np.isfinite(expected.distance_m)]
        assert known.size
        assert 4.0 < known.min() < known.max() < 200.0


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
