"""What an unknown load costs the paper's base case, and what learning it saves."""

from scenarios.definition.scenario import load_scenario
from scenarios.runs.virtual import run_unlogged

FIRST_LANE_CHANGE = ["convoy.vehicles=5", "duration_s=11", "control.controller=slip_compensated"]


def true_errors(*changes: str) -> list[float]:
    """Largest true error of each follower (m)."""
    scenario = load_scenario("paper_base", [*FIRST_LANE_CHANGE, *changes])
    summary = run_unlogged(scenario)
    return [row.cross_track_error_m_max or 0.0 for row in summary.vehicles[1:]]


def test_an_estimated_load_leaves_the_errors_of_a_known_one() -> None:
    learned = true_errors("control.estimate_slip=true")
    known = true_errors("control.knows_loading=true")
    for errors in (learned, known):
        assert max(errors) < 0.01  # not of one of four followers, and
        assert max(errors[1:]) <= errors[0] + 0.005  # hardly more far back than at the front
    unknown = true_errors("convoy.vehicles=4")
    assert unknown[-1] > unknown[0] + 0.01 > 0.025
