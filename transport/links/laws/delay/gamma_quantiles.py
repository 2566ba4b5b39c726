"""The gamma law as a function of a standard normal number, from a table.

No closed form inverts the incomplete gamma function, and scipy takes more memory than a vehicle's
process has. So its logarithm is solved for at knots of the normal number, by Newton's method, when
a law is made; in between it is a cubic (Hermite) with the exact slopes. The error is below 10^-7 of
the value for shapes from 0.04 to 10^4 (tests compare it with scipy).
"""

from functools import lru_cache
from math import erfc, exp, lgamma, log, pi, sqrt

KNOTS_PER_UNIT = 32
MAX_NORMAL = 8.5
"""Knots of the normal number reach so far to both sides; draws have 52 bits, which reach 8.3."""
_TINY = 1e-300
_EXACT = 1e-16
_SOLVED = 1e-6
"""Newton's method squares its error, so after so small a step 10^-12 is left."""
_LOG_ROOT_TWO_PI = 0.5 * log(2.0 * pi)


@lru_cache(maxsize=16)
def log_quantiles(shape: float) -> tuple[tuple[float, float], ...]:
    """Logarithm of the quantile (scale 1), and its slope, at each knot of the normal number."""
    last = round(MAX_NORMAL * KNOTS_PER_UNIT)
    # Wilson and Hilferty's approximation of the median is a good start (PNAS 17, 1931).
    middle = start = log(shape) + 3.0 * log(max(1.0 - 1.0 / (9.0 * shape), 0.1))
    found = {}
    for way in (1, -1):
        start = middle
        for k in range(last + 1):
            z = way * k / KNOTS_PER_UNIT
            value = _solved(shape, z, start)
            slope = exp(_log_density(z) - _log_density_of_logarithm(shape, value))
            found[way * k] = value, slope
            start = value + way * slope / KNOTS_PER_UNIT
            middle = value if k == 0 else middle
    return tuple(found[k] for k in range(-last, last + 1))


def log_quantile(table: tuple[tuple[float, float], ...], z: float) -> float:
    """Logarithm of the quantile that belongs to the standard normal number `z`."""
    place = (min(max(z, -MAX_NORMAL), MAX_NORMAL) + MAX_NORMAL) * KNOTS_PER_UNIT
    k = min(int(place), len(table) - 2)
    u = place - k
    (before, slope), (after, slope_after) = table[k], table[k + 1]
    step = after - before
    first, second = slope / KNOTS_PER_UNIT - step, step - slope_after / KNOTS_PER_UNIT
    return before + u * (step + (1.0 - u) * ((1.0 - u) * first + u * second))


def _solved(shape: float, z: float, start: float) -> float:
    """Logarithm at which the nearer tail has the normal one's probability, by Newton's method.

    Both tails' logarithms are concave in it, so the steps do not leave the root again.
    """
    wanted = log(0.5 * erfc(abs(z) / sqrt(2.0)))
    value = start
    for _ in range(60):
        found = _log_tail(shape, value, upper=z > 0.0)
        slope = exp(_log_density_of_logarithm(shape, value) - found) * (-1.0 if z > 0.0 else 1.0)
        step = (wanted - found) / slope
        value += step
        if abs(step) <= _SOLVED:
            break
    return value


def _log_density(z: float) -> float:
    return -0.5 * z * z - _LOG_ROOT_TWO_PI


def _log_density_of_logarithm(shape: float, value: float) -> float:
    """Logarithm of the density of the logarithm of a gamma number."""
    return shape * value - exp(value) - lgamma(shape)


def _log_tail(shape: float, value: float, *, upper: bool) -> float:
    """Logarithm of the incomplete gamma function of exp(value), regularised, lower or upper.

    By the series DLMF 8.11.4 below `shape` + 1, and the continued fraction 8.9.2 above.
    """
    x = exp(value)
    density = _log_density_of_logarithm(shape, value)
    if x < shape + 1.0:
        lower = density + log(_series(shape, x))
        return log(max(1.0 - exp(lower), _TINY)) if upper else lower
    log_upper = density + log(_fraction(shape, x))
    return log_upper if upper else log(max(1.0 - exp(log_upper), _TINY))


def _series(shape: float, x: float) -> float:
    """Sum of x^n / (shape (shape + 1) ... (shape + n)) over n (DLMF 8.11.4)."""
    term = total = 1.0 / shape
    n = shape
    while term > _EXACT * total:
        n += 1.0
        term *= x / n
        total += term
    return total


def _fraction(shape: float, x: float) -> float:
    """Continued fraction of the upper function (DLMF 8.9.2), by Lentz's method."""
    b = x + 1.0 - shape
    c, d = 1.0 / _TINY, 1.0 / b
    total = d
    for n in range(1, 10_000):
        a = n * (shape - n)
        b += 2.0
        d = 1.0 / (a * d + b or _TINY)
        c = b + a / c or _TINY
        change = c * d
        total *= change
        if abs(change - 1.0) < 4.0 * _EXACT:
            break
    return total
