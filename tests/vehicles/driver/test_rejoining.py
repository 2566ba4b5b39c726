import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.vehicles.exact_drives import START
from vehicles.driver.tracking import REJOINING_LATERAL, Rejoining, TrackingErrors
from vehicles.schedule import SECOND

TICK = SECOND // 50


def path_back(lateral: float, heading: float, speed: float) -> list[tuple[float, float]]:
    """Lateral (m) and heading (rad) error of a car that follows its return exactly, per tick."""
    rejoining, now = Rejoining(), START
    rejoining.corrected(now, TrackingErrors(0.0, 0.0, 0.0, 0.0), speed)
    rejoining.begin()
    beginning = TrackingErrors(lateral, heading, 0.0, 0.0)
    states = []
    for _ in range(5000):
        now += TICK
        left = rejoining.corrected(now, beginning, speed)
        states.append((lateral - left.lateral, heading - left.heading))
        if left is beginning:
            return states
    raise AssertionError("the return does not end")


def test_without_a_return_errors_are_unchanged() -> None:
    rejoining, errors = Rejoining(), TrackingErrors(1.0, 0.1, 0.0, 0.0)
    assert rejoining.corrected(START, errors, 10.0) is errors


@given(st.floats(-5.0, 5.0), st.floats(-0.3, 0.3), st.floats(8.0, 30.0))
def test_the_return_leads_from_the_car_to_the_path_with_mild_curvature(
    lateral: float, heading: float, speed: float
) -> None:
    states = path_back(lateral, heading, speed)
    assert states[0] == pytest.approx((lateral, heading))
    assert states[-2][0] == pytest.approx(0.0, abs=0.05)
    step = speed * TICK / SECOND
    for k in range(1, len(states) - 2):
        # The heading is the slope, its change the curvature.
        slope = (states[k + 1][0] - states[k - 1][0]) / (2 * step)
        assert slope == pytest.approx(states[k][1], abs=0.01)
        curvature = (states[k + 1][1] - states[k - 1][1]) / (2 * step)
        assert abs(curvature) * speed**2 <= 1.1 * REJOINING_LATERAL + 0.1
    assert math.isfinite(sum(map(sum, states)))
