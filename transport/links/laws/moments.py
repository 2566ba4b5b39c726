"""Moments of the laws of a link: losses and delays in the long run."""

from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_ROUNDING = 1e-9


class LossStates(NamedTuple):
    """A stationary Markov chain that steps with each message, and the loss in each of its states.

    `rows[i][j]` is the chance from state i to j, `shares` are those of the messages in each state.
    """

    rows: NDArray[np.float64]
    shares: NDArray[np.float64]
    loss_by_state: NDArray[np.float64]

    @property
    def covariances(self) -> float:
        """Sum of the autocovariances of the losses.

        By the fundamental matrix (Kemeny and Snell, Finite Markov Chains, 1960, section 4.3).
        """
        one = np.eye(len(self.shares))
        rank_one = np.outer(np.ones(len(self.shares)), self.shares)
        fundamental = np.linalg.inv(one - self.rows + rank_one)
        return float((self.shares * self.loss_by_state) @ (fundamental - one) @ self.loss_by_state)


@dataclass(frozen=True, slots=True)
class Losses:
    """A stationary law of loss: its mean, its mean burst, and the sum of its autocovariances.

    The burst is None where it is unknown, or nothing is lost.
    """

    loss: float
    burst: float | None
    covariances: float

    @classmethod
    def of_bursts(cls, loss: float, burst: float | None) -> "Losses":
        """Losses as of the two-state chain (Gilbert) with this loss and mean burst."""
        if burst is None or not 0.0 < loss < 1.0:
            return cls(loss, burst, 0.0)
        correlation = 1.0 - 1.0 / burst - loss / (burst * (1.0 - loss))
        if abs(correlation) < _ROUNDING:
            return cls(loss, burst, 0.0)
        return cls(loss, burst, loss * (1.0 - loss) * correlation / (1.0 - correlation))

    @classmethod
    def independent(cls, loss: float) -> "Losses":
        """Losses of messages each on its own, whose bursts are geometric."""
        if not loss:
            return cls(loss, None, 0.0)
        return cls(loss, 1.0 / (1.0 - loss) if loss < 1.0 else inf, 0.0)

    @property
    def has_memory(self) -> bool:
        return abs(self.covariances) > _ROUNDING

    @property
    def both_delivered(self) -> float | None:
        """Chance that a message and the next one pass: bursts end as often as they begin."""
        if self.burst is None:
            return None
        return 1.0 - self.loss - self.loss / self.burst

    def beside(self, other: "Losses") -> "Losses":
        """Both laws together, each on its own; what the two memories share is bounded above."""
        passes, others = 1.0 - self.loss, 1.0 - other.loss
        shared = min(
            abs(self.covariances) * other.loss * others, abs(other.covariances) * self.loss * passes
        )
        covariances = self.covariances * others**2 + other.covariances * passes**2 + shared
        return Losses(self.loss + passes * other.loss, None, covariances)


class Delays(NamedTuple):
    """Mean (ns) and variance (ns²) of a delay, and how much a message's has of the one before.

    The `correlation` bounds that of the delays from above.
    """

    mean: float
    variance: float
    correlation: float = 0.0
