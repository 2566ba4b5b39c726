"""`convoy check` of a recorded drive: its figures, its picture, and what is known if refused."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from tests.made.scenarios.recorded_drives import CSV, Drive, as_gpx, as_plane_csv, drive


def convoy(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, list(map(str, arguments)))


def facts(*arguments: str | Path) -> dict[str, Any]:
    result = convoy("check", *arguments, "--json")
    assert result.exit_code == 0, result.output
    found: dict[str, Any] = json.loads(result.stdout)["drive"]
    return found


def straight(count: int = 200, speed: float = 10.0) -> Drive:
    return [(0.1 * k, 0.1 * speed * k, 0.0, speed) for k in range(count)]


def rough() -> list[str]:
    points = [
        (t + 60.0 * (k > 50), e, 3.0 * (k in (120, 121)), v)
        for k, (t, e, _, v) in enumerate(straight())
    ]
    lines = [f"{t:.1f},{e:.1f},{n:.1f}" for t, e, n, _ in points]
    del lines[80:110]
    lines[10] = "1.0,here,0"
    lines[20] = "2.0,20"
    return ["t_s,x_m,y_m", *lines]


def back_and_forth() -> bytes:
    return as_plane_csv([*straight(), *((40.0 - t, e, 1.0, v) for t, e, _, v in straight()[::-1])])


def test_the_figures_of_a_bend_in_a_gpx_file(tmp_path: Path) -> None:
    path = tmp_path / "bend.gpx"
    path.write_bytes(as_gpx(drive()))
    found = facts(path)
    exact = {"file": "bend.gpx", "records": 201, "points": 201, "left_out": {}, "holes": []}
    assert found.items() >= exact.items()
    assert found["begins_at"] == "2023-11-14T22:13:20.000Z"
    assert (found["duration_s"], found["rate_hz"]) == pytest.approx((20.0, 10.0), abs=1e-3)
    assert found["length_m"] == pytest.approx(240.0, abs=0.05)
    assert found["speed_source"] == "derived"
    speeds = [found[f"speed_mps_{name}"] for name in ("min", "mean", "max")]
    assert speeds == pytest.approx([12.0, 12.0, 12.0], abs=0.05)
    on_path = found["path"]
    assert on_path["radius_m_min"] == pytest.approx(150.0, rel=0.1)
    bend_speed = math.sqrt(3.0 * on_path["radius_m_min"])
    assert on_path["bend_speed_mps_max"] == pytest.approx(bend_speed, rel=1e-6)
    assert on_path["turning_radius_m"] == pytest.approx(5.3, abs=0.1)
    assert on_path["smoothing_m"] == 8.0


def test_faults_of_a_recording_are_counted_and_placed(tmp_path: Path) -> None:
    path = tmp_path / "rough.csv"
    path.write_text("\n".join(rough()))
    found = facts(path)
    assert sum(found["left_out"].values()) == 4
    assert found["left_out"]["jump"] == 2
    assert found["records"] - found["points"] == 4
    assert len(found["left_out_first"]) == 4
    (pause,), (hole,) = found["pauses"], found["holes"]
    assert pause["after"] == "line 52 (5.0 s)"
    assert (pause["at_m"], pause["lasts_s"]) == pytest.approx((50.0, 60.1), abs=0.1)
    assert hole["after"].startswith("line 81 ")
    assert (hole["at_m"], hole["length_m"]) == pytest.approx((79.0, 31.0), abs=0.1)
    assert found["duration_s"] == pytest.approx(79.9)
    assert found["speed_mps_mean"] == pytest.approx(10.0, abs=0.1)
    cut = facts(path, "--set", 'path.pauses="cut"')
    assert cut["duration_s"] == pytest.approx(19.9, abs=0.2)
    assert cut["pauses"][0]["is_cut"]
    assert cut["holes"][0]["after"] == hole["after"]


def test_the_table_has_each_fault_once_and_the_command_that_runs(tmp_path: Path) -> None:
    path = tmp_path / "rough.csv"
    path.write_text("\n".join(rough()))
    result = convoy("check", path, "--set", "convoy.gap_m=12")
    assert result.exit_code == 0
    assert result.stdout.count("line 52 (5.0 s)") == 1
    assert result.stdout.count("line 81 ") == 1
    command = f"convoy run {path} --set=convoy.gap_m=12 --clock virtual"
    assert result.stdout.splitlines()[-1].endswith(command)


def test_a_scenario_with_a_trace_has_its_usual_table_and_the_facts_as_json(tmp_path: Path) -> None:
    (tmp_path / "bend.csv").write_bytes(as_plane_csv(drive()))
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\n[path]\nkind = "trace"\nfile = "bend.csv"\n')
    assert facts(path)["speed_source"] == "recorded"
    assert "requested channel" in convoy("check", path).stdout
    assert json.loads(convoy("check", "lane_change", "--json").stdout)["drive"] is None


@pytest.mark.parametrize(
    ("content", "why", "points", "length"),
    [
        (back_and_forth(), "double back", 400, 399.0),
        (b"t_s,x_m,y_m\n0,0,0\n1,9,0\n2,18,0\n", "at least 8 points", 3, 18.0),
        ((CSV + "0,0\n0.1,0\n" * 10).encode(), "within 0.10 m", 20, 1.9),
    ],
)
def test_a_refused_drive_is_reported_and_drawn_before_its_error(
    tmp_path: Path, content: bytes, why: str, points: int, length: float
) -> None:
    path, picture = tmp_path / "drive.csv", tmp_path / "drive.png"
    path.write_bytes(content)
    result = convoy("check", path, "--output", picture)
    assert result.exit_code == 2
    (error,) = result.stderr.splitlines()
    assert error.startswith(f"error: {path}: ")
    assert why in error
    assert f"{points} of {points} records" in result.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
    whole = json.loads(convoy("check", path, "--json").stdout)
    assert whole["errors"] == [error.removeprefix("error: ")]
    assert whole["drive"]["path"] is None
    assert whole["drive"]["length_m"] == pytest.approx(length, abs=2.0)


def test_the_picture_is_the_same_every_time_and_small(tmp_path: Path) -> None:
    path = tmp_path / "rough.csv"
    path.write_text("\n".join(rough()))
    contents = []
    for name in ("one.svg", "two.svg"):
        assert convoy("check", path, "--out", tmp_path / name).exit_code == 0
        contents.append((tmp_path / name).read_bytes())
    assert contents[0] == contents[1]
    assert len(contents[0]) < 200_000


@pytest.mark.parametrize(
    ("scenario", "picture"),
    [("drive.csv", "drive.jpg"), ("drive.csv", "there.svg"), ("lane_change", "drive.svg")],
)
def test_a_picture_that_cannot_be_drawn_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scenario: str, picture: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("drive.csv").write_bytes(as_plane_csv(straight()))
    Path("there.svg").touch()
    result = convoy("check", scenario, "--out", picture)
    assert result.exit_code == 2
    assert len(result.stderr.splitlines()) == 1
    assert not Path(picture).exists() or not Path(picture).read_bytes()
