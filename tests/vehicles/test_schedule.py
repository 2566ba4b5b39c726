from fractions import Fraction
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from tests.made.examples import examples
from vehicles.schedule import MILLISECOND, SECOND, Cadence, Timer, instant

START = 1_790_000_000 * SECOND + 123_456_789
rates = st.sampled_from([1.0, 5.0, 10.0, 20.0, 30.0, 50.0, 99.9, 500.0]) | st.floats(0.1, 500.0)


@given(rate_hz=rates, k=st.integers(0, 10_000_000))
@examples(22, 200)
def test_instants_are_exact_within_half_a_nanosecond(rate_hz: float, k: int) -> None:
    exact = Fraction(k * SECOND) / Fraction(rate_hz)
    # Ten million periods at 0.1 Hz are three years, which a float represents within 16 ns.
    tolerance = Fraction(1, 2) + exact * Fraction(1, 2**52)
    assert abs(instant(START, k, rate_hz) - START - exact) <= tolerance


@given(rate_hz=rates, k=st.integers(0, 1_000_000))
@examples(22, 200)
def test_a_cadence_indexes_its_instants_and_no_others(rate_hz: float, k: int) -> None:
    cadence = Cadence(START, rate_hz)
    at = instant(START, k, rate_hz)
    assert cadence.index(at) == k
    assert cadence.due(at)
    for neighbour in (at - 1, at + 1):
        assert cadence.index(neighbour) is None
        assert not cadence.due(neighbour)


def test_50_hz_and_20_hz_coincide_every_tenth_of_a_second() -> None:
    control, gnss = Cadence(START, 50.0), Cadence(START, 20.0)
    both = [k for k in range(500) if gnss.due(instant(START, k, 50.0))]
    assert both == list(range(0, 500, 5))
    assert [control.index(instant(START, k, 20.0)) for k in range(5)] == [0, None, 5, None, 10]


def test_instants_do_not_drift_over_a_day() -> None:
    day = 24 * 3600
    for rate_hz in (50, 20, 30, 7):
        assert instant(START, day * rate_hz, rate_hz) == START + day * SECOND


@given(st.lists(st.integers(0, 10 * SECOND), min_size=1, max_size=50))
def test_a_timer_is_due_a_period_after_it_fired(polls: list[int]) -> None:
    timer = Timer(SECOND, due_at=SECOND)
    fired = [at for at in sorted(polls) if timer.is_due(at)]
    assert all(at >= SECOND for at in fired)
    assert all(later - earlier >= SECOND for earlier, later in pairwise(fired))
    missed = [at for at in sorted(polls) if at >= SECOND and at not in fired]
    assert all(any(at - SECOND < fired_at <= at for fired_at in fired) for at in missed)


def test_a_steady_timer_does_not_drift_with_its_polling() -> None:
    timer = Timer(SECOND, due_at=START, steady=True)
    polls = [START + k * 150 * MILLISECOND for k in range(40)]
    late = [(at - START) % SECOND for at in polls if timer.is_due(at)]
    assert len(late) == 6
    assert max(late) < 150 * MILLISECOND
