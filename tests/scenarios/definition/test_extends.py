"""Scenario files that extend another one: what is merged, and what is refused."""

import tomllib
from pathlib import Path

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import (
    Scenario,
    load_scenario,
    scenario_from_text,
)
from tests.made.scenarios.messages import STRAIGHT

CURVED = """
name = "curved"
duration_s = 10.0
[convoy]
vehicles = 3
gap_m = 7.0
[path]
kind = "segments"
laps = 2
segments = [{ length_m = 300.0 }, { length_m = 100.0, radius_m = 200.0, turn = "left" }]
[links]
latency_ms = 30.0
loss_ratio = 0.25
[[link]]
sender = "v1"
receiver = "v3"
loss_ratio = 0.5
[vehicle.v2]
gap_m = 15.0
[vehicle.v2.loading]
rear_passengers = 2
"""
POINTS = f"east_m = {[10.0 * k for k in range(30)]}\nnorth_m = {[0.0] * 30}\n"
DRIVE = "t_s,x_m,y_m\n" + "".join(f"{k},{10 * k},0\n" for k in range(40))


def extending(folder: Path, base: str, text: str, *overrides: str) -> Scenario:
    """The scenario `text`, laid over `base`, from two files in `folder`."""
    (folder / "base.toml").write_text(base)
    (folder / "mine.toml").write_text(f'extends = "base.toml"\n{text}')
    return load_scenario(folder / "mine.toml", overrides)


def refused(path: Path | str, *overrides: str) -> str:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path, overrides)
    (line,) = caught.value.lines
    assert len(line) < 500
    assert line.isprintable()
    return line


# --- What is merged


def test_tables_are_merged_key_by_key_and_the_extending_file_s_keys_win(tmp_path: Path) -> None:
    text = """
name = "mine"
[convoy]
gap_m = 25.0
[links]
loss_ratio = 0.0
[vehicle.v2.loading]
front_passengers = 1
[vehicle.v3]
lateral_offset_m = 0.5
"""
    scenario = extending(tmp_path, CURVED, text)
    assert (scenario.name, scenario.duration_s) == ("mine", 10.0)
    assert scenario.route.gaps == (0.0, 15.0, 25.0)
    assert scenario.links["v1", "v2"].latency_ms == 30.0
    assert scenario.links["v1", "v2"].loss_ratio == 0.0
    assert scenario.links["v1", "v3"].loss_ratio == 0.5
    loading = scenario.tables.vehicle["v2"].loading
    assert loading is not None
    assert (loading.value.front_passengers, loading.value.rear_passengers) == (1, 2)
    assert scenario.vehicle("v3").lateral_offset_m == 0.5


def test_an_array_is_replaced_as_a_whole(tmp_path: Path) -> None:
    text = "link = []\n[path]\nsegments = [{ length_m = 700.0, curvature_per_m = 0.001 }]\n"
    scenario = extending(tmp_path, CURVED, text)
    assert scenario.links["v1", "v3"].loss_ratio == 0.25
    assert scenario.route.length == pytest.approx(2 * 700.0)  # the laps are the base's


def test_a_path_of_another_kind_takes_the_place_of_the_whole_path(tmp_path: Path) -> None:
    path = extending(tmp_path, CURVED, f"[path]\nkind = 'points'\n{POINTS}").tables.path
    assert path.kind == "points"
    assert path.laps == 1


def test_a_chain_goes_over_folders_and_shipped_scenarios(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "middle.toml").write_text('extends = "paper_a"\n[speed]\nset_mps = 12.0\n')
    top = tmp_path / "deep" / "top.toml"
    top.write_text('extends = "../middle.toml"\nname = "top"\nduration_s = 60.0\n')
    scenario, base = load_scenario(top), load_scenario("lane_change")
    assert (scenario.name, scenario.tables.speed.set_mps) == ("top", 12.0)
    assert scenario.tables.path == base.tables.path
    assert scenario.tables.gnss.value.position_noise == 0.0  # of paper_base
    assert scenario.tables.loading.value.rear_passengers == 2  # of paper_a


def test_a_trace_is_sought_beside_the_file_that_names_it(tmp_path: Path) -> None:
    for folder in ("bases", "mine"):
        (tmp_path / folder).mkdir()
    (tmp_path / "bases" / "drive.csv").write_text(DRIVE)
    trace = "name = 'base'\n[path]\nkind = 'trace'\nfile = 'drive.csv'\n"
    (tmp_path / "bases" / "base.toml").write_text(trace)
    mine = tmp_path / "mine" / "mine.toml"
    mine.write_text('extends = "../bases/base.toml"\n[path]\nsmoothing_m = 5.0\n')
    points = load_scenario(mine).tables.path.model_dump()
    assert (len(points["east_m"]), points["smoothing_m"]) == (40, 5.0)
    # Whoever names another trace, in the extending file or by an override, has it beside that file.
    (tmp_path / "mine" / "other.csv").write_text(DRIVE.rsplit("\n", 11)[0])
    assert len(load_scenario(mine, ["path.file=other.csv"]).tables.path.model_dump()["east_m"]) < 40
    mine.write_text(mine.read_text() + "file = 'other.csv'\n")
    assert len(load_scenario(mine).tables.path.model_dump()["east_m"]) < 40


def test_overrides_are_laid_over_the_merged_tables(tmp_path: Path) -> None:
    scenario = extending(
        tmp_path, CURVED, "duration_s = 12.0\n", "duration_s=14.0", "path.segments.0.length_m=500"
    )
    assert scenario.duration_s == 14.0
    assert scenario.route.length == pytest.approx(2 * 600.0)


def test_the_text_of_an_extending_scenario_is_all_of_it(tmp_path: Path) -> None:
    scenario = extending(tmp_path, CURVED, "name = 'mine'\n[vehicle.v3]\ngap_m = 9.0\n")
    assert "extends" not in tomllib.loads(scenario.text)
    again = scenario_from_text(scenario.text)
    assert again.tables == scenario.tables
    assert again.text == scenario.text


# --- What is refused


@pytest.mark.parametrize(
    ("given", "shown", "why"),
    [
        ("'lane_chagne'", '"lane_chagne"', "no such file, did you mean lane_change?"),
        ("'bas.toml'", '"bas.toml"', "no such file, did you mean base.toml?"),
        ("'.'", '"."', "is a directory"),
        ("'empty.toml'", '"empty.toml"', "empty file"),
        ("'binary.toml'", '"binary.toml"', "byte 0 is not UTF-8"),
        ("''", '""', ""),
        ("3", "3", ""),
        ("['base.toml']", '["base.toml"]', ""),
        (r'"a\u0000b"', r'"a\u0000b"', "embedded null"),
        (f"'{'x' * 300}.toml'", '"xxx', "file name too long"),
    ],
)
def test_a_base_that_cannot_be_read_is_refused_with_file_key_given_and_allowed(
    tmp_path: Path, given: str, shown: str, why: str
) -> None:
    (tmp_path / "base.toml").write_text(CURVED)
    (tmp_path / "empty.toml").write_text("\n")
    (tmp_path / "binary.toml").write_bytes(bytes(range(128, 256)))
    (tmp_path / "mine.toml").write_text(f"extends = {given}\n")
    line = refused(tmp_path / "mine.toml")
    assert line.startswith(f"{tmp_path / 'mine.toml'}: extends: given {shown}")
    assert why in line
    assert "allowed a path relative to this file, or church_lot, highway, lane_change" in line


def test_files_in_a_circle_are_refused_with_the_whole_chain(tmp_path: Path) -> None:
    a, b, c = (tmp_path / f"{name}.toml" for name in "abc")
    a.write_text('extends = "b.toml"\n')
    b.write_text('extends = "c.toml"\n')
    c.write_text(f'extends = "../{tmp_path.name}/b.toml"\n')  # the same file by another path
    again = tmp_path / ".." / tmp_path.name / "b.toml"
    assert refused(a) == f"{c}: extends: files in a circle: {a}, {b}, {c}, {again}"
    c.write_text('extends = "c.toml"\n')
    assert refused(c) == f"{c}: extends: files in a circle: {c}, {c}"


@pytest.mark.parametrize(
    ("base", "text", "override", "expected"),
    [
        ("[links]\nlatency_s = 1\n", "", (), "base.toml: links.latency_s: unknown key"),
        ("seed = -1\n", "duration_s = 9.0\n", (), "base.toml: seed: given -1"),
        ("seed = -1\n", "seed = -2\n", (), "mine.toml: seed: given -2"),
        ("seed = -1\n", "seed = -2\n", ("seed=-3",), "--set: seed: given -3"),
        ("seed = 1\n", "[vehicle.v9]\n", (), "mine.toml: vehicle.v9: no such vehicle"),
        ("[vehicle.v9]\ngap_m = 9.0\n", "", (), "base.toml: vehicle.v9: no such vehicle"),
        (
            "[[link]]\nsender = 'v1'\nreceiver = 'v8'\n",
            "[links]\nloss_ratio = 0.1\n",
            (),
            "base.toml: link[0].receiver: given",
        ),
        (
            "[speed]\nset_mps = 9.0\n",
            "[speed]\nlead = 'profile'\n",
            (),
            "mine.toml: speed.profile:",
        ),
        ("[speed]\nlead = 'profile'\n", "seed = 3\n", (), "base.toml: speed.profile: missing"),
        ("[convoy]\ngap_m = -2.0\n", "[convoy]\nvehicles = 2\n", (), "base.toml: convoy.gap_m:"),
        ("seed = 1\n", "[path]\nkind = 'trace'\n", (), "mine.toml: path.file: missing"),
    ],
)
def test_a_refusal_names_the_file_that_gives_the_key(
    tmp_path: Path, base: str, text: str, override: tuple[str, ...], expected: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        extending(
            tmp_path,
            base.partition("[")[0] + STRAIGHT + "".join(base.partition("[")[1:]),
            text,
            *override,
        )
    (line,) = caught.value.lines
    assert line.removeprefix(f"{tmp_path}/").startswith(expected)


def test_what_a_file_extends_cannot_be_overridden(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(STRAIGHT)
    line = refused(tmp_path / "mine.toml", "extends=lane_change")
    assert line == "--set extends=lane_change: allowed in a scenario file only"
