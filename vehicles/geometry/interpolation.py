"""The cubic through four given values."""

from collections.abc import Sequence
from typing import TypeVar

from vehicles.geometry.path import FloatArray

Number = TypeVar("Number", float, FloatArray)


def cubic_weights(t: Sequence[Number], at: Number) -> list[Number]:
    """Weights of values given at four places `t` in their cubic's value `at` a place (Lagrange).

    Of arrays, each entry is a cubic of its own.
    """
    weights = []
    for i, here in enumerate(t):
        a, b, c = (other for j, other in enumerate(t) if j != i)
        weights.append((at - a) / (here - a) * ((at - b) / (here - b)) * ((at - c) / (here - c)))
    return weights
