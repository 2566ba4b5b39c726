"""Drifting errors: a first-order Gauss–Markov process in two axes, independent of the rate.

The process is defined on a grid of 10 ms from the start of the run, and constant in between. So its
statistics do not depend on the rate of measurements. Receivers that measure at the same instant, in
any operating-system process, get bit-identical values.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.random import Generator

from vehicles.schedule import MILLISECOND, SECOND
from vehicles.setting import Setting

GRID = 10 * MILLISECOND  # Grid spacing (ns); automotive receivers measure at 20 Hz at most
BLOCK = 512  # Number of points computed at once
MIN_TIME_CONSTANT = 0.1  # Lower bound of the time constant (s): below it the grid is too coarse


@dataclass(frozen=True, slots=True)
class Drift:
    """First-order Gauss–Markov drift: standard deviation per axis (m), and time constant (s)."""

    deviation: Annotated[
        float, Setting("stationary standard deviation, per axis", "m", 0, 1000, example=0.016)
    ]
    time_constant: Annotated[
        float, Setting("time constant of the drift", "s", MIN_TIME_CONSTANT, 100_000)
    ] = 100.0


class GaussMarkov:
    """A stationary first-order Gauss–Markov process in two axes, of standard deviation 1 per axis.

    Exact discretisation: x[k] = r x[k-1] + sqrt(1 - r²) w[k] with r = exp(-grid / time constant)
    and white Gaussian w. The autocorrelation at lag t is exp(-t / time constant).
    """

    def __init__(self, time_constant: float, start_at: int, random: Generator) -> None:
        """`time_constant` in s, `start_at` in ns; ValueError below `MIN_TIME_CONSTANT`."""
        if not MIN_TIME_CONSTANT <= time_constant < math.inf:
            raise ValueError(f"the time constant must be at least {MIN_TIME_CONSTANT} s")
        rate = GRID / SECOND / time_constant
        steps = range(1, BLOCK + 1)
        # NumPy's exp is not used, as its last bit depends on the processor.
        self._kept = np.array([math.exp(-rate * k) for k in steps])
        spread = math.sqrt(-math.expm1(-2.0 * rate))
        self._scaled = np.array([spread * math.exp(rate * k) for k in steps])
        self._start_at = start_at
        self._random = random
        self._before = random.standard_normal(2)
        self._first, self._east, self._north = 0, *([one] for one in self._before.tolist())

    def at(self, now: int) -> tuple[float, float]:
        """East and north at `now` (ns); calls must be in order of time."""
        index = (now - self._start_at) // GRID - self._first
        while index >= len(self._east):
            index -= len(self._east)
            self._extend()
        if index < 0:
            raise ValueError(f"{now} ns is before the stored part of the process")
        return self._east[index], self._north[index]

    def _extend(self) -> None:
        """Compute the next block, with the recursion as a cumulative sum of scaled terms."""
        drawn = self._random.standard_normal((2, BLOCK))
        path = self._kept * (self._before[:, None] + np.cumsum(self._scaled * drawn, axis=1))
        self._first += len(self._east)
        self._before = path[:, -1]
        self._east, self._north = path.tolist()


def restarted(
    value: tuple[float, float], first: tuple[float, float], jump: tuple[float, float], kept: float
) -> tuple[float, float]:
    """Value of a Gauss–Markov process that restarted at `jump` instead of `first`.

    `value` is that of the undisturbed process, which had the value `first` at the restart. The
    initial difference decays by the factor `kept`, exp(-t / time constant).
    """
    return (value[0] + kept * (jump[0] - first[0]), value[1] + kept * (jump[1] - first[1]))


def draw_truncated(
    deviation: float, radius: float, draws: tuple[float, float]
) -> tuple[float, float]:
    """Draw from the stationary distribution of a Gauss–Markov process, truncated to a circle.

    `deviation` (m) is the standard deviation per axis; the circle of `radius` (m) is centred at 0;
    `draws` are uniform in [0, 1). Inverts the distribution function of Rayleigh's distribution.
    """
    if deviation <= 0.0 or radius <= 0.0:
        return 0.0, 0.0
    probability = -math.expm1(-0.5 * (radius / deviation) ** 2)
    distance = min(deviation * math.sqrt(-2.0 * math.log1p(-draws[0] * probability)), radius)
    angle = 2.0 * math.pi * draws[1]
    return distance * math.cos(angle), distance * math.sin(angle)
