import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicles.driver.command_limit import CommandLimit
from vehicles.driver.steering import SteeringCommand

RATE, PERIOD, LARGEST = 0.59, 0.02, 0.54
ANGLES = st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=50)


def given_to(limit: CommandLimit, asked: list[float]) -> list[float]:
    return [limit.limited(SteeringCommand(angle, angle, 0.0)).steering for angle in asked]


@given(asked=ANGLES)
def test_no_step_is_larger_than_the_rate_allows(asked: list[float]) -> None:
    given_ = [0.0, *given_to(CommandLimit(RATE, PERIOD, LARGEST), asked)]
    assert all(abs(after - before) <= RATE * PERIOD + 1e-15 for before, after in pairwise(given_))
    assert max(map(abs, given_)) <= LARGEST


@given(asked=ANGLES)
def test_without_a_limit_of_the_rate_nothing_is_changed(asked: list[float]) -> None:
    commands = [SteeringCommand(angle, angle, 0.0) for angle in asked]
    limit = CommandLimit(math.inf, PERIOD, LARGEST)
    assert all(limit.limited(command) is command for command in commands)


def test_a_command_within_reach_is_the_controller_s_own() -> None:
    limit, command = CommandLimit(RATE, PERIOD, LARGEST), SteeringCommand(0.01, 0.007, 0.003)
    assert limit.limited(command) is command


def test_it_reaches_what_is_asked_and_comes_back_at_once() -> None:
    """What lies beyond the rack's end does not wind up."""
    angles = given_to(CommandLimit(RATE, PERIOD, LARGEST), [5.0] * 60 + [0.0] * 60)
    assert max(angles) == LARGEST
    assert angles[60] == pytest.approx(LARGEST - RATE * PERIOD)
    assert angles[-1] == 0.0


def test_the_controller_s_parts_are_kept() -> None:
    command = CommandLimit(RATE, PERIOD, LARGEST).limited(SteeringCommand(0.3, 0.2, 0.1))
    assert (command.feedforward, command.feedback) == (0.2, 0.1)
    assert command.steering == pytest.approx(RATE * PERIOD)


def test_whoever_takes_over_goes_on_from_the_command_that_the_car_has() -> None:
    limit = CommandLimit(1.0, 0.02, 0.5, first=0.3)
    assert limit.limited(SteeringCommand(0.0, 0.0, 0.0)).steering == pytest.approx(0.28)
