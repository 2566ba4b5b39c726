"""The exit code of a run on the wall clock whose recorder was killed."""

from pathlib import Path

import pytest

from scenarios.cli import wall_clock_run
from scenarios.cli.common_options import DisplayOptions
from scenarios.definition.scenario import load_scenario
from scenarios.results.files import SUMMARY_NAME
from scenarios.runs.processes.supervisor import LaunchPlan, RunOutcome, Supervisor
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual


@pytest.mark.parametrize(
    ("limit", "cut", "exit_code"),
    [
        (10.0, False, 0),
        (1e-6, False, 1),
        (10.0, True, 1),
    ],
    ids=["completed", "failed", "broken off"],
)
def test_a_recorder_killed_after_its_log_was_complete_fails_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: float, exit_code: int, *, cut: bool
) -> None:
    scenario = load_scenario(
        "lane_change", ["duration_s=1", f"limits.cross_track_error_m_max={limit}"]
    )
    run_virtual(scenario, tmp_path, Stop())
    (tmp_path / SUMMARY_NAME).unlink()
    log = tmp_path / "run.mcap"
    if cut:
        log.write_bytes(log.read_bytes()[:-2000])

    def launch(*_arguments: object, **_options: object) -> RunOutcome:
        repaired = wall_clock_run._complete(log)
        reason = "recorder was killed by signal 9"
        return RunOutcome(1, reason, repaired=repaired, recorder_killed=True)

    monkeypatch.setattr(wall_clock_run, "launch", launch)
    plan = LaunchPlan(scenario, (), tmp_path, (), "mine")
    display = DisplayOptions(quiet=True)
    code = wall_clock_run.launch_and_report(plan, Stop(), Supervisor(lambda _: None), display)
    assert code == exit_code
    completed = '"outcome": "completed"'
    if exit_code == 0 or cut:
        written = (tmp_path / SUMMARY_NAME).read_text(encoding="utf-8")
        assert (completed in written) == (exit_code == 0)
