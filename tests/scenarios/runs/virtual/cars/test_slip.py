"""What an unknown load costs the paper's base case, and what learning it saves."""

from tests.made.convoys.driven import errors, summary_of

FIRST_LANE_CHANGE = ["convoy.vehicles=5", "duration_s=11", "control.controller=slip_compensated"]


def true_errors(*changes: str) -> list[float]:
    return errors(summary_of("paper_base", *FIRST_LANE_CHANGE, *changes))


def test_an_estimated_load_leaves_the_errors_of_a_known_one() -> None:
    learned = true_errors("control.estimate_slip=true")
    known = true_errors("control.knows_loading=true")
    for found in (learned, known):
        assert max(found) < 0.01  # not of one of four followers, and
        assert max(found[1:]) <= found[0] + 0.005  # hardly more far back than at the front
    unknown = true_errors("convoy.vehicles=4")
    assert unknown[-1] > unknown[0] + 0.01 > 0.025
