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


def received(numbers: Iterable[int], latency: int = 0, least: float = 0.05) -> Reception:
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
    assert received(sorted(numbers), least=0.01).period == pytest.approx(0.05)


def test_the_period_follows_slow_senders_and_decimated_links() -> None:
    slow = Reception(0.05)
    for seq in range(5):
        slow.add(seq * SECOND, seq * SECOND, seq)
    assert slow.period == 1.0
    assert received(range(0, 100, 10), least=0.5).period == 0.5


@given(st.integers(0, 5 * SECOND))
def test_latency_is_not_silence(latency: int) -> None:
    reception = received(range(50), latency)
    now = 49 * PERIOD + latency
    assert reception.silence(now) == 0.0
    assert reception.share(now) == 1.0
    assert reception.silence(now + SECOND // 2) == 0.5


@given(st.sets(st.integers(180, 199)))
def test_the_share_is_that_of_the_last_second(lost: set[int]) -> None:
    reception = received(seq for seq in range(200) if seq not in lost)
    assert reception.share(199 * PERIOD) == pytest.approx(1.0 - len(lost) / 20)


def test_repeated_and_late_messages_are_not_the_newest() -> None:
    reception = received([0, 1, 2, 4])
    now = 4 * PERIOD
    assert not reception.add(now, 4 * PERIOD, 4)
    assert not reception.add(now, 3 * PERIOD, 3)
    assert reception.share(now) == 1.0  # all five arrived
    assert reception.silence(now + PERIOD) == 0.05
    assert reception.period == 0.05


def test_a_restarted_sender_keeps_its_period() -> None:
    reception = received(range(40))
    for seq in range(10):
        at = 5 * SECOND + seq * PERIOD
        assert reception.add(at, at, seq)
    assert reception.period == 0.05


def test_a_single_message_after_a_silence_does_not_stretch_the_period() -> None:
    """A transmitter that was off has not increased its sequence number."""
    reception = received(range(40))
    reception.reset()
    later = 30 * SECOND
    assert reception.add(later, later, 40)
    assert reception.period == 0.05
    assert not reception.add(later + PERIOD, 39 * PERIOD, 39)


def test_the_usual_share_is_the_mean_of_the_shares() -> None:
    reception = Reception(0.05)
    for seq in range(400):
        now = seq * PERIOD
        if seq % 2 == 0:
            reception.add(now, now, seq)
        reception.update_usual_share(now, reception.share(now))
    assert reception.usual_share == pytest.approx(0.5, abs=0.05)
    assert reception.delivers(400 * PERIOD, 0.9)


@given(st.lists(st.tuples(st.integers(0, 600), st.integers(-3, 6)), min_size=1, max_size=60))
def test_all_messages_of_the_last_second_are_counted(
    steps: list[tuple[int, int]],
) -> None:
    """Each step is the time (ms) and the change of sequence number from the previous message."""
    reception, now, seq, arrivals = Reception(0.05), 0, 100, dict[int, int]()
    for wait_ms, onward in steps:
        now, seq = now + wait_ms * MILLISECOND, seq + onward
        if seq not in arrivals:
            arrivals[seq] = now
            reception.add(now, seq * PERIOD, seq)
        count = sum(now - at < SECOND for at in arrivals.values())
        span = min(now - min(arrivals.values()), SECOND) / SECOND
        assert reception.share(now) == min(count / max(span / reception.period, 1.0), 1.0)


# ---- Probation


def relapsing(health: float, times: int) -> list[float]:
    """Lengths of probation of a source that is lost again every `health` seconds."""
    probation, now, lengths = Probation(SETTINGS), 0, []
    for _ in range(times):
        probation.fail(now)
        lengths.append(probation.length)
        now += round(probation.length * SECOND)
        probation.end(now)
        now += round(health * SECOND)
    return lengths


def test_probation_doubles_with_each_relapse_up_to_its_maximum() -> None:
    assert relapsing(0.5, 7) == [1.0, 2.0, 4.0, 8.0, 16.0, 16.0, 16.0]


def test_a_relapse_during_probation_doubles_it() -> None:
    probation = Probation(SETTINGS)
    for _ in range(3):
        probation.fail(SECOND)
    assert probation.length == 4.0


def test_probation_halves_after_each_period_without_relapse() -> None:
    probation = Probation(SETTINGS)
    for _ in range(4):
        probation.fail(0)
    assert probation.length == 8.0
    probation.end(SECOND)
    probation.fail(21 * SECOND)  # two halvings: 4 instead of 16
    assert probation.length == 4.0
    probation.end(22 * SECOND)
    probation.fail(3600 * SECOND)
    assert probation.length == 1.0


@given(st.lists(st.floats(0.0, 100.0), min_size=2, max_size=60))
def test_probation_stays_within_its_bounds_and_at_most_doubles(health: list[float]) -> None:
    probation, now, lengths = Probation(SETTINGS), 0, []
    for seconds in health:
        probation.fail(now)
        lengths.append(probation.length)
        probation.end(now)
        now += round(seconds * SECOND)
    assert all(1.0 <= length <= 16.0 for length in lengths)
    assert all(after <= 2.0 * before for before, after in pairwise(lengths))
