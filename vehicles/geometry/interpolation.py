"""The cubic through four given values."""

import numpy as np

from vehicles.geometry.path import FloatArray


def cubic_weights(t: FloatArray, at: FloatArray | float) -> FloatArray:
    """Weights of the values given at four places `t` (4, ...) in their cubic's value at `at` (...).

    Lagrange's form (elementary algebra); the weights have the shape of `t`.
    """
    weights = np.ones_like(t)
    for i in range(4):
        for j in range(4):
            if j != i:
                weights[i] *= (at - t[j]) / (t[i] - t[j])
    return weights
