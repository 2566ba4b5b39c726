"""`convoy diff`: equal runs, one planted difference, damage, and noise over seeds."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.definition.scenario import load_scenario
from scenarios.results.log_summary import summary_of
from scenarios.results.summary import RunSummary
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from scenarios.studies.comparison.run_diff import figure_differences, logs_of
from transport.log.errors import LogError
from transport.log.mcap_file import McapFile


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("short")
    run_virtual(load_scenario("lossy_lane_change", ["duration_s=3.0"]), folder, Stop())
    return folder / "run.mcap"


def diff(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["diff", *map(str, arguments)])


def test_two_runs_of_one_seed_are_identical(tmp_path: Path) -> None:
    for name in ("a", "b"):
        run_virtual(load_scenario("lane_change", ["duration_s=1.0"]), tmp_path / name, Stop())
    result = diff(tmp_path / "a", tmp_path / "b")
    assert result.exit_code == 0
    assert "identical" in result.output


def test_damage_of_either_log_is_named(whole: Path, tmp_path: Path) -> None:
    data = bytearray(whole.read_bytes())
    chunks = McapFile(whole).chunks
    middle = chunks[len(chunks) // 2]
    data[(middle.start + middle.end) // 2] ^= 1
    damaged = tmp_path / "run.mcap"
    damaged.write_bytes(data)
    for pair in ((whole, damaged), (damaged, whole)):
        result = diff(*pair, "--json")
        (fault,) = json.loads(result.stdout)["log_faults"]
        assert str(damaged) in fault
        assert fault in result.stderr
        assert result.exit_code == 1


def test_settings_that_differ_are_listed(tmp_path: Path) -> None:
    for name, gap in (("a", 10), ("b", 12)):
        scenario = load_scenario("lane_change", ["duration_s=0.2", f"convoy.gap_m={gap}"])
        run_virtual(scenario, tmp_path / name, Stop())
    found = json.loads(diff(tmp_path / "a", tmp_path / "b", "--json").stdout)
    assert found["settings"] == [{"key": "convoy.gap_m", "a": "10.0", "b": "12.0"}]


def with_error(summary: RunSummary, seed: int, error: float) -> RunSummary:
    vehicles = [
        replace(row, cross_track_error_m_max=error) if row.name == "v2" else row
        for row in summary.vehicles
    ]
    identity = replace(summary.identity, seed=seed)
    return replace(summary, identity=identity, vehicles=tuple(vehicles))


@pytest.mark.parametrize(("shift", "exceeds"), [(0.0, False), (0.001, False), (0.05, True)])
def test_a_shift_beyond_the_noise_over_seeds_is_marked(
    whole: Path, shift: float, exceeds: bool
) -> None:
    summary = summary_of(whole)
    errors = (0.05, 0.06, 0.055, 0.052, 0.058)
    noise = (0.002, -0.003, 0.001, -0.001, 0.002)
    a = [with_error(summary, seed, error) for seed, error in enumerate(errors)]
    for first_seed in (0, 100):  # paired, and independent
        b = [
            with_error(summary, first_seed + n, errors[n] + noise[n] + shift)
            for n in range(len(errors))
        ]
        (figure,) = figure_differences(a, b)
        assert figure.name == "v2.cross_track_error_m_max"
        assert figure.paired == (first_seed == 0)
        assert figure.exceeds_noise is exceeds


def test_a_folder_of_runs_and_a_pattern_name_all_runs(whole: Path, tmp_path: Path) -> None:
    for name in ("one-a", "one-b", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.mcap").symlink_to(whole)
    assert len(logs_of(tmp_path)) == 3
    assert [log.parent.name for log in logs_of(tmp_path / "one-*")] == ["one-a", "one-b"]
    with pytest.raises(LogError):
        logs_of(tmp_path / "three-*")
    assert diff(tmp_path, tmp_path / "two").exit_code == 2  # one run has no noise
    assert diff(tmp_path / "one-*", tmp_path / "one-*").exit_code == 0
