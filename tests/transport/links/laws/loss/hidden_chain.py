"""Losses by a hidden Markov chain: closed forms, and standard deviations of samples.

Independent of the laws under test: a law is given by its transition matrix and the loss in each
state. Variances are exact sums of autocovariances.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

LAGS = 10
FEWEST = 30.0
"""Counts of bursts with a smaller expectation are not normally distributed."""


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

    @cached_property
    def history(self) -> int:
        """Messages after which the state is nearly independent."""
        second = sorted(np.abs(np.linalg.eigvals(self.steps)))[-2] if len(self.loss) > 1 else 0.0
        return 1 + int(np.log(1e-8) / np.log(second)) if second > 1e-6 else 2

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

    def _deviation(self, near: list[float], left: Vector, right: Vector, count: int) -> float:
        """Standard deviation of a mean of `count`, from autocovariances.

        `near` are those at lags 0, 1, …; further ones are left · steps^k · right for k ≥ 1, minus
        the square of the mean, which is left · 1.
        """
        square, total = float(left.sum()) ** 2, near[0]
        row = left
        for lag in range(1, len(near) + self.history):
            if lag < len(near):
                covariance = near[lag]
            else:
                row = row @ self.steps
                covariance = float(row @ right) - square
            total += 2.0 * (1.0 - lag / count) * covariance
        return float(np.sqrt(total / count))

    def compared(self, lost: NDArray[np.bool_]) -> Iterator[Mean]:
        """Loss, autocorrelation of losses, and counts of bursts of a sample.

        Lengths before which no burst ends are left out.
        """
        yield self._loss_of(lost)
        for lag in range(1, LAGS + 1):
            yield self._lag_of(lost, lag)
        before = 0.0
        for least in range(1, LAGS + 1):
            bursts = self._bursts_of(lost, least)
            if bursts.expected * len(lost) >= FEWEST and not np.isclose(bursts.expected, before):
                yield bursts
            before = bursts.expected

    def _loss_of(self, lost: NDArray[np.bool_]) -> Mean:
        off = self.loss - self.mean
        variance = self.mean * (1.0 - self.mean)
        deviation = self._deviation([variance], self.shares * off, off, len(lost))
        return Mean("loss", float(lost.mean()), self.mean, deviation)

    def _lag_of(self, lost: NDArray[np.bool_], lag: int) -> Mean:
        """Autocorrelation at `lag`, with the known mean and variance."""
        mean, variance = self.mean, self.mean * (1.0 - self.mean)
        off = self.loss - mean
        squared = self.loss * (1.0 - mean) ** 2 + (1.0 - self.loss) * mean**2
        begun, apart = self.shares * off, self._power(lag)
        left, right = (begun @ apart) * off, off * (apart @ off)
        square = float(left.sum()) ** 2
        near = [float((self.shares * squared) @ apart @ squared) - square]
        for shift in range(1, lag):
            first = (begun @ self._power(shift)) * off
            second = (first @ self._power(lag - shift)) * off
            near.append(float(second @ self._power(shift) @ off) - square)
        near.append(float(((begun @ apart) * squared) @ apart @ off) - square)
        centred = lost - mean
        found = float(np.mean(centred[:-lag] * centred[lag:])) / variance
        deviation = self._deviation(near, left, right, len(lost) - lag) / variance
        return Mean(f"autocorrelation at {lag}", found, self.autocorrelation(lag), deviation)

    def _bursts_of(self, lost: NDArray[np.bool_], least: int) -> Mean:
        """Share of messages after which a burst of at least this length begins."""
        left, right = self.shares * (1.0 - self.loss), self.loss
        for place in range(least):
            left = (left @ self.steps) * self.loss
            if place:
                right = self.loss * (self.steps @ right)
        right = (1.0 - self.loss) * (self.steps @ right)
        mean = float(left.sum())
        near = [mean - mean**2, *[-(mean**2)] * least]  # two bursts cannot begin this close
        begins = ~lost[:-least]
        for ahead in range(1, least + 1):
            begins = begins[: len(lost) - least] & lost[ahead : len(lost) - least + ahead]
        deviation = self._deviation(near, left, right, len(begins))
        return Mean(f"bursts of {least} or more", float(begins.mean()), mean, deviation)


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
