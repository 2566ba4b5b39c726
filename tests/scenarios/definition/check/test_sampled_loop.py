"""Warnings of a steering loop that is too slow for its speed."""

import pytest

from scenarios.definition.check.findings import check
from scenarios.definition.scenario import library

SWERVE = "speed.lateral_acceleration_mps2_max=15"
"""So that the lead need not slow down."""


def warning_lines(*overrides: str) -> list[str]:
    return [line for line in check("lane_change", overrides).warnings if "unstable" in line]


def test_stable_loops_get_no_warning() -> None:
    assert warning_lines() == []
    assert warning_lines("control.own_state=exact") == []
    assert warning_lines("gnss.rate_hz=1") == []  # the inertial sensor suffices
    for name in library():
        assert not any("unstable" in line for line in check(name).warnings)


def test_a_sensor_too_slow_for_the_speed_is_named_with_the_rate_that_does() -> None:
    (line,) = warning_lines("imu.rate_hz=8", "gnss.rate_hz=8")
    assert "v1, v2, v3, v4: " in line
    assert "own motion known at 8 Hz" in line
    assert "30.0 m/s" in line
    assert "Raise imu.rate_hz to " in line
    (line,) = warning_lines("vehicle.v3.imu.rate_hz=8")
    assert line.startswith("v3: ")


@pytest.mark.parametrize("own_state", ["exact", "estimated"])
def test_control_too_slow_for_the_speed_is_named(own_state: str) -> None:
    (line,) = warning_lines(
        "control.rate_hz=5",
        "speed.set_mps=60",
        "duration_s=10",
        SWERVE,
        f"control.own_state={own_state}",
    )
    assert "Raise control.rate_hz" in line
