"""Brackets of a known share: position, confidence, and number of runs."""

from collections.abc import Callable, Mapping, Sequence
from math import inf

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.studies.many.boundary.curve import NoBoundaryError, Sample, ShareCurve, bracket

VALUES = [number / 50 for number in range(51)]


def curve_of(broken: Callable[[float, int], bool], share: float = 0.5) -> ShareCurve:
    def attempt(samples: Sequence[Sample]) -> Mapping[Sample, bool]:
        assert len(set(samples)) == len(samples)
        return {(number, seed): broken(VALUES[number], seed) for number, seed in samples}

    return ShareCurve(VALUES, share, 20, attempt)


def thresholds(middle: float, spread: float, seed: int = 1) -> list[float]:
    draws = np.random.Generator(np.random.PCG64(seed)).normal(middle, spread, 20)
    return sorted(draws.tolist())


@settings(max_examples=30)
@given(st.floats(0.05, 0.95), st.floats(0.0, 0.1), st.integers(1, 5), st.booleans())
def test_the_median_threshold_of_all_seeds_is_bracketed(
    middle: float, spread: float, seed: int, falls: bool
) -> None:
    own = thresholds(middle, spread, seed)
    curve = curve_of(lambda value, number: (value >= own[number - 1]) != falls)
    found = bracket(curve)
    low, high = VALUES[found.low], VALUES[found.high]
    assert found.high - found.low == 1
    # Ten of twenty break the limit from the tenth threshold on, or hold it up to the eleventh.
    assert low < own[10] if falls else low < own[9] <= high
    assert curve.is_complete(found.low)
    assert curve.is_complete(found.high)
    assert curve.runs <= 220
    assert not curve.non_monotone_seeds()


@settings(max_examples=30)
@given(st.integers(0, 49), st.integers(1, 20))
def test_a_share_of_0_brackets_the_first_broken_seed(first: int, early: int) -> None:
    """One seed breaks the limit long before all others."""
    curve = curve_of(
        lambda value, seed: value > (VALUES[first] if seed == early else max(VALUES[first], 0.97)),
        share=0.0,
    )
    found = bracket(curve)
    assert (found.low, found.high) == (first, first + 1)
    assert found.confident == (-inf, inf)


def test_the_confident_values_contain_the_boundary_often_enough() -> None:
    """Outcomes are independent and not monotone."""
    contained, count = 0, 200
    for trial in range(count):
        draws = np.random.Generator(np.random.PCG64(trial)).random((51, 20))

        def broken(value: float, seed: int, draws: np.ndarray = draws) -> bool:
            number = VALUES.index(value)
            return bool(draws[number, seed - 1] < value)

        found = bracket(curve_of(broken))
        contained += found.confident[0] < 0.5 < found.confident[1]
    assert contained >= 0.95 * count


def test_a_peak_inside_the_range_is_found() -> None:
    found = bracket(curve_of(lambda value, _: 0.8 < value < 0.95))
    assert (VALUES[found.low], VALUES[found.high]) == (0.8, 0.82)


def test_seeds_that_are_not_monotone_are_listed() -> None:
    curve = curve_of(lambda value, seed: value > 0.9 or (seed == 3 and 0.4 < value < 0.6))
    found = bracket(curve)
    assert (VALUES[found.low], VALUES[found.high]) == (0.9, 0.92)
    assert curve.non_monotone_seeds() == [3]


@pytest.mark.parametrize("broken", [True, False])
def test_without_a_crossing_there_is_no_boundary(broken: bool) -> None:
    with pytest.raises(NoBoundaryError):
        bracket(curve_of(lambda *_: broken))
