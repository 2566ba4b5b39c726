"""Moments of the losses and delays of a link in the long run."""

from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_ROUNDING = 1e-9


class LossStates(NamedTuple):
    """Stationary Markov chain that steps with each message, and the loss ratio of each state.

    `rows[i][j]` is the probability from state i to j, `shares` is the stationary distribution.
    """

    rows: NDArray[np.float64]
    shares: NDArray[np.float64]
    loss_by_state: NDArray[np.float64]

    @property
    def covariances(self) -> float:
        """Sum of the autocovariances of the losses at lags 1, 2, ….

        By the fundamental matrix (Kemeny and Snell, Finite Markov Chains, 1960, section 4.3).
        """
        identity = np.eye(len(self.shares))
        limit = np.outer(np.ones(len(self.shares)), self.shares)
        fundamental = np.linalg.inv(identity - self.rows + limit)
        loss = self.loss_by_state
        return float((self.shares * loss) @ (fundamental - identity) @ loss)


@dataclass(frozen=True, slots=True)
class Losses:
    """Moments of a stationary loss: mean, mean burst (messages), sum of the autocovariances.

    The burst is None if it is unknown or nothing is lost.
    """

    loss: float
    burst: float | None
    covariances: float

    @classmethod
    def of_bursts(cls, loss: float, burst: float | None) -> "Losses":
        """Losses of Gilbert's two-state chain with this loss and mean burst."""
        if burst is None or not 0.0 < loss < 1.0:
            return cls(loss, burst, 0.0)
        correlation = 1.0 - 1.0 / burst - loss / (burst * (1.0 - loss))
        if abs(correlation) < _ROUNDING:
            return cls(loss, burst, 0.0)
        return cls(loss, burst, loss * (1.0 - loss) * correlation / (1.0 - correlation))

    @classmethod
    def independent(cls, loss: float) -> "Losses":
        """Independent losses, whose bursts are geometric."""
        if not loss:
            return cls(loss, None, 0.0)
        return cls(loss, 1.0 / (1.0 - loss) if loss < 1.0 else inf, 0.0)

    @property
    def has_memory(self) -> bool:
        return abs(self.covariances) > _ROUNDING

    @property
    def both_delivered(self) -> float | None:
        """Probability that a message and the next one are delivered; None if unknown."""
        if self.burst is None:
            return None
        return 1.0 - self.loss - self.loss / self.burst

    def beside(self, other: "Losses") -> "Losses":
        """Two independent laws in series; the product of their covariances is bounded above."""
        delivery, others = 1.0 - self.loss, 1.0 - other.loss
        product = min(
            abs(self.covariances) * other.loss * others,
            abs(other.covariances) * self.loss * delivery,
        )
        covariances = self.covariances * others**2 + other.covariances * delivery**2 + product
        return Losses(self.loss + delivery * other.loss, None, covariances)


class Delays(NamedTuple):
    """Mean (ns) and variance (ns²) of a delay, and a bound of its correlation at lag 1."""

    mean: float
    variance: float
    correlation: float = 0.0
