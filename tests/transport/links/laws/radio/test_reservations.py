"""Reservations: stationary, computable from any message."""

from itertools import pairwise
from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.examples import examples
from transport.links.laws.shared_channel import Reservations
from transport.links.link import keyed_draw

LENGTHS = st.tuples(st.integers(1, 12), st.integers(0, 12)).map(lambda two: (two[0], sum(two)))


@examples(8, 40)
@given(
    LENGTHS, st.sampled_from([0.0, 0.4, 0.8]), st.integers(0, 2**40),
    st.lists(st.integers(0, 3_000), min_size=1, max_size=15),
)  # fmt: skip
def test_a_reservation_alone_is_that_of_the_stream(
    lengths: tuple[int, int], kept: float, seed: int, requested: list[int]
) -> None:
    draw = keyed_draw(seed, "v1", "v2")
    streamed, jumping = Reservations(*lengths, kept), Reservations(*lengths, kept)
    stream = [streamed.selected_at(draw, seq) for seq in range(max(requested) + 1)]
    for seq in requested:
        assert stream[seq] == jumping.selected_at(draw, seq)
        assert stream[seq] == Reservations(*lengths, kept).selected_at(draw, seq)
        assert stream[seq] <= seq


@pytest.mark.campaign(1, 10)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_reservations_last_as_long_as_the_law_requires(seed: int, campaign: int) -> None:
    """With lengths L and none kept, a resource lasts m messages with E[(L − m)⁺] / E[L]."""
    draw, held = keyed_draw(seed, "v1", "v2"), Reservations(5, 15)
    count = 10_000 * campaign
    stream = [held.selected_at(draw, seq) for seq in range(count)]
    starts = sorted(set(stream))[1:-1]
    lengths = [after - before for before, after in pairwise(starts)]
    each = [lengths.count(length) for length in range(5, 16)]
    assert sum(each) == len(lengths)
    expected = len(lengths) / 11
    assert sum((one - expected) ** 2 / expected for one in each) < 29.6  # 0.1 %, 10 degrees
    for lag in (1, 4, 8, 12):
        same = sum(a == b for a, b in zip(stream, stream[lag:], strict=False)) / (count - lag)
        law = sum(max(length - lag, 0) for length in range(5, 16)) / 110.0
        assert abs(same - law) < 4.0 * sqrt(law * (1.0 - law) * 10.0 / count)


@pytest.mark.parametrize(("least", "most"), [(5, 15), (1, 3), (10, 10)])
def test_the_first_message_finds_a_reservation_as_old_as_any_other_does(
    least: int, most: int
) -> None:
    """In a stationary renewal process the age a has probability P(length > a) / mean."""
    held, n = Reservations(least, most), 800
    ages = np.zeros(most)
    for seed in range(n):
        ages[-held.selected_at(keyed_draw(seed, "a", "b"), 0)] += 1
    lengths = np.arange(least, most + 1)
    probabilities = np.array([np.mean(lengths > age) for age in range(most)]) / lengths.mean()
    assert probabilities.sum() == pytest.approx(1.0)
    assert np.all(np.abs(ages - n * probabilities) < 4.0 * np.sqrt(n * probabilities))


@pytest.mark.parametrize(("least", "most", "kept"), [(0, 3, 0.0), (4, 3, 0.0), (1, 3, 1.0)])
def test_impossible_ones_are_refused(least: int, most: int, kept: float) -> None:
    with pytest.raises(ValueError, match=r"reservations for|kept with"):
        Reservations(least, most, kept)
