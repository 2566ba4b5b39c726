import math
from collections.abc import Iterable
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicles.driver.degradation.reception import Probation, Reception
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.schedule import MILLISECOND, SECOND

PERIOD = 50 * MILLISECOND
SETTINGS = DegradationSettings()


def heard(numbers: Iterable[int], latency: int = 0, least: float = 0.05) -> Reception:
    reception = Reception(least)
    for seq in numbers:
        reception.add(seq * PERIOD + latency, seq * PERIOD, seq)
    return reception


def test_nothing_is_known_before_the_first_message() -> None:
    reception = Reception(0.05)
    assert math.isnan(reception.silence(SECOND))
    assert math.isnan(reception.share(SECOND))
    assert reception.period == 0.05


@given(st.sets(st.integers(0, 200), min_size=2))
def test_losses_do_not_stretch_the_period(numbers: set[int]) -> None:
    assert heard(sorted(numbers), least=0.01).period == pytest.approx(0.05)


def test_a_slower_sender_has_a_longer_period_and_a_link_of_a_lower_rate_has_its_own() -> None:
    slow = Reception(0.05)
    for seq in range(5):
        slow.add(seq * SECOND, seq * SECOND, seq)
    assert slow.period == 1.0
    assert heard(range(0, 100, 10), least=0.5).period == 0.5


@given(st.integers(0, 5 * SECOND))
def test_a_latency_is_no_silence(latency: int) -> None:
    reception = heard(range(50), latency)
    now = 49 * PERIOD + latency
    assert reception.silence(now) == 0.0
    assert reception.share(now) == 1.0
    assert reception.silence(now + SECOND // 2) == 0.5


@given(st.sets(st.integers(180, 199)))
def test_the_share_is_that_of_the_last_second(lost: set[int]) -> None:
    reception = heard(seq for seq in range(200) if seq not in lost)
    assert reception.share(199 * PERIOD) == pytest.approx(1.0 - len(lost) / 20)


def test_what_comes_twice_or_late_is_no_news() -> None:
    reception = heard([0, 1, 2, 4])
    now = 4 * PERIOD
    assert not reception.add(now, 4 * PERIOD, 4)
    assert not reception.add(now, 3 * PERIOD, 3)
    assert reception.share(now) == 1.0  # all five came
    assert reception.silence(now + PERIOD) == 0.05
    assert reception.period == 0.05


def test_a_sender_that_begins_anew_keeps_its_period() -> None:
    reception = heard(range(40))
    for seq in range(10):
        at = 5 * SECOND + seq * PERIOD
        assert reception.add(at, at, seq)
    assert reception.period == 0.05


def test_a_single_message_after_a_silence_does_not_stretch_the_period() -> None:
    """A transmitter that was off has counted nothing meanwhile."""
    reception = heard(range(40))
    reception.reset()
    later = 30 * SECOND
    assert reception.add(later, later, 40)
    assert reception.period == 0.05
    assert not reception.add(later + PERIOD, 39 * PERIOD, 39)


def test_the_usual_share_is_the_mean_over_what_was_counted() -> None:
    reception = Reception(0.05)
    for seq in range(400):
        now = seq * PERIOD
        if seq % 2 == 0:
            reception.add(now, now, seq)
        reception.update_usual_share(now, reception.share(now))
    assert reception.usual_share == pytest.approx(0.5, abs=0.05)
    assert reception.delivers(400 * PERIOD, 0.9)


@given(st.lists(st.tuples(st.integers(0, 600), st.integers(-3, 6)), min_size=1, max_size=60))
def test_what_came_in_the_last_second_late_ones_too_is_counted_one_by_one(
    steps: list[tuple[int, int]],
) -> None:
    """Each comes so long (ms) after the one before, with a number so much higher or lower."""
    reception, now, seq, heard = Reception(0.05), 0, 100, dict[int, int]()
    for wait_ms, onward in steps:
        now, seq = now + wait_ms * MILLISECOND, seq + onward
        if seq not in heard:
            heard[seq] = now
            reception.add(now, seq * PERIOD, seq)
        came = sum(now - at < SECOND for at in heard.values())
        span = min(now - min(heard.values()), SECOND) / SECOND
        assert reception.share(now) == min(came / max(span / reception.period, 1.0), 1.0)


# ---- Probation


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
