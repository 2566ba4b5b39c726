"""What a receiver remembers is what a plain list of all that came would tell, in less memory."""

import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from transport.codec import RefusedMessageError
from transport.links.laws.effect import NOWHERE, Whereabouts
from transport.links.remembered import PLACES, WINDOW, NumbersHeard, PlacesPassed

NUMBERS = st.one_of(
    st.integers(0, 40),
    st.integers(WINDOW - 5, WINDOW + 45),
    st.integers(3 * WINDOW, 3 * WINDOW + 9),
    st.just(2**63),
)


def verdict(numbers: NumbersHeard, seq: int) -> str:
    """Why a number is refused, nothing if it is not."""
    try:
        numbers.add(seq)
    except RefusedMessageError as refusal:
        return refusal.reason
    return ""


@given(st.lists(NUMBERS, max_size=60))
def test_a_number_is_new_once_unless_it_is_far_behind(came: list[int]) -> None:
    heard, all_so_far, newest = NumbersHeard(), set[int](), -1
    for seq in came:
        expected = "past" if seq <= newest - WINDOW else "duplicate" if seq in all_so_far else ""
        assert verdict(heard, seq) == expected
        if not expected:
            all_so_far.add(seq)
            newest = max(newest, seq)


def test_a_refusal_says_which_number_and_why() -> None:
    heard = NumbersHeard()
    heard.add(WINDOW)
    with pytest.raises(RefusedMessageError, match=f"^past: number 0 is far behind {WINDOW}$"):
        heard.add(0)
    with pytest.raises(RefusedMessageError, match=f"^duplicate: number {WINDOW} came before$"):
        heard.add(WINDOW)


@given(
    st.lists(st.tuples(st.integers(0, 3), st.floats(-1e6, 1e6)), min_size=1, max_size=40),
    st.integers(-5, 130),
)
def test_a_place_is_that_of_the_last_tick_until_an_instant(
    ticks: list[tuple[int, float]], asked: int
) -> None:
    passed, known, now = PlacesPassed(), list[tuple[int, Whereabouts]](), 0
    for span, where in ticks:
        now += span
        known.append((now, Whereabouts(where, -where, 2.0 * where)))
        passed.add(*known[-1])
    before = [place for at, place in known if at <= asked]
    assert passed.at(asked) == (before[-1] if before else known[0][1])


def test_the_places_of_a_minute_are_remembered_and_few_more() -> None:
    passed = PlacesPassed()
    for now in range(5 * PLACES):
        passed.add(now, Whereabouts(float(now), 0.0, 0.0))
        first = passed.at(-1).east
        assert now - 1.2 * PLACES < first <= max(now - PLACES + 1, 0)
        assert passed.at(now).east == now


def test_a_place_that_nobody_tells_stays_untold() -> None:
    passed = PlacesPassed()
    passed.add(7, NOWHERE)
    assert all(value != value for value in passed.at(9))  # noqa: PLR0124 - not a number


def test_neither_takes_more_memory_however_long_a_run_is() -> None:
    heard, passed = NumbersHeard(), PlacesPassed()
    for k in range(2 * PLACES):
        heard.add(k)
        passed.add(k, NOWHERE)
    tracemalloc.start()
    for k in range(2 * PLACES, 5 * PLACES):
        heard.add(k)
        passed.add(k, NOWHERE)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 60 * PLACES  # 32 bytes for each, and for an eighth more
