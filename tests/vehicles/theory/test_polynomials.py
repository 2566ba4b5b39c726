from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from vehicles.theory.gain_sets import (
    hurwitz_minors,
    is_hurwitz,
    is_positive_between,
    spectral_abscissa,
    squared_magnitude,
    stationary_points,
)

small = st.integers(-20, 20).map(lambda n: Fraction(n, 4))
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
    result = np.polyval(squared_magnitude(polynomial), frequency**2)
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
            points = stationary_points(numerator, denominator)
            values = np.polyval(numerator, points) / np.polyval(denominator, points)
            assert values.max() == pytest.approx(ratio[inner], rel=1e-6)
            assert values.max() >= ratio[inner] * (1.0 - 1e-12)


def test_positivity_is_decided_exactly() -> None:
    hair = Fraction(1, 10**8)
    dip = (Fraction(1, 9) + hair, Fraction(-2, 3), Fraction(1))  # (x - 1/3)² + hair
    touch = (Fraction(1, 9) - hair, Fraction(-2, 3), Fraction(1))
    assert is_positive_between(dip, Fraction(0), Fraction(1))
    assert not is_positive_between(touch, Fraction(0), Fraction(1))
    assert is_positive_between(touch, Fraction(1, 2), Fraction(1))
    assert not is_positive_between((Fraction(-1),), Fraction(0), Fraction(1))


@given(st.lists(small, min_size=1, max_size=6), small, st.integers(1, 12))
def test_positivity_is_never_refuted_by_a_sample(
    coefficients: list[Fraction], low: Fraction, width: int
) -> None:
    high = low + Fraction(width, 3)
    samples = [low + (high - low) * Fraction(k, 37) for k in range(38)]
    values = [sum(c * x**k for k, c in enumerate(coefficients)) for x in samples]
    claimed = is_positive_between(tuple(coefficients), low, high)
    assert not (claimed and min(values) <= 0)


def test_hurwitz_minors_of_a_family() -> None:
    random = np.random.default_rng(3)
    family = [tuple(Fraction(int(n)) for n in random.integers(1, 9, 2)) for _ in range(7)]
    minors = hurwitz_minors(family)
    x = Fraction(3, 7)
    values = [float(sum(c * x**k for k, c in enumerate(p))) for p in family]
    matrix = np.array(
        [
            [values[2 * j - i + 1] if 0 <= 2 * j - i + 1 <= 6 else 0.0 for j in range(5)]
            for i in range(5)
        ]
    )
    for order, minor in enumerate(minors, start=1):
        at_x = float(sum(c * x**k for k, c in enumerate(minor)))
        assert at_x == pytest.approx(np.linalg.det(matrix[:order, :order]), rel=1e-9)
    roots = np.roots(values)
    sums = np.prod([roots[i] + roots[k] for i in range(6) for k in range(i)])
    orlando = -(values[0] ** 5) * sums.real
    assert float(sum(c * x**k for k, c in enumerate(minors[-1]))) == pytest.approx(orlando)
