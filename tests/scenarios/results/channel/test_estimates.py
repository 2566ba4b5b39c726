"""Coverage of intervals, and their inflation against closed forms of chains."""

from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from scenarios.results.link_account import RESOLUTION_NS
from scenarios.results.links import (
    inflation,
    mean_length,
    quantile_of_normal,
    share,
    spread,
)

MESSAGES, RUNS = 700, 2000


def chains(loss: float, burst: float, seed: int) -> NDArray[np.bool_]:
    """RUNS stationary two-state chains of MESSAGES each, by the textbook's recursion."""
    random = np.random.default_rng(seed)
    back = 1.0 / burst
    into = back * loss / (1.0 - loss)
    state = random.random(RUNS) < loss
    found = np.empty((RUNS, MESSAGES), dtype=np.bool_)
    for column in range(MESSAGES):
        found[:, column] = state
        drawn = random.random(RUNS)
        state = np.where(state, drawn >= back, drawn < into)
    return found


@pytest.mark.parametrize(
    ("loss", "burst"), [(0.05, 1.0 / 0.95), (0.4, 1.0 / 0.6), (0.2, 4.0), (0.5, 10.0)]
)
def test_the_interval_of_a_loss_has_its_nominal_coverage(loss: float, burst: float) -> None:
    found = chains(loss, burst, 5)
    held = 0
    for row in found:
        interval = share(int(row.sum()), MESSAGES, 0.95, inflation(loss, burst))
        held += interval.low <= loss <= interval.high
    # Wilson's interval holds 0.95 but for the lumpiness of counts.
    assert 0.93 < held / RUNS < 0.975


def test_wilson_s_interval_by_its_own_equation() -> None:
    # Its ends solve (p - x)^2 = z^2 x (1 - x) / n.
    interval, z = share(7, 40, 0.95), quantile_of_normal(0.95)
    for end in (interval.low, interval.high):
        assert (7 / 40 - end) ** 2 == pytest.approx(z * z * end * (1.0 - end) / 40)
    assert quantile_of_normal(0.95) == pytest.approx(1.959964, abs=1e-6)


def test_the_interval_of_a_burst_length_holds_it() -> None:
    random = np.random.default_rng(3)
    held = 0
    for _ in range(RUNS):
        interval = mean_length(random.geometric(0.25, 60), 0.95)
        assert interval is not None
        held += interval.low <= 4.0 <= interval.high
    assert 0.92 < held / RUNS < 0.98


@given(st.lists(st.integers(0, 1000), min_size=1, max_size=200))
def test_a_spread_is_that_of_the_values(values: list[int]) -> None:
    found = spread(np.array(values) * RESOLUTION_NS)
    assert found is not None
    scaled = 0.01 * np.array(values)
    assert found.mean == pytest.approx(scaled.mean())
    assert found.deviation == pytest.approx(scaled.std(), abs=1e-9)
    assert found.largest == scaled.max()
    at_most = float(np.mean(scaled <= found.p95))
    below = float(np.mean(scaled < found.p95))
    assert below < 0.95 <= at_most + 1e-12 or sqrt(len(values)) < 1.0


def test_independent_losses_are_not_inflated() -> None:
    assert inflation(0.3, 1.0 / 0.7) == pytest.approx(1.0)
    assert inflation(0.0, 5.0) == inflation(1.0, 5.0) == inflation(0.3, 1.0) == 1.0


def test_without_counts_nothing_is_estimated() -> None:
    assert (share(0, 0, 0.95).low, share(0, 0, 0.95).high) == (0.0, 1.0)
    assert mean_length(np.array([], dtype=np.int_), 0.95) is None
    assert spread(np.zeros(0, np.int64)) is None
