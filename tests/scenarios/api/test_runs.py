"""Runs of a folder as a table: on the terminal, as JSON, and in Python."""

import json
import os
from pathlib import Path
from shutil import copytree

import pytest
from click.testing import CliRunner, Result

import scenarios.api as convoy
from scenarios.cli.main import cli
from scenarios.runs.run_folder import claimed
from scenarios.studies.run_list import runs_in, selected


def command(*arguments: object, width: int = 200) -> Result:
    return CliRunner().invoke(
        cli, ["runs", *map(str, arguments)], env={"COLUMNS": str(width), "NO_COLOR": "1"}
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    short = {"duration_s": 3.0, "convoy.vehicles": 2}
    first = convoy.run(set=short, out=folder / "first")
    convoy.run(set=short | {"limits.true_gap_m_min": 50.0}, seed=2, out=folder / "deep" / "second")
    data = first.log.read_bytes()
    (folder / "half.mcap").write_bytes(data[: len(data) // 2])
    (folder / "none.mcap").write_bytes(b"no log")
    return folder


def test_every_log_is_a_row(folder: Path) -> None:
    done = command(folder, "--json")
    assert done.exit_code == 0
    rows = {row["log"]: row for row in json.loads(done.stdout)}
    names = ("deep/second", "first", "half.mcap", "none.mcap")
    assert list(rows) == [str(folder / name) for name in names]
    second, first, half, none = rows.values()
    summary = convoy.open(folder / "first").summary
    assert first["worst_error_m"] == summary.vehicles[1].cross_track_error_m_max
    assert (first["outcome"], first["seed"], first["events"]) == ("completed", 1, 0)
    assert first["line"] == summary.outcome_line
    assert second["outcome"] == "failed"
    assert "limits.true_gap_m_min=50.0" in second["overrides"]
    assert half["outcome"] == "failed"
    assert half["worst_error_m"] is not None
    assert none["outcome"] == "unreadable"
    assert none["line"].startswith(str(folder / "none.mcap"))


def test_faults_of_logs_are_listed_from_their_endings(folder: Path, tmp_path: Path) -> None:
    logs = {name: copytree(folder / "first", tmp_path / name) / "run.mcap" for name in "abcd"}
    data = logs["a"].read_bytes()
    logs["b"].write_bytes(data[:-5000])
    logs["c"].write_bytes(data[:50_000] + data[60_000:])
    logs["d"].unlink()
    for log in (logs["b"], logs["c"]):
        os.utime(log, ns=(0, 0))
    other = tmp_path / "summary.json"
    other.write_text('{"schema": "of another program"}')
    expected = {
        "a": "", "b": "was not completed", "c": "damaged: its index does not match its content",
        "d": "missing",
    }  # fmt: skip
    names = {Path(run.log).name: run for run in runs_in(tmp_path)}
    assert {name: run.faults for name, run in names.items()} == expected
    assert {run.outcome for run in names.values()} == {"completed"}
    done = command(tmp_path)
    assert "\n4: log: missing" in done.stdout
    assert done.stdout.count(" faulty ") == 3
    assert [row["faults"] for row in json.loads(command(tmp_path, "--json").stdout)] == [
        *expected.values()
    ]
    assert convoy.runs(tmp_path, ["faults~missing"]).log.tolist() == [str(tmp_path / "d")]


def test_a_run_that_still_runs_is_listed_as_running(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "now"
    with claimed(out):
        (out / "run.mcap").write_bytes((folder / "half.mcap").read_bytes())
        (run,) = runs_in(tmp_path)
        assert convoy.open(out).summary.outcome == run.outcome == "running"


@pytest.mark.parametrize(
    ("conditions", "names"),
    [
        ((), ["second", "first", "half.mcap", "none.mcap"]),
        (("outcome=failed",), ["second", "half.mcap"]),
        (("outcome != failed",), ["first", "none.mcap"]),
        (("seed>1",), ["second"]),
        (("worst_error_m>=0", "seed = 1"), ["first", "half.mcap"]),
        (("overrides~gap",), ["second"]),
        (("log~half",), ["half.mcap"]),
        (("seed!=2",), ["first", "half.mcap", "none.mcap"]),
        (("events>0",), []),
    ],
)
def test_conditions_select_runs(
    folder: Path, conditions: tuple[str, ...], names: list[str]
) -> None:
    chosen = selected(runs_in(folder), conditions)
    assert [Path(run.log).name for run in chosen] == names


def test_runs_are_sorted_with_unknown_values_last(folder: Path) -> None:
    runs = runs_in(folder)
    for sort, sign in (("worst_error_m", 1.0), ("-worst_error_m", -1.0)):
        *known, unknown = selected(runs, (), sort)
        values = [run.worst_error_m or 0.0 for run in known]
        assert values == sorted(values, key=lambda value: sign * value)
        assert unknown.outcome == "unreadable"


@pytest.mark.parametrize(
    "option", ["--where=evnts>0", "--where=events>many", "--where=events", "--sort=error"]
)
def test_bad_options_are_refused_in_one_line(folder: Path, option: str) -> None:
    done = command(folder, option)
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")


@pytest.mark.parametrize("name", ["", "no_such_folder"])
def test_a_folder_without_runs_is_refused(tmp_path: Path, name: str) -> None:
    done = command(tmp_path / name)
    assert done.exit_code == 2
    assert done.stderr.count("\n") == 1


def test_python_gets_the_same_rows(folder: Path) -> None:
    table = convoy.runs(folder, ["seed>=1"], "-seed")
    assert [Path(log).name for log in table.log] == ["second", "first", "half.mcap"]
    assert table.seed.tolist() == [2, 1, 1]
    assert len(convoy.runs(folder, ["seed>5"])) == 0
    assert convoy.open(table.log[0]).summary.identity.seed == 2
    with pytest.raises(convoy.Error, match="allowed log"):
        convoy.runs(folder, sort="nothing")
