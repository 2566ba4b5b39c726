"""Polynomials of a closed loop: Hurwitz stability, and stationary points of a ratio.

Floating-point polynomials are arrays of coefficients in descending powers, as for numpy.roots.
Exact polynomials are tuples of fractions in ascending powers.
"""

from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from math import comb

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Exact = tuple[Fraction, ...]  # A polynomial with rational coefficients, constant term first
DEEPEST_SUBDIVISION = 40  # Number of bisections after which an exact positivity check returns False


def is_hurwitz(coefficients: Array) -> NDArray[np.bool_]:
    """Whether all roots have negative real parts, by Routh's array (Routh-Hurwitz criterion).

    Maps shape (..., n + 1) to (...). A polynomial with a root on the imaginary axis (a zero in the
    first column) is not Hurwitz.
    """
    count = coefficients.shape[-1]
    sign = np.sign(coefficients[..., 0])
    columns = [np.asarray(coefficients[..., k] * sign, dtype=np.float64) for k in range(count)]
    upper, lower = columns[0::2], columns[1::2]
    stable = upper[0] > 0.0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for _ in range(count - 1):
            stable = stable & (lower[0] > 0.0)
            ratio = upper[0] / lower[0]
            following = [
                above - ratio * below for above, below in zip(upper[1:], lower[1:], strict=False)
            ]
            upper, lower = lower, following + upper[1 + len(following) :]
    return np.asarray(stable)


def spectral_abscissa(coefficients: Array) -> Array:
    """Largest real part of the roots, shape (..., n + 1) to (...), from companion matrices."""
    degree = coefficients.shape[-1] - 1
    companion = np.zeros((*coefficients.shape[:-1], degree, degree))
    companion[..., 0, :] = -coefficients[..., 1:] / coefficients[..., :1]
    companion[..., np.arange(1, degree), np.arange(degree - 1)] = 1.0
    return np.asarray(np.linalg.eigvals(companion).real.max(axis=-1))


def squared_magnitude(polynomial: Array) -> Array:
    """|p(j w)|² as a polynomial in x = w²: p(s) p(-s) has even powers only, and s² = -x.

    The inverse of spectral factorisation.
    """
    powers = np.arange(len(polynomial))[::-1]
    product = np.convolve(polynomial, polynomial * (-1.0) ** powers)[::2]
    return np.asarray(product * (-1.0) ** powers)


def stationary_points(numerator: Array, denominator: Array) -> Array:
    """Candidates on x > 0 for stationary points of numerator / denominator; none is missed.

    The real parts of all roots of N' D - N D' (quotient rule) in the right half-plane. Callers
    evaluate the ratio and take the extreme, so spurious candidates are harmless and no tolerance
    is needed to distinguish real roots. The array may be empty.
    """
    slope: Array = np.polysub(
        np.polymul(np.polyder(numerator), denominator),
        np.polymul(numerator, np.polyder(denominator)),
    )
    candidates = np.roots(slope).real
    return np.asarray(candidates[candidates > 0.0])


def multiply(left: Exact, right: Exact) -> Exact:
    """Product of two exact polynomials (Cauchy product)."""
    product = [Fraction(0)] * (len(left) + len(right) - 1)
    for i, factor in enumerate(left):
        for j, other in enumerate(right):
            product[i + j] += factor * other
    return tuple(product)


def add(left: Exact, right: Exact, factor: int = 1) -> Exact:
    """Sum left + factor * right, exactly (elementary algebra)."""
    length = max(len(left), len(right))
    a = left + (Fraction(0),) * (length - len(left))
    b = right + (Fraction(0),) * (length - len(right))
    return tuple(p + factor * q for p, q in zip(a, b, strict=True))


def is_positive_between(polynomial: Exact, low: Fraction, high: Fraction) -> bool:
    """Whether polynomial(x) > 0 for every x in [low, high], proven in exact arithmetic.

    Bernstein coefficients on an interval bound the polynomial from below; the first and last are
    its end values. If they do not decide, the interval is halved (de Casteljau). False if the
    polynomial touches zero within 2^-40 of the interval.
    """
    degree = len(polynomial) - 1
    moved = _affine_argument(polynomial, low, high - low)
    bernstein = [
        sum((Fraction(comb(i, k), comb(degree, k)) * moved[k] for k in range(i + 1)), Fraction(0))
        for i in range(degree + 1)
    ]
    pending = [(bernstein, 0)]
    while pending:
        values, depth = pending.pop()
        if min(values) > 0:
            continue
        if values[0] <= 0 or values[-1] <= 0 or depth == DEEPEST_SUBDIVISION:
            return False
        pending.extend((half, depth + 1) for half in _halves(values))
    return True


def _affine_argument(polynomial: Exact, offset: Fraction, factor: Fraction) -> Exact:
    """Coefficients of polynomial(offset + factor t) in t."""
    result: Exact = (Fraction(0),)
    for coefficient in reversed(polynomial):
        result = add(multiply(result, (offset, factor)), (coefficient,))
    return result[: len(polynomial)]


def _halves(values: Sequence[Fraction]) -> tuple[list[Fraction], list[Fraction]]:
    """Split Bernstein coefficients at the middle of their interval (de Casteljau)."""
    left, right, row = [], [], list(values)
    while row:
        left.append(row[0])
        right.append(row[-1])
        row = [(p + q) / 2 for p, q in pairwise(row)]
    return left, right[::-1]


def hurwitz_minors(coefficients: Sequence[Exact]) -> list[Exact]:
    """Leading minors of Hurwitz's matrix of a polynomial in s whose coefficients depend on x.

    `coefficients` are in descending powers of s. They are exact polynomials in x, and so are the
    minors, of order 1 to n - 1. With a positive first and last coefficient, all roots lie in the
    open left half-plane if and only if all minors are positive (Hurwitz's criterion).
    """
    degree = len(coefficients) - 1
    zero: Exact = (Fraction(0),)
    matrix = [
        [
            coefficients[2 * column - row + 1] if 0 <= 2 * column - row + 1 <= degree else zero
            for column in range(degree - 1)
        ]
        for row in range(degree - 1)
    ]
    return [_determinant([row[:order] for row in matrix[:order]]) for order in range(1, degree)]


def shifted(coefficients: Sequence[Exact], decay: Fraction) -> list[Exact]:
    """Coefficients of p(s - decay), which is Hurwitz if all roots of p lie left of -decay.

    By Horner's scheme, in exact arithmetic.
    """
    result: list[Exact] = []
    for coefficient in coefficients:
        lowered = [multiply(term, (-decay,)) for term in result]
        result = [
            add(*pair)
            for pair in zip([*result, coefficient], [(Fraction(0),), *lowered], strict=True)
        ]
    return result


def _determinant(rows: list[list[Exact]]) -> Exact:
    """Laplace expansion along the first row; the matrices are sparse, and at most 5 by 5."""
    if len(rows) == 1:
        return rows[0][0]
    total: Exact = (Fraction(0),)
    for column, entry in enumerate(rows[0]):
        if not any(entry):
            continue
        minor = [row[:column] + row[column + 1 :] for row in rows[1:]]
        total = add(total, multiply(entry, _determinant(minor)), -1 if column % 2 else 1)
    return total
