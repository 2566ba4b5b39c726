"""Delta debugging of synthetic tests: the result fails like the whole and is minimal."""

from collections.abc import Callable, Sequence

from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.studies.many.blame import SmallestSet, ddmin

Fails = Callable[[frozenset[int]], bool]
SIZES = st.integers(1, 40)
few = settings(max_examples=40)


def first_that(fails: Fails) -> Callable[[Sequence[tuple[int, ...]]], int | None]:
    return lambda sets: next((k for k, items in enumerate(sets) if fails(frozenset(items))), None)


def shrink(size: int, fails: Fails) -> SmallestSet[int]:
    assert fails(frozenset(range(size)))
    assert not fails(frozenset())
    return ddmin(range(size), first_that(fails))


@few
@given(SIZES.flatmap(lambda n: st.tuples(st.just(n), st.sets(st.integers(0, n - 1), min_size=1))))
def test_exactly_the_necessary_items_remain(case: tuple[int, set[int]]) -> None:
    size, needed = case
    found = shrink(size, lambda items: needed <= items)
    assert found == SmallestSet(tuple(sorted(needed)), is_minimal=True)


@few
@given(st.data(), SIZES)
def test_one_of_several_sufficient_causes_remains(data: st.DataObject, size: int) -> None:
    a_cause = st.frozensets(st.integers(0, size - 1), min_size=1, max_size=6)
    causes = data.draw(st.sets(a_cause, min_size=1, max_size=4))
    found = shrink(size, lambda items: any(cause <= items for cause in causes))
    assert frozenset(found.items) in causes


@few
@given(SIZES, st.integers(0, 1000), st.integers(0, 30))
def test_an_exhausted_search_returns_a_failing_set(size: int, salt: int, most: int) -> None:
    needed = {salt % size, (salt * 7 + 3) % size}
    tried = 0

    def first(sets: Sequence[tuple[int, ...]]) -> int | None:
        nonlocal tried
        for index, items in enumerate(sets):
            if tried >= most:
                return None
            tried += 1
            if needed <= set(items):
                return index
        return None

    found = ddmin(range(size), first, lambda: tried >= most)
    assert needed <= set(found.items)
    if found.is_minimal:
        assert set(found.items) == needed


def test_consecutive_causes_take_few_tests() -> None:
    tried = 0

    def fails(items: frozenset[int]) -> bool:
        nonlocal tried
        tried += 1
        return set(range(411, 431)) <= items

    assert ddmin(range(1000), first_that(fails)).items == tuple(range(411, 431))
    assert tried < 120
