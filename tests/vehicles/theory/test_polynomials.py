import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from vehicles.theory.gain_sets import (
    is_hurwitz,
    spectral_abscissa,
    stationary_points,
)
from vehicles.theory.string_stability import squared_magnitude

REAL_PARTS = st.lists(st.floats(-5.0, 5.0).filter(lambda x: abs(x) > 1e-3), min_size=1, max_size=4)


@given(REAL_PARTS, st.floats(0.1, 10.0))
def test_routh_agrees_with_the_roots(real_parts: list[float], imaginary: float) -> None:
    roots = [part + 1j * imaginary for part in real_parts]
    polynomial = np.array(np.poly(roots + np.conj(roots).tolist()).real, dtype=float)
    assert bool(is_hurwitz(polynomial)) == (max(real_parts) < 0.0)
    assert bool(is_hurwitz(-2.5 * polynomial)) == (max(real_parts) < 0.0)


def test_routh_on_a_grid_of_random_polynomials() -> None:
    polynomials = np.random.default_rng(5).uniform(0.1, 3.0, size=(40, 500, 6))
    stable = is_hurwitz(polynomials)
    abscissa = spectral_abscissa(polynomials)
    by_roots = [np.roots(p).real.max() for p in polynomials.reshape(-1, 6)]
    assert abscissa.ravel() == pytest.approx(np.array(by_roots), abs=1e-9)
    assert 0 < stable.sum() < stable.size
    assert np.array_equal(stable, abscissa < 0.0)


@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=7), st.floats(0.0, 5.0))
@example([0.0, 1.0], 1.0)
def test_squared_magnitude(coefficients: list[float], frequency: float) -> None:
    polynomial = np.array(coefficients)
    direct = abs(np.polyval(polynomial, 1j * frequency)) ** 2
    scale = np.polyval(np.abs(polynomial), frequency) ** 2 + 1e-300
    result = squared_magnitude(polynomial)(frequency**2)
    assert abs(result - direct) <= 1e-12 * scale


def test_stationary_points_hold_the_extremes_of_a_ratio() -> None:
    random = np.random.default_rng(1)
    x = np.linspace(1e-4, 20.0, 200_001)
    for _ in range(20):
        numerator, denominator = (
            random.normal(size=4),
            np.array(np.poly(-random.uniform(0.5, 5.0, 4)), float),
        )
        ratio = np.polyval(numerator, x) / np.polyval(denominator, x)
        inner = np.argmax(ratio[1:-1]) + 1
        if ratio[inner] > max(ratio[0], ratio[-1]):
            points = stationary_points(np.poly1d(numerator), np.poly1d(denominator))
            values = np.polyval(numerator, points) / np.polyval(denominator, points)
            assert values.max() == pytest.approx(ratio[inner], rel=1e-6)
            assert values.max() >= ratio[inner] * (1.0 - 1e-12)
