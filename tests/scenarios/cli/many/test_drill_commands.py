"""`convoy drill`: its tables, files, exit codes and refusals."""

import json
import signal
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.definition.scenario import load_scenario
from scenarios.results.limits import deadline_figures, limit_figures
from scenarios.results.log_summary import summary_of, tables_of
from scenarios.results.run_event import run_events
from scenarios.results.summary import to_json
from scenarios.results.vehicle_figures import vehicle_summaries
from scenarios.runs.virtual import run_unlogged

SHORT = """
extends = "lane_change"
name = "short"
description = "two seconds"
duration_s = 2.0
convoy.vehicles = 2

[limits]
collisions_max = 0
cross_track_error_m_max = {error}

[[limits.modes]]
vehicle = "v2"
mode = "lead"
within_s = 0.5
"""


@pytest.fixture(autouse=True)
def own_signals() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def convoy(*arguments: str | int | Path) -> Result:
    return CliRunner().invoke(cli, list(map(str, arguments)), env={"COLUMNS": "120"})


def short(folder: Path, name: str = "short", error: float = 0.5) -> Path:
    file = folder / f"{name}.toml"
    file.write_text(SHORT.format(error=error))
    return file


def test_a_passed_drill_has_a_table_two_files_and_exit_code_0(tmp_path: Path) -> None:
    file, xml = short(tmp_path), tmp_path / "reports" / "drills.xml"
    done = convoy("drill", file, "--workers", 0, "--out", tmp_path / "out", "--junit", xml)
    assert done.exit_code == 0, done.output
    assert "v2 in mode lead" in done.stdout
    assert "1 of 1 drills passed, 3 of 3 limits kept" in done.stdout
    table = json.loads((tmp_path / "out" / "drills.json").read_text())
    assert [row["limit"] for row in table["rows"]] == [
        "collisions_max",
        "cross_track_error_m_max",
        "modes[0]",
    ]
    assert all(row["passed"] for row in table["rows"])
    assert Xml.parse(xml).getroot().get("tests") == "3"
    again = convoy("drill", file, "--workers", 0, "--junit", xml)
    assert (again.exit_code, again.stderr) == (2, f"error: {xml}: exists; give another place\n")


def test_a_failed_drill_names_the_command_that_repeats_it(tmp_path: Path) -> None:
    file = short(tmp_path, error=0.001)
    done = convoy("drill", file, "--workers", 0, "--seeds", 2)
    assert done.exit_code == 1
    assert "0 of 1 drills passed, 2 of 3 limits kept" in done.stdout
    (line,) = (one.strip() for one in done.stdout.splitlines() if one.startswith("    convoy run"))
    assert line.startswith(f"convoy run {file} --seed ")
    repeated = convoy(*line.split()[1:], "--out", tmp_path / "run")
    assert repeated.exit_code == 1
    assert "limits.cross_track_error_m_max = 0.001" in repeated.output


def test_run_log_and_drill_agree_about_limits(tmp_path: Path) -> None:
    file = short(tmp_path, error=0.001)
    convoy("run", file, "--clock", "virtual", "--quiet", "--out", tmp_path / "run")
    log = tmp_path / "run" / "run.mcap"
    summary = summary_of(log)
    assert [one.limit for one in summary.limits if one.broken] == ["cross_track_error_m_max"]
    assert to_json(run_unlogged(load_scenario(file))) == to_json(summary)
    run = tables_of(log)
    found = limit_figures(
        run.scenario.tables.limits,
        run_events(run),
        vehicle_summaries(run, {}),
        deadline_figures(run),
    )
    assert found == summary.limits
    assert summary.limits[2].value == 0.02  # its second command


def test_overrides_apply_to_each_drill(tmp_path: Path) -> None:
    file = short(tmp_path)
    done = convoy("drill", file, "--workers", 0, "--set", "limits.cross_track_error_m_max=0.001")
    assert done.exit_code == 1
    assert "--set=limits.cross_track_error_m_max=0.001" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("nowhere",), "nowhere: no such file"),
        (("lane_change",), "lane_change: limits: missing"),
        (("tunnel", "--set", "links.loss=1"), "--set: links.loss: given 1"),
    ],
)
def test_invalid_drills_are_refused_in_one_line(arguments: tuple[str, ...], line: str) -> None:
    refused = convoy("drill", *arguments, "--workers", "0")
    assert refused.exit_code == 2
    assert refused.stderr.startswith(f"error: {line}")
    assert refused.stderr.count("\n") == 1
