import numpy as np
import pytest
from hypothesis import assume, given

from tests.made.examples import examples
from tests.made.vehicles.theory.random_cars import CAR, CARS, GAINS, SPEEDS
from vehicles.car.parameters import Gains, VehicleParameters, all_loadings, loaded
from vehicles.theory.gain_sets import (
    PAPER_SPEEDS,
    abscissa,
    gain_extremes,
    is_stabilising,
    stabilises_all,
)
from vehicles.theory.linear_model import characteristic_polynomial

LOADED = [loaded(CAR, loading) for loading in all_loadings()]


def _extent(speed: float) -> np.ndarray:
    extremes = np.array(gain_extremes([CAR], [speed]))
    return np.array([extremes[k, :, k] for k in range(3)])


@examples(16, 150)
@given(CARS, GAINS, SPEEDS)
def test_membership_of_any_car(car: VehicleParameters, gains: Gains, speed: float) -> None:
    roots = np.roots(characteristic_polynomial(car, gains, speed))
    worst = float(roots.real.max())
    assume(abs(worst) > 1e-6)
    assert bool(is_stabilising(car, speed, np.array(gains))) == (worst < 0.0)
    assert abscissa(car, gains, [speed])[0] == pytest.approx(worst, rel=1e-6, abs=1e-6)


def test_the_intersection_is_contained_in_every_case() -> None:
    gains = np.random.default_rng(2).uniform([0.0, 0.0, -0.1], [1.5, 2.0, 0.3], (2000, 3))
    every = np.all([is_stabilising(CAR, speed, gains) for speed in PAPER_SPEEDS], axis=0)
    together = stabilises_all([CAR], PAPER_SPEEDS, gains)
    assert np.array_equal(every, together)
    assert 100 < together.sum() < 1900


def test_the_extremes_contain_the_set() -> None:
    """The set at 30 m/s is bounded, as in the paper; a wider search finds no further members."""
    random = np.random.default_rng(4)
    gains = random.uniform([0.0, -20.0, -2.0], [20.0, 20.0, 2.0], (100_000, 3))
    low, high = _extent(30.0).T
    inner = random.uniform(low, high, (20_000, 3))
    inside = np.concatenate([g[is_stabilising(CAR, 30.0, g)] for g in (gains, inner)])
    assert len(inside) > 1000
    assert (inside > low - 0.02 * (high - low)).all()
    assert (inside < high + 0.02 * (high - low)).all()


def test_the_extremes_are_members() -> None:
    extremes = np.array(gain_extremes([CAR], [30.0]))
    assert is_stabilising(CAR, 30.0, extremes).all()
    assert _extent(30.0)[0] == pytest.approx((0.0, 1.54), abs=0.01)
