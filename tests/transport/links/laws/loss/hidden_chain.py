"""Losses that depend on a hidden Markov chain: closed forms, and how far a sample may stray.

Nothing here looks at the laws under test: a law is described by its matrix of chances and the loss
in each state. Variances are exact, sums of the autocovariances of what is counted.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

LAGS = 10
FEWEST = 30.0
"""Bursts of a length that are expected to be rarer than this are not normally distributed yet."""


@dataclass(frozen=True)
class Mean:
    """A sample's mean beside what the closed form says, and the deviation that it may have."""

    what: str
    found: float
    expected: float
    deviation: float

    @property
    def errors(self) -> float:
        """Standard errors by which the sample is off."""
        return (self.found - self.expected) / self.deviation


@dataclass(frozen=True, eq=False)
class HiddenChain:
    """Chances `steps[i, j]` from state i to j, and the loss in each state."""

    steps: Vector
    loss: Vector

    @cached_property
    def shares(self) -> Vector:
        """The stationary distribution, as the left eigenvector of 1."""
        values, vectors = np.linalg.eig(self.steps.T)
        one = np.real(vectors[:, np.argmin(np.abs(values - 1.0))])
        return np.asarray(one / one.sum())

    @cached_property
    def history(self) -> int:
        """Messages after which next to nothing is left of the past."""
        second = sorted(np.abs(np.linalg.eigvals(self.steps)))[-2] if len(self.loss) > 1 else 0.0
        return 1 + int(np.log(1e-8) / np.log(second)) if second > 1e-6 else 2

    @property
    def mean(self) -> float:
        return float(self.shares @ self.loss)

    @property
    def burst(self) -> float:
        """Mean number of messages lost in a row: losses over losses that are the last."""
        last = (self.shares * self.loss) @ self.steps @ (1.0 - self.loss)
        return self.mean / float(last)

    def autocorrelation(self, lag: int) -> float:
        joint = (self.shares * self.loss) @ self._power(lag) @ self.loss
        return float((joint - self.mean**2) / (self.mean * (1.0 - self.mean)))

    def _power(self, steps: int) -> Vector:
        return np.asarray(np.linalg.matrix_power(self.steps, steps))

    def _deviation(self, near: list[float], left: Vector, right: Vector, count: int) -> float:
        """Standard deviation of a mean of `count`, from autocovariances.

        `near` are those at lags 0, 1, …; further ones are left · steps^k · right with k from 1,
        less the square of the mean, which is left · 1.
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
        """Give loss, autocorrelation of loss, and counts of bursts of a sample.

        Where no burst ends before a length, the count of the shorter one says it all.
        """
        yield self._loss_of(lost)
        for lag in range(1, LAGS + 1):
            yield self._lag_of(lost, lag)
        before = 0.0
        for least in range(1, LAGS + 1):
            one = self._bursts_of(lost, least)
            if one.expected * len(lost) >= FEWEST and not np.isclose(one.expected, before):
                yield one
            before = one.expected

    def _loss_of(self, lost: NDArray[np.bool_]) -> Mean:
        off = self.loss - self.mean
        variance = self.mean * (1.0 - self.mean)
        deviation = self._deviation([variance], self.shares * off, off, len(lost))
        return Mean("loss", float(lost.mean()), self.mean, deviation)

    def _lag_of(self, lost: NDArray[np.bool_], lag: int) -> Mean:
        """Mean product of losses `lag` apart, about the known mean, over the known variance."""
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
        """Share of messages after which a burst of at least so many begins."""
        left, right = self.shares * (1.0 - self.loss), self.loss
        for place in range(least):
            left = (left @ self.steps) * self.loss
            if place:
                right = self.loss * (self.steps @ right)
        right = (1.0 - self.loss) * (self.steps @ right)
        mean = float(left.sum())
        near = [mean - mean**2, *[-(mean**2)] * least]  # two bursts that begin so close exclude
        begins = ~lost[:-least]
        for ahead in range(1, least + 1):
            begins = begins[: len(lost) - least] & lost[ahead : len(lost) - least + ahead]
        deviation = self._deviation(near, left, right, len(begins))
        return Mean(f"bursts of {least} or more", float(begins.mean()), mean, deviation)


def independent(loss: float) -> HiddenChain:
    return HiddenChain(np.ones((1, 1)), np.array([loss]))


def good_and_bad(p: float, r: float, h: float = 0.0, k: float = 1.0) -> HiddenChain:
    """Gilbert–Elliott, the good state first."""
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
    """Messages left of a reservation (1 to longest), without a collision, then with one."""
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
