"""Losses by a hidden Markov chain: closed forms, and standard deviations of samples.

Independent of the laws under test: a law is given by its transition matrix and the loss in each
state. Deviations are those of the means of batches.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

LAGS = 10
FEWEST = 200.0
"""Bursts with a smaller expected count are too few for the means of batches."""
BATCHES = 40
"""Batches of a sample, long enough to be independent."""


@dataclass(frozen=True)
class Mean:
    """Mean of a sample, its value in closed form and its standard deviation."""

    label: str
    found: float
    expected: float
    deviation: float

    @property
    def errors(self) -> float:
        """Error of the sample in standard errors."""
        return (self.found - self.expected) / self.deviation


@dataclass(frozen=True, eq=False)
class HiddenChain:
    """Probabilities `steps[i, j]` from state i to j, and the loss in each state."""

    steps: Vector
    loss: Vector

    @cached_property
    def shares(self) -> Vector:
        """Stationary distribution: the left eigenvector of eigenvalue 1."""
        values, vectors = np.linalg.eig(self.steps.T)
        vector = np.real(vectors[:, np.argmin(np.abs(values - 1.0))])
        return np.asarray(vector / vector.sum())

    @property
    def mean(self) -> float:
        return float(self.shares @ self.loss)

    @property
    def burst(self) -> float:
        """Mean number of messages lost in a row: losses over last losses."""
        last = (self.shares * self.loss) @ self.steps @ (1.0 - self.loss)
        return self.mean / float(last)

    def autocorrelation(self, lag: int) -> float:
        joint = (self.shares * self.loss) @ self._power(lag) @ self.loss
        return float((joint - self.mean**2) / (self.mean * (1.0 - self.mean)))

    def _power(self, steps: int) -> Vector:
        return np.asarray(np.linalg.matrix_power(self.steps, steps))

    def compared(self, lost: NDArray[np.bool_]) -> Iterator[Mean]:
        """Loss, autocorrelation of losses, and shares of messages after which a burst begins.

        Bursts before whose length none ends, and too few of them, are left out.
        """
        yield _mean("loss", lost, self.mean)
        mean, variance = self.mean, self.mean * (1.0 - self.mean)
        centred = lost - mean
        for lag in range(1, LAGS + 1):
            products = centred[:-lag] * centred[lag:] / variance
            yield _mean(f"autocorrelation at {lag}", products, self.autocorrelation(lag))
        before, begun, expected = 0.0, ~lost, self.shares * (1.0 - self.loss)
        for least in range(1, LAGS + 1):
            begun = begun[:-1] & lost[least:]
            expected = (expected @ self.steps) * self.loss
            share = float(expected.sum())
            if share * len(lost) >= FEWEST and not np.isclose(share, before):
                yield _mean(f"bursts of {least} or more", begun, share)
            before = share


def _mean(label: str, values: NDArray[Any], expected: float) -> Mean:
    """Mean of dependent values, with the deviation of the means of batches."""
    batches = np.array_split(np.asarray(values, dtype=float), BATCHES)
    means = np.array([batch.mean() for batch in batches])
    deviation = float(means.std(ddof=1) / np.sqrt(BATCHES))
    return Mean(label, float(np.mean(values)), expected, deviation)


def independent(loss: float) -> HiddenChain:
    return HiddenChain(np.ones((1, 1)), np.array([loss]))


def good_and_bad(p: float, r: float, h: float = 0.0, k: float = 1.0) -> HiddenChain:
    """Gilbert–Elliott model, good state first."""
    return HiddenChain(np.array([[1 - p, p], [r, 1 - r]]), np.array([1 - k, 1 - h]))


def netem_states(p13: float, p31: float, p32: float, p23: float, p14: float) -> HiddenChain:
    """The four states in netem's order."""
    steps = [
        [1 - p13 - p14, 0, p13, p14],
        [0, 1 - p23, p23, 0],
        [p31, p32, 1 - p31 - p32, 0],
        [1, 0, 0, 0],
    ]
    return HiddenChain(np.array(steps, dtype=float), np.array([0.0, 0.0, 1.0, 1.0]))


def reservations(loss: float, keep: float, shortest: int, longest: int) -> HiddenChain:
    """States: messages left of a reservation (1 to longest), without, then with a collision."""
    steps = np.zeros((2 * longest, 2 * longest))
    new = np.zeros(longest)
    new[shortest - 1 :] = 1.0 / (longest - shortest + 1)
    for collides in (0, 1):
        at = collides * longest
        for left in range(1, longest):
            steps[at + left, at + left - 1] = 1.0
        steps[at, :longest] += (1.0 - keep) * (1.0 - loss) * new
        steps[at, longest:] += (1.0 - keep) * loss * new
        steps[at, at : at + longest] += keep * new
    return HiddenChain(steps, np.repeat([0.0, 1.0], longest))
