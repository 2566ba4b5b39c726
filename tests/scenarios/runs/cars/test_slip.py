"""What an unknown load costs the paper's base case, and what learning it saves."""

from pathlib import Path

from scenarios.definition.scenario import load_scenario
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual

FIRST_LANE_CHANGE = ["convoy.vehicles=8", "duration_s=11", "control.controller=slip_compensated"]


def true_errors(folder: Path, *changes: str) -> list[float]:
    """Largest true error of each follower (m)."""
    scenario = load_scenario("paper_base", [*FIRST_LANE_CHANGE, *changes])
    summary = run_virtual(scenario, folder, Stop())
    return [row.cross_track_error_m_max or 0.0 for row in summary.vehicles[1:]]


def test_a_load_that_is_learned_leaves_the_errors_of_one_that_is_known(tmp_path: Path) -> None:
    learned = true_errors(tmp_path / "learned", "control.estimate_slip=true")
    known = true_errors(tmp_path / "known", "control.knows_loading=true")
    for errors in (learned, known):
        assert max(errors) < 0.01  # not of one of seven followers, and
        assert max(errors[1:]) <= errors[0] + 0.005  # hardly more far back than at the front
    unknown = true_errors(tmp_path / "unknown", "convoy.vehicles=4")
    assert unknown[-1] > unknown[0] + 0.01 > 0.025
