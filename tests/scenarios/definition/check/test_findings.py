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


def test_check_warns_of_curves_that_no_tyre_holds() -> None:
    slippery = ["parameters.friction_ratio=0.15"]  # the lane change asks for 1.8 m/s²
    (line,) = check("lane_change", slippery).warnings
    for fact in ("1.8 m/s²", "1.5 m/s²", "parameters.friction_ratio = 0.15", "speed.set_mps"):
        assert fact in line
    assert check("lane_change", [*slippery, "parameters.tyres=linear"]).warnings == ()
    assert check("lane_change", ["parameters.friction_ratio=0.3"]).warnings == ()
