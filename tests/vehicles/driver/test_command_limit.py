from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicles.driver.command_limit import CommandLimit
from vehicles.driver.steering import SteeringCommand

RATE, PERIOD, LARGEST = 0.59, 0.02, 0.54
ANGLES = st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=50)


def limited(limit: CommandLimit, angles: list[float]) -> list[float]:
    return [limit.limited(SteeringCommand(angle, angle, 0.0)).steering for angle in angles]


@given(angles=ANGLES)
def test_no_step_is_larger_than_the_rate_allows(angles: list[float]) -> None:
    given_ = [0.0, *limited(CommandLimit(RATE, PERIOD, LARGEST), angles)]
    assert all(abs(after - before) <= RATE * PERIOD + 1e-15 for before, after in pairwise(given_))
    assert max(map(abs, given_)) <= LARGEST


def test_it_reaches_the_command_and_returns_without_windup() -> None:
    angles = limited(CommandLimit(RATE, PERIOD, LARGEST), [5.0] * 60 + [0.0] * 60)
    assert max(angles) == LARGEST
    assert angles[60] == pytest.approx(LARGEST - RATE * PERIOD)
    assert angles[-1] == 0.0


def test_a_new_limit_starts_at_the_present_command() -> None:
    limit = CommandLimit(1.0, 0.02, 0.5, first=0.3)
    assert limit.limited(SteeringCommand(0.0, 0.0, 0.0)).steering == pytest.approx(0.28)
