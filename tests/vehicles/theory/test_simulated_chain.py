from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.random_cars import CAR
from vehicles.car.parameters import NOMINAL_GAINS, Gains, all_loadings, loaded
from vehicles.theory.simulated_chain import (
    amplifications,
    head_to_tail,
    is_string_stable,
    l2_norm,
    simulated_propagation,
    tracking_norm,
)
from vehicles.theory.string_stability import Actuation, propagation

TEN = np.geomspace(0.3, 25.0, 10)


@pytest.mark.parametrize("actuation", ["instantaneous", "second order"])
@pytest.mark.parametrize("speed", [10.0, 20.0, 30.0])
def test_simulated_chain_agrees_at_ten_frequencies(speed: float, actuation: Actuation) -> None:
    """Stated: within 2 %. The two methods share nothing but the car's equations."""
    simulated = simulated_propagation(CAR, NOMINAL_GAINS, speed, TEN, actuation)
    closed = propagation(CAR, NOMINAL_GAINS, speed, actuation).at(TEN)
    assert np.abs(simulated / closed - 1.0).max() < 1e-3


def test_simulated_chain_of_loaded_cars() -> None:
    car = loaded(CAR, all_loadings()[-1])
    simulated = simulated_propagation(car, NOMINAL_GAINS, 30.0, TEN)
    closed = propagation(car, NOMINAL_GAINS, 30.0).at(TEN)
    assert np.abs(simulated / closed - 1.0).max() < 1e-3
    assert np.abs(closed / propagation(CAR, NOMINAL_GAINS, 30.0).at(TEN) - 1.0).max() > 0.02


def test_an_unstable_loop_does_not_settle() -> None:
    with pytest.raises(ValueError, match="not stable"):
        simulated_propagation(CAR, Gains(0.06, 3.0, 0.08), 30.0, TEN)


def test_norm_of_a_sine() -> None:
    at = np.linspace(0.0, 4.0, 4001)
    assert l2_norm(3.0 * np.sin(np.pi * at), at) == pytest.approx(3.0 * np.sqrt(2.0), rel=1e-6)
    assert l2_norm(np.array([2.0, 2.0]), np.array([1.0, 4.0])) == pytest.approx(np.sqrt(12.0))


def test_tracking_norm_takes_the_worst_of_both() -> None:
    lateral, heading = np.array([0.01, -0.08, 0.02]), np.array([0.003, 0.001, -0.1])
    assert tracking_norm(lateral, heading) == 0.1
    assert tracking_norm(lateral, 0.1 * heading) == 0.08


@given(st.lists(st.floats(0.001, 100.0), min_size=2, max_size=8))
def test_ratios_multiply_to_head_to_tail(norms: list[float]) -> None:
    ratios = amplifications(norms)
    assert len(ratios) == len(norms) - 1
    assert float(np.prod(ratios)) == pytest.approx(head_to_tail(norms))
    assert is_string_stable(norms) == all(b <= a * (1.0 + 1e-15) for a, b in pairwise(norms))


def test_string_stability_of_recorded_norms() -> None:
    assert is_string_stable([0.12, 0.11, 0.11])
    assert not is_string_stable([0.12, 0.13, 0.11])
    assert is_string_stable([0.120, 0.121, 0.11], slack=0.01)
    assert amplifications([0.0, 0.1]) == (np.inf,)
    assert head_to_tail([0.0, 0.1]) == np.inf
