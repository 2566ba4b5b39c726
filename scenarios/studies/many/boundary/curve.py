"""Posterior of an S-shaped curve: the share of runs that break a limit over the value of a key.

The share at a value x is

    p(x) = G(G⁻¹(share) ± (x - boundary) / width),

so that the requested share is reached at `boundary`. G is the logistic function, the complementary
log-log function, or its mirror image. The prior is uniform in the three functions, both directions,
the boundary (half a range beyond both ends) and the logarithm of the width. Where the requested
share is rare, the tails of the three differ: the posterior averages over them.

Kuss, Jäkel and Wichmann, Bayesian inference for psychometric functions, Journal of Vision 5, 2005.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log, log1p
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Shape = Literal["logistic", "cloglog", "loglog"]
SHAPES: tuple[Shape, ...] = get_args(Shape)
NODES, WIDTHS = 41, 17
"""Nodes of the grid over the boundary and over the logarithm of the width."""
BEYOND = 0.5
"""Part of the range by which the prior of the boundary exceeds both ends."""
WIDEST = 0.5
"""Largest width, as a part of the range."""
PASSES = 5
"""Evaluations at most; each one confines the grid to the nodes that matter."""
NEGLIGIBLE = 1e-4
"""Marginal probability of a node, relative to the largest, below which the grid may end."""
STEEPEST = 40.0
"""Bound on the argument of exponentials."""


@dataclass(frozen=True, slots=True)
class RunCounts:
    """Numbers of runs and of broken runs (n) at values (n)."""

    values: Floats
    runs: Floats
    broken: Floats


@dataclass(frozen=True, slots=True)
class ShareModel:
    """Shape and direction (rising 1, falling -1), with weights (m, w) of boundaries and widths."""

    shape: Shape
    direction: int
    weights: Floats


@dataclass(frozen=True, slots=True)
class ShareCurve:
    """Posterior over `boundaries` (m) and `widths` (w), both in the unit of the values.

    `held` and `broken` are the probabilities that the share is below, or above, the requested one
    everywhere in the range.
    """

    share: float
    boundaries: Floats
    widths: Floats
    models: tuple[ShareModel, ...]
    held: float
    broken: float

    def quantile(self, probability: float) -> float:
        weights = np.sum([model.weights.sum(axis=1) for model in self.models], axis=0)
        steps = 0.5 * (weights[1:] + weights[:-1])
        cumulative = np.concatenate(([0.0], np.cumsum(steps))) / steps.sum()
        return float(np.interp(probability, cumulative, self.boundaries))

    def shares_at(self, values: Sequence[float] | Floats) -> Floats:
        """Mean share of broken runs at the values (n)."""
        distance = _distance(np.asarray(values, dtype=float), self.boundaries, self.widths)
        shares = np.zeros(len(values))
        for model in self.models:
            log_broken, _ = _log_shares(model.shape, model.direction, self.share, distance)
            shares += np.tensordot(np.exp(log_broken), model.weights, 2)
        return shares

    @property
    def rises(self) -> bool:
        rising = sum(float(model.weights.sum()) for model in self.models if model.direction > 0)
        return rising >= 0.5


def fit_curve(
    counts: RunCounts, share: float, span: tuple[float, float], narrowest: float
) -> ShareCurve:
    """Fit counts of runs; `span` is the range of the search.

    `narrowest` is the smallest width of the prior.
    """
    low, high = span
    extent = high - low
    nodes = low - BEYOND * extent, high + BEYOND * extent
    scales = log(narrowest), log(WIDEST * extent)
    directions: Sequence[int] = (1, -1)
    for _ in range(PASSES):
        boundaries = np.linspace(*nodes, NODES)
        widths = np.exp(np.linspace(*scales, WIDTHS))
        models = _weighted(counts, share, boundaries, widths, directions)
        joint = np.sum([model.weights for model in models], axis=0)
        directions = sorted({m.direction for m in models if m.weights.sum() > NEGLIGIBLE**2})
        narrower = _support(boundaries, joint.sum(axis=1))
        scales = _support(np.log(widths), joint.sum(axis=0))
        if narrower[1] - narrower[0] > 0.6 * (nodes[1] - nodes[0]):
            break
        nodes = narrower
    beyond = {1: boundaries > high, -1: boundaries < low}
    before = {1: boundaries < low, -1: boundaries > high}
    return ShareCurve(
        share=share,
        boundaries=boundaries,
        widths=widths,
        models=models,
        held=float(sum(m.weights[beyond[m.direction]].sum() for m in models)),
        broken=float(sum(m.weights[before[m.direction]].sum() for m in models)),
    )


def _weighted(
    counts: RunCounts,
    share: float,
    boundaries: Floats,
    widths: Floats,
    directions: Sequence[int],
) -> tuple[ShareModel, ...]:
    """Return the models with their posterior weights, which sum to 1."""
    distance = _distance(counts.values, boundaries, widths)
    kept = counts.runs - counts.broken
    likelihoods: dict[tuple[Shape, int], Floats] = {}
    for direction in directions:
        for shape in SHAPES:
            log_broken, log_kept = _log_shares(shape, direction, share, distance)
            likelihoods[shape, direction] = np.tensordot(
                counts.broken, log_broken, 1
            ) + np.tensordot(kept, log_kept, 1)
    largest = max(float(one.max()) for one in likelihoods.values())
    weights = {key: np.exp(one - largest) for key, one in likelihoods.items()}
    total = sum(float(one.sum()) for one in weights.values())
    return tuple(ShareModel(*key, one / total) for key, one in weights.items())


def _distance(values: Floats, boundaries: Floats, widths: Floats) -> Floats:
    """Distance of values (n) from boundaries (m) in widths (w), of shape (n, m, w)."""
    distance: Floats = (values[:, None, None] - boundaries[:, None]) / widths
    return distance


def _log_shares(
    shape: Shape, direction: int, share: float, distance: Floats
) -> tuple[Floats, Floats]:
    """Logarithms of the shares of broken and of kept runs at a distance."""
    if shape == "logistic":
        z = log(share / (1.0 - share)) + direction * distance
        log_broken = np.minimum(z, 0.0) - np.log1p(np.exp(-np.abs(z)))
        return log_broken, log_broken - z
    if shape == "cloglog":
        log_kept, log_broken = _double_exponential(log(-log1p(-share)) + direction * distance)
        return log_broken, log_kept
    return _double_exponential(log(-log(share)) - direction * distance)


def _double_exponential(z: Floats) -> tuple[Floats, Floats]:
    """Logarithms of exp(-exp(z)) and of 1 - exp(-exp(z))."""
    hazard = np.exp(np.clip(z, -STEEPEST, STEEPEST))
    return -hazard, np.log(np.maximum(-np.expm1(-hazard), exp(-STEEPEST)))


def _support(nodes: Floats, weights: Floats) -> tuple[float, float]:
    (matter,) = np.nonzero(weights > NEGLIGIBLE * weights.max())
    first, last = max(matter[0] - 1, 0), min(matter[-1] + 1, len(nodes) - 1)
    return float(nodes[first]), float(nodes[last])
