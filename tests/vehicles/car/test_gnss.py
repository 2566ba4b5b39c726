import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.vehicles.receivers import SILENT, USUAL, receiver
from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix, to_message
from vehicles.geometry.geodesy import LocalPlane, Origin
from vehicles.messages import GpsPose
from vehicles.received_pose import receive

START = 1_700_000_000_123_456_789
BODY = Body(120.0, -45.0, 2.5, 20.0, 0.1, 0.05, 0.01, 0.0, 300.0)
PLANE = LocalPlane(Origin(latitude_deg=30.6, longitude_deg=-96.3, altitude_m=90.0))


@pytest.mark.parametrize("rate_hz", [20.0, 10.0, 30.0, 7.0, 12.5, 1.0])
def test_measures_at_the_rounded_instants_and_only_there(rate_hz: float) -> None:
    gnss = receiver(replace(SILENT, rate=rate_hz), START)
    for k in (0, 1, 2, 3, 100, 71_999):
        instant = START + round(k * 1e9 / rate_hz)
        fix = gnss.measure(BODY, instant)
        assert fix is not None
        assert (fix.seq, fix.measured_at) == (k, instant)
        assert gnss.measure(BODY, instant + 1) is None
        assert gnss.measure(BODY, instant - 1) is None
    assert gnss.measure(BODY, START - round(1e9 / rate_hz)) is None


def test_noise_is_white_and_of_the_stated_size() -> None:
    gnss = receiver(USUAL, START)
    count = 4000
    errors = np.empty((count, 5))
    for k in range(count):
        fix = gnss.measure(BODY, START + k * 50_000_000)
        assert fix is not None
        errors[k] = (
            (fix.east - BODY.east) / USUAL.position_noise,
            (fix.north - BODY.north) / USUAL.position_noise,
            (fix.yaw - BODY.yaw) / USUAL.heading_noise,
            (fix.speed - BODY.speed) / USUAL.speed_noise,
            (fix.yaw_rate - BODY.yaw_rate) / USUAL.yaw_rate_noise,
        )
    # Five standard errors either way.
    assert np.max(np.abs(errors.mean(axis=0))) < 5.0 / math.sqrt(count)
    covariance = errors.T @ errors / count
    assert np.max(np.abs(covariance - np.eye(5))) < 5.0 * math.sqrt(2.0 / count)
    following = np.mean(errors[1:] * errors[:-1], axis=0)
    assert np.max(np.abs(following)) < 5.0 / math.sqrt(count)


def as_message(fix: Fix) -> GpsPose:
    place = fix.east, fix.north, 0.0
    return to_message(fix, "v1", PLANE, seq=fix.seq, sent_at=fix.measured_at, true_position=place)


@given(
    east=st.floats(-5000, 5000),
    north=st.floats(-5000, 5000),
    yaw=st.floats(-math.pi, math.pi),
    speed=st.floats(0, 60),
    yaw_rate=st.floats(-2, 2),
)
def test_a_round_trip_over_the_wire_preserves_a_fix(
    east: float, north: float, yaw: float, speed: float, yaw_rate: float
) -> None:
    fix = Fix(7, START, east, north, yaw, speed, yaw_rate)
    message = as_message(fix)
    assert message.vehicle == "v1"
    assert 0.0 <= message.heading_deg < 360.0
    back = receive(message, PLANE, START + 1)
    assert math.hypot(back.east - east, back.north - north) < 1e-6
    assert abs(math.remainder(back.yaw - yaw, math.tau)) < 1e-9
    assert (back.speed, back.yaw_rate, back.accuracy) == (speed, yaw_rate, fix.accuracy)
    assert (back.message, back.measured_at, back.received_at) == (message, START, START + 1)


def test_wire_carries_a_compass_course() -> None:
    north_bound = as_message(Fix(0, START, 0.0, 0.0, math.pi / 2, 1.0, 0.0))
    assert north_bound.heading_deg == pytest.approx(0.0, abs=1e-9)
    west_bound = as_message(Fix(0, START, 0.0, 0.0, math.pi, 1.0, 0.0))
    assert west_bound.heading_deg == pytest.approx(270.0)
