import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.vehicles.exact_drives import START
from vehicles.driver.tracking import REJOINING_LATERAL, Rejoining, TrackingErrors
from vehicles.schedule import SECOND

TICK = SECOND // 50


def way(lateral: float, heading: float, speed: float) -> list[tuple[float, float]]:
    """Where (m) and how (rad) a car that keeps to its way back is to its path, tick by tick."""
    rejoining, now = Rejoining(), START
    rejoining.corrected(now, TrackingErrors(0.0, 0.0, 0.0, 0.0), speed)
    rejoining.begin()
    beginning = TrackingErrors(lateral, heading, 0.0, 0.0)
    found = []
    for _ in range(5000):
        now += TICK
        left = rejoining.corrected(now, beginning, speed)
        found.append((lateral - left.lateral, heading - left.heading))
        if left is beginning:
            return found
    raise AssertionError("no way back ends")


def test_without_being_asked_errors_stay_what_they_are() -> None:
    rejoining, errors = Rejoining(), TrackingErrors(1.0, 0.1, 0.0, 0.0)
    assert rejoining.corrected(START, errors, 10.0) is errors


@given(st.floats(-5.0, 5.0), st.floats(-0.3, 0.3), st.floats(8.0, 30.0))
def test_it_begins_at_the_car_ends_on_the_path_and_bends_mildly(
    lateral: float, heading: float, speed: float
) -> None:
    found = way(lateral, heading, speed)
    assert found[0] == pytest.approx((lateral, heading))
    assert found[-2][0] == pytest.approx(0.0, abs=0.05)
    step = speed * TICK / SECOND
    for k in range(1, len(found) - 2):
        # Its heading is its slope, and the change of that its curvature.
        slope = (found[k + 1][0] - found[k - 1][0]) / (2 * step)
        assert slope == pytest.approx(found[k][1], abs=0.01)
        curvature = (found[k + 1][1] - found[k - 1][1]) / (2 * step)
        assert abs(curvature) * speed**2 <= 1.1 * REJOINING_LATERAL + 0.1
    assert math.isfinite(sum(map(sum, found)))
