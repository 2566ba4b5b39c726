from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from vehicles.driver.degradation.probation import Probation
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.schedule import SECOND

SETTINGS = DegradationSettings()


def relapsing(health: float, times: int) -> list[float]:
    """Lengths of probation of a source that is lost again after `health` seconds, each time."""
    probation, now, lengths = Probation(SETTINGS), 0, []
    for _ in range(times):
        probation.fail(now)
        lengths.append(probation.length)
        now += round(probation.length * SECOND)
        probation.end(now)
        now += round(health * SECOND)
    return lengths


def test_it_doubles_with_each_relapse_up_to_its_longest() -> None:
    assert relapsing(0.5, 7) == [1.0, 2.0, 4.0, 8.0, 16.0, 16.0, 16.0]


def test_who_relapses_on_probation_has_not_been_relied_on_and_waits_longer() -> None:
    probation = Probation(SETTINGS)
    for _ in range(3):
        probation.fail(SECOND)
    assert probation.length == 4.0


def test_each_healthy_while_halves_it_again() -> None:
    probation = Probation(SETTINGS)
    for _ in range(4):
        probation.fail(0)
    assert probation.length == 8.0
    probation.end(SECOND)
    probation.fail(21 * SECOND)  # two whiles: not 16 but 4
    assert probation.length == 4.0
    probation.end(22 * SECOND)
    probation.fail(3600 * SECOND)
    assert probation.length == 1.0


@given(st.lists(st.floats(0.0, 100.0), min_size=2, max_size=60))
def test_it_stays_within_its_bounds_and_never_jumps_up(health: list[float]) -> None:
    probation, now, lengths = Probation(SETTINGS), 0, []
    for seconds in health:
        probation.fail(now)
        lengths.append(probation.length)
        probation.end(now)
        now += round(seconds * SECOND)
    assert all(1.0 <= length <= 16.0 for length in lengths)
    assert all(after <= 2.0 * before for before, after in pairwise(lengths))
