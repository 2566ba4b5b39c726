"""What `convoy check` warns of."""

from scenarios.definition.check.findings import check, report_of
from scenarios.definition.scenario import scenario_from_text
from tests.made.scenarios.messages import STRAIGHT


def test_check_warns_of_what_may_surprise() -> None:
    assert check("lane_change").warnings == ()
    fast = check("lane_change", ["gnss.rate_hz=50"]).warnings
    assert len(fast) == 4
    assert "v1 measures at 50 Hz" in fast[0]
    tight = STRAIGHT.replace(
        "{ length_m = 1000.0 }", "{ length_m = 5.0, radius_m = 4.0, turn = 'right' }"
    ).replace("duration_s = 20.0\n", "")
    assert any(
        "radius of 4.0 m" in warning for warning in report_of(scenario_from_text(tight)).warnings
    )


def test_check_warns_of_a_lead_that_accelerates_more_than_its_followers() -> None:
    """Over a change of speed Δv, gaps grow by Δv²/2 · (1/own limit - 1/acceleration)."""
    rise = ["speed.lead=profile", "speed.acceleration_mps2_max=4", "speed.followers=gap"]
    points = "[{at_s=2,speed_mps=10},{at_s=4.5,speed_mps=20}]"
    settings = [*rise, f"speed.profile={points}", "duration_s=15"]
    (line,) = check("lane_change", settings).warnings
    for fact in ("4.0 m/s²", "2 m/s²", "12.5 m"):
        assert fact in line
    assert check("lane_change", [*settings, "speed.gap.acceleration_mps2_max=4"]).warnings == ()


def test_check_warns_of_curves_that_no_tyre_holds() -> None:
    slippery = ["parameters.friction_ratio=0.15"]  # the lane change asks for 1.8 m/s²
    (line,) = check("lane_change", slippery).warnings
    for fact in ("1.8 m/s²", "1.5 m/s²", "parameters.friction_ratio = 0.15", "speed.set_mps"):
        assert fact in line
    assert check("lane_change", [*slippery, "parameters.tyres=linear"]).warnings == ()
    assert check("lane_change", ["parameters.friction_ratio=0.3"]).warnings == ()
