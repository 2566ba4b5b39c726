"""Ranges equal a plain set of all numbers, in less memory."""

import tracemalloc

from hypothesis import given
from hypothesis import strategies as st

from transport.codec import MessageNumbers


@given(numbers=st.lists(st.integers(0, 30)))
def test_ranges_are_the_numbers_that_are_there(numbers: list[int]) -> None:
    known = MessageNumbers()
    for number in numbers:
        known.add(number)
    ranges = list(known.ranges())
    assert [n for first, last in ranges for n in range(first, last + 1)] == sorted({*numbers})
    assert all(first - 1 not in numbers and last + 1 not in numbers for first, last in ranges)
    assert known.newest == max(numbers, default=-1)


@given(numbers=st.lists(st.integers(0, 60), unique=True))
def test_of_scattered_numbers_only_some_ranges_are_kept(numbers: list[int]) -> None:
    known, least = MessageNumbers(), MessageNumbers(most_ranges=5)
    for number in numbers:
        for one in (known, least):
            assert number not in one
            one.add(number)
    assert [n for n in range(61) if n in known] == sorted(numbers)
    assert {n for n in range(61) if n in least} <= set(numbers)
    assert len(list(least.ranges())) <= 5


def test_memory_is_bounded_by_the_window() -> None:
    known = MessageNumbers(window=1000)
    for number in range(0, 2000, 2):
        known.add(number)
    tracemalloc.start()
    for number in range(2000, 100_000, 2):
        known.add(number)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 40_000  # two integers of 32 bytes per range, 500 ranges
    assert 99_998 in known
    assert 0 not in known
