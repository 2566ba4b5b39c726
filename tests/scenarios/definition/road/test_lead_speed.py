"""The speed of a scenario: set, by profile, by gap."""

import math

import pytest

from scenarios.definition.check.findings import report_of
from scenarios.definition.scenario import scenario_from_text
from tests.made.scenarios.messages import STRAIGHT


def test_a_set_speed_is_lowered_for_a_curve_and_taken_up_again() -> None:
    text = STRAIGHT.replace(
        "{ length_m = 1000.0 }",
        "{ length_m = 200.0 }, { length_m = 60.0, radius_m = 50.0, turn = 'left' }, "
        "{ length_m = 400.0 }",
    ).replace("duration_s = 20.0\n", "")
    report = report_of(scenario_from_text(text))
    assert report.lateral_acceleration_mps2_max == pytest.approx(3.0, rel=2e-3)
    assert report.speed_mps_min == pytest.approx((3.0 * 50.0) ** 0.5, rel=1e-3)
    assert report.braking_mps2_max == pytest.approx(2.5, rel=0.02)
    assert report.acceleration_mps2_max == pytest.approx(1.5, rel=0.02)
    assert report.speed_mps_max == 20.0
    assert any("lowered to 12.2 m/s" in warning for warning in report.warnings)


def test_a_profile_is_driven_exactly_without_curves() -> None:
    text = STRAIGHT + (
        "[speed]\nlead = 'profile'\n"
        "profile = [{at_s = 2.0, speed_mps = 10.0}, {at_s = 12.0, speed_mps = 30.0}]\n"
    )
    route = scenario_from_text(text).route
    assert [route.profile.at(t)[0] for t in (0.0, 2.0, 7.0, 12.0, 99.0)] == [10, 10, 20, 30, 30]
    # 20 m, then 10 s at a mean of 20 m/s, then 8 s at 30 m/s
    assert route.profile.distance(20.0) == pytest.approx(20.0 + 200.0 + 240.0)
    assert route.profile.time_to(220.0) == pytest.approx(12.0)
    assert route.profile.time_to(100.0) == pytest.approx(2.0 + _time_for(80.0))


def _time_for(way: float) -> float:
    """Time to cover `way` from 10 m/s at 2 m/s²."""
    return (math.sqrt(100.0 + 4.0 * way) - 10.0) / 2.0


def test_gap_keeping_vehicles_start_at_the_gap_that_they_keep() -> None:
    scenario = scenario_from_text(
        STRAIGHT,
        overrides=[
            "speed.followers='gap'",
            "speed.gap.standstill_m=1",
            "speed.gap.headway_s=0.8",
            "speed.set_mps=10",
        ],
    )
    assert scenario.route.gaps == (0.0, 9.0, 9.0, 9.0)
    assert scenario.spacing_policy(1).desired(10.0) == pytest.approx(9.0 + 4.93)
    assert scenario.route.spacings[1:] == (scenario.spacing_policy(1).desired(10.0),) * 3
