"""Estimates with their intervals: a share of dependent events, the length of bursts, quantiles."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95
"""Confidence of reported intervals."""
CERTAINTY = 0.9999
"""Confidence beyond which a figure deviates from its request."""


@dataclass(frozen=True, slots=True)
class ConfidenceInterval:
    value: float
    low: float
    high: float


def quantile_of_normal(confidence: float) -> float:
    """Half-width, in standard deviations, of the central interval of a normal law."""
    return NormalDist().inv_cdf(0.5 + 0.5 * confidence)


def share(count: float, of: float, confidence: float, inflation: float = 1.0) -> ConfidenceInterval:
    """Wilson's interval of a share (E. B. Wilson, JASA 22, 1927) of `of` events.

    `inflation` divides the number of independent events: for a chain with the lag-one correlation r
    it is (1 + r) / (1 - r). Without events the interval is [0, 1].
    """
    if of <= 0.0:
        return ConfidenceInterval(0.0, 0.0, 1.0)
    ratio, n, z = count / of, max(of / inflation, 1.0), quantile_of_normal(confidence)
    centre = (ratio + z * z / (2.0 * n)) / (1.0 + z * z / n)
    half = z / (1.0 + z * z / n) * sqrt(ratio * (1.0 - ratio) / n + z * z / (4.0 * n * n))
    return ConfidenceInterval(ratio, max(0.0, centre - half), min(1.0, centre + half))


def inflation(loss_ratio: float, burst: float) -> float:
    """Variance of a loss share with bursts, relative to that of independent losses; at least 1.

    In the two-state chain (Gilbert) with this share and mean burst length the lag-one correlation
    is r = 1 - 1/burst - loss/(burst (1 - loss)), and the factor is (1 + r) / (1 - r).
    """
    if not 0.0 < loss_ratio < 1.0 or burst <= 1.0:
        return 1.0
    correlation = 1.0 - 1.0 / burst - loss_ratio / (burst * (1.0 - loss_ratio))
    return max(1.0, (1.0 + correlation) / (1.0 - correlation)) if correlation < 1.0 else 1.0


def bursts(lost: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Lengths of the runs of losses, in the order of message numbers."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], lost, [False])).astype(np.int8)))
    lengths: NDArray[np.int_] = edges[1::2] - edges[::2]
    return lengths


def mean_length(lengths: NDArray[np.int_], confidence: float) -> ConfidenceInterval | None:
    """Mean of lengths with its interval, None without any; a single one has no upper bound.

    The standard error of the mean b of m geometric lengths is sqrt(b (b - 1) / m), or that of the
    sample where it is larger.
    """
    count = len(lengths)
    if not count:
        return None
    each = lengths.tolist()
    first, second = sum(each), sum(length * length for length in each)
    mean = first / count
    scatter = (count * second - first * first) / (count * (count - 1)) if count > 1 else 0.0
    spread = sqrt(max(scatter, mean * (mean - 1.0))) / sqrt(count)
    half = quantile_of_normal(confidence) * spread
    return ConfidenceInterval(
        mean, max(1.0, mean - half), mean + half if count > 1 else float("inf")
    )


@dataclass(frozen=True, slots=True)
class Spread:
    mean: float
    deviation: float
    p95: float
    largest: float
    count: int


def spread(histogram: Mapping[int, int], unit: float) -> Spread | None:
    """Figures of values counted as multiples of `unit`, None without any.

    The quantile is the smallest value that at least 95 % do not exceed.
    """
    if not histogram:
        return None
    # In whole numbers, so that the figures are the same on every machine.
    total = sum(histogram.values())
    first = sum(count * value for value, count in histogram.items())
    second = sum(count * value * value for value, count in histogram.items())
    ordered, below = sorted(histogram), 0
    p95 = ordered[-1]
    for value in ordered:
        below += histogram[value]
        if below >= 0.95 * total:
            p95 = value
            break
    return Spread(
        first / total * unit,
        sqrt((total * second - first * first) / (total * total)) * unit,
        p95 * unit,
        ordered[-1] * unit,
        total,
    )
