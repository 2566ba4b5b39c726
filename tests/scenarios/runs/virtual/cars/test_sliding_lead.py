"""Three cars behind a lead that slides in a bend that is too tight for its speed."""

import pytest

from scenarios.definition.scenario import scenario_from_text
from scenarios.results.summary import RunSummary
from scenarios.runs.virtual import run_unlogged
from tests.made.convoys.driven import collisions, errors, least_gap_m

SLIDE = """
name = "slide"
duration_s = 17.0
[convoy]
vehicles = 4
[parameters]
friction_ratio = 0.6
[path]
kind = "segments"
segments = [
    { length_m = 200.0 }, { length_m = 63.0, radius_m = 40.0, turn = "left" }, { length_m = 250.0 },
]
[speed]
set_mps = 22.0
lateral_acceleration_mps2_max = 20.0    # 12 m/s² in the bend, twice the friction
"""


def slid(*overrides: str) -> RunSummary:
    return run_unlogged(scenario_from_text(SLIDE, overrides=overrides))


@pytest.mark.parametrize("followers", ["gap", "same"])
def test_followers_take_the_bend_at_a_speed_that_the_friction_allows(followers: str) -> None:
    summary = slid(f"speed.followers={followers}")
    assert (summary.vehicles[0].road_error_m_max or 0.0) > 5.0  # it slid off the road
    assert max(errors(summary)) < 0.3  # its followers know where it drove
    assert least_gap_m(summary) > 5.0
    assert collisions(summary) == 0


def test_without_a_limit_they_slide_too() -> None:
    """Followers that degrade brake with the lead as well."""
    blind = 'control.degradation.reaction="extrapolate"'
    assert max(errors(slid("speed.friction_ratio_max=inf", blind))) > 5.0
