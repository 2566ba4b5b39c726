import math
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


@given(angles=ANGLES)
def test_without_a_rate_limit_nothing_changes(angles: list[float]) -> None:
    commands = [SteeringCommand(angle, angle, 0.0) for angle in angles]
    limit = CommandLimit(math.inf, PERIOD, LARGEST)
    assert all(limit.limited(command) is command for command in commands)


def test_a_command_within_the_limits_passes_unchanged() -> None:
    limit, command = CommandLimit(RATE, PERIOD, LARGEST), SteeringCommand(0.01, 0.007, 0.003)
    assert limit.limited(command) is command


def test_it_reaches_the_command_and_returns_without_windup() -> None:
    angles = limited(CommandLimit(RATE, PERIOD, LARGEST), [5.0] * 60 + [0.0] * 60)
    assert max(angles) == LARGEST
    assert angles[60] == pytest.approx(LARGEST - RATE * PERIOD)
    assert angles[-1] == 0.0


def test_feedforward_and_feedback_are_unchanged() -> None:
    command = CommandLimit(RATE, PERIOD, LARGEST).limited(SteeringCommand(0.3, 0.2, 0.1))
    assert (command.feedforward, command.feedback) == (0.2, 0.1)
    assert command.steering == pytest.approx(RATE * PERIOD)


def test_a_new_limit_starts_at_the_present_command() -> None:
    limit = CommandLimit(1.0, 0.02, 0.5, first=0.3)
    assert limit.limited(SteeringCommand(0.0, 0.0, 0.0)).steering == pytest.approx(0.28)
