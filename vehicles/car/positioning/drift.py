"""Drifting errors: a first-order Gauss–Markov process in two axes, the same path at any rate.

The process has a fixed grid of 10 ms that begins with the run, and is constant between points of
the grid. So its statistics do not depend on the rate of measurements, and receivers that measure at
the same instant, in any process, have the same value to the bit.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.random import Generator

from vehicles.schedule import MILLISECOND, SECOND
from vehicles.setting import Setting

GRID = 10 * MILLISECOND
"""Distance (ns) between two points of the path; receivers of cars measure at 20 Hz at most."""
BLOCK = 512
"""Number of points that are computed at once."""
MIN_TIME_CONSTANT = 0.1
"""Least time constant (s): below it the grid is too coarse."""


@dataclass(frozen=True, slots=True)
class Drift:
    """First-order Gauss–Markov drift: steady deviation per axis (m), and time constant (s)."""

    deviation: Annotated[float, Setting("steady, per axis", "m", 0, 1000, example=0.016)]
    time_constant: Annotated[float, Setting("of its decay", "s", MIN_TIME_CONSTANT, 100_000)] = (
        100.0
    )


class GaussMarkov:
    """A first-order Gauss–Markov process of deviation 1 in each of two axes, stationary.

    Exactly discretised: x[k] = r x[k-1] + sqrt(1 - r²) w[k] with r = exp(-grid / time constant) and
    white Gaussian w, so the autocorrelation at lag t is exp(-t / time constant).
    """

    def __init__(self, time_constant: float, start_at: int, random: Generator) -> None:
        """`time_constant` in s, `start_at` in ns; ValueError below `MIN_TIME_CONSTANT`."""
        if not MIN_TIME_CONSTANT <= time_constant < math.inf:
            raise ValueError(f"the time constant must be at least {MIN_TIME_CONSTANT} s")
        rate = GRID / SECOND / time_constant
        steps = range(1, BLOCK + 1)
        # Not by NumPy, whose last bit depends on the processor.
        self._kept = np.array([math.exp(-rate * k) for k in steps])
        spread = math.sqrt(-math.expm1(-2.0 * rate))
        self._scaled = np.array([spread * math.exp(rate * k) for k in steps])
        self._start_at = start_at
        self._random = random
        self._before = random.standard_normal(2)
        self._first, self._east, self._north = 0, *([one] for one in self._before.tolist())

    def at(self, now: int) -> tuple[float, float]:
        """East and north at `now` (ns), in order of time."""
        index = (now - self._start_at) // GRID - self._first
        while index >= len(self._east):
            index -= len(self._east)
            self._extend()
        if index < 0:
            raise ValueError(f"{now} ns lies before the part of the path that is kept")
        return self._east[index], self._north[index]

    def _extend(self) -> None:
        """Compute the next block: the recursion as a sum of scaled terms."""
        drawn = self._random.standard_normal((2, BLOCK))
        path = self._kept * (self._before[:, None] + np.cumsum(self._scaled * drawn, axis=1))
        self._first += len(self._east)
        self._before = path[:, -1]
        self._east, self._north = path.tolist()


def restarted(
    value: tuple[float, float], first: tuple[float, float], jump: tuple[float, float], kept: float
) -> tuple[float, float]:
    """Value of a Gauss–Markov process that began at `jump` instead of at `first`.

    `value` is that of the stationary process of the same deviation, which was `first` then. The
    initial difference fades by `kept`: exp(-t / time constant).
    """
    return (
        value[0] + kept * (jump[0] - first[0]),
        value[1] + kept * (jump[1] - first[1]),
    )


def draw_truncated(
    deviation: float, most: float, draws: tuple[float, float]
) -> tuple[float, float]:
    """Draw a place from the stationary law of a Gauss–Markov process, within a circle about 0.

    `deviation` (m) is that of each axis, `most` (m) the radius; `draws` are uniform in [0, 1). The
    distance of two normal numbers from 0 is Rayleigh's; its distribution function is inverted.
    """
    if deviation <= 0.0 or most <= 0.0:
        return 0.0, 0.0
    reached = -math.expm1(-0.5 * (most / deviation) ** 2)
    away = min(deviation * math.sqrt(-2.0 * math.log1p(-draws[0] * reached)), most)
    angle = 2.0 * math.pi * draws[1]
    return away * math.cos(angle), away * math.sin(angle)
