"""Fit a path-loss law with shadowing to the fates of a link's messages.

The delivery probability is Φ(a + b x - c S), with x = -10 log₁₀ of the distance and S standard
normal over the distance driven by the receiver, with autocorrelation e^(-Δ/D). Averaged over S it
is a probit law of x. The fates of two messages have a normal copula of correlation v e^(-Δ/D) with
v = c²/(1 + c²). Delivery over distance determines a and b; pairs of messages determine c and D.
"""

from collections.abc import Callable
from math import exp, log, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from scenarios.studies.channel.fitting.estimate import Estimate
from transport.links.laws.radio.path_loss import PathLossRadio, noise_power

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
PairsAt = Callable[[int], tuple[NDArray[np.intp], NDArray[np.intp]]]

SHADOWING_NOTE = "power, exponent and shadowing include the effect of vehicles in between"
SNR_DB, ERROR_RATIO = (1.0, 3.1), (0.5, 0.1)
"""Line-of-sight error curve of IEEE 802.11p: two points, a line on probability paper."""
PER_DB = (stats.norm.isf(ERROR_RATIO[1]) - stats.norm.isf(ERROR_RATIO[0])) / (SNR_DB[1] - SNR_DB[0])
LAGS = (1, 2, 3, 5, 8, 12, 17, 25, 40, 60)
BINS = 24
BLOCKS = 16
"""Number of parts of the run, each left out once to estimate the errors (jackknife)."""
MIN_RANGE_DB = 0.5
"""Least range of x that determines the slope."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)


def fit_shadowing(
    distance_m: Floats, driven_m: Floats, lost: Flags, pairs: PairsAt
) -> tuple[dict[str, Any], list[Estimate]] | None:
    """Fit keys of the link and their estimates; None if nothing was delivered."""
    if lost.all():
        return None
    loss_db = -10.0 * np.log10(np.maximum(distance_m, 1.0))
    counts = _FatesByDistance(loss_db, driven_m, lost, pairs)
    values = counts.fitted(range(BLOCKS))
    jackknife = np.array([counts.fitted(set(range(BLOCKS)) - {block}) for block in range(BLOCKS)])
    deviations = jackknife - jackknife.mean(axis=0)
    errors = np.sqrt((BLOCKS - 1) / BLOCKS * (deviations**2).sum(axis=0))
    names = ("power_dbm", "exponent", "shadowing.deviation_db", "shadowing.decorrelation_m")
    floors = (-300.0, 0.5, 0.0, 1.0)
    estimates = [
        Estimate.normal(f"radio.{name}", value, error, floor)
        for name, value, error, floor in zip(names, values, errors.tolist(), floors, strict=True)
    ]
    power, exponent, deviation, decorrelation = (float(f"{value:.5g}") for value in values)
    table = {
        "kind": "path_loss",
        "power_dbm": power,
        "propagation": "log_distance",
        "exponent": exponent,
        "errors": {"snr_db": list(SNR_DB), "error_ratio": list(ERROR_RATIO)},
        "shadowing": {"deviation_db": deviation, "decorrelation_m": decorrelation},
    }
    return {"radio": table}, estimates


class _FatesByDistance:
    """Counts of fates, and of fates of message pairs, by block of the run and bin of distance."""

    def __init__(self, loss_db: Floats, driven_m: Floats, lost: Flags, pairs: PairsAt) -> None:
        edges = np.quantile(loss_db, np.linspace(0.0, 1.0, BINS + 1))[1:-1]
        bin_of = np.searchsorted(edges, loss_db, side="right")
        block = np.arange(len(lost)) * BLOCKS // len(lost)
        self.is_flat = float(np.ptp(loss_db)) < MIN_RANGE_DB
        self.loss_db = np.bincount(bin_of, loss_db, BINS) / np.maximum(
            np.bincount(bin_of, None, BINS), 1
        )
        self.count = np.zeros((BLOCKS, BINS, 2))
        np.add.at(self.count, (block, bin_of, lost.astype(int)), 1.0)
        self.lag_m = np.zeros(len(LAGS))
        self.pairs = np.zeros((BLOCKS, BINS, len(LAGS), 3))
        for index, lag in enumerate(LAGS):
            first, second = pairs(lag)
            same_bin = bin_of[first] == bin_of[second]
            first, second = first[same_bin], second[same_bin]
            self.lag_m[index] = (
                float(np.median(driven_m[second] - driven_m[first])) if len(first) else 0.0
            )
            losses = lost[first].astype(int) + lost[second].astype(int)
            np.add.at(self.pairs, (block[first], bin_of[first], index, losses), 1.0)

    def fitted(self, blocks: Any) -> tuple[float, float, float, float]:
        """Power (dBm), exponent, deviation (dB) and decorrelation distance (m) of these blocks."""
        chosen = sorted(blocks)
        offset, slope = self._marginal(self.count[chosen].sum(axis=0))
        shared, decorrelation = self._copula(
            offset + slope * self.loss_db, self.pairs[chosen].sum(axis=0)
        )
        unshared = sqrt(1.0 - shared)
        default = PathLossRadio()
        noise = noise_power(default.bandwidth_hz, default.noise_figure_db)
        power = default.reference_loss_db + noise + SNR_DB[0] + offset / (unshared * PER_DB)
        exponent = min(max(slope / (unshared * PER_DB), 0.5), 10.0)
        return (
            min(max(power, -300.0), 300.0),
            exponent,
            min(sqrt(shared) / unshared / PER_DB, 60.0),
            decorrelation,
        )

    def _marginal(self, count: Floats) -> tuple[float, float]:
        """Offset and slope of the probit law over x, by maximum likelihood."""

        def minus_likelihood(parameters: Floats) -> float:
            score = parameters[0] + parameters[1] * self.loss_db
            return -float(
                count[:, 0] @ stats.norm.logcdf(score) + count[:, 1] @ stats.norm.logsf(score)
            )

        share = (count[:, 0].sum() + 0.5) / (count.sum() + 1.0)
        level = float(stats.norm.ppf(share))
        if self.is_flat:
            slope = 2.0 * PER_DB
            return level - slope * float(self.loss_db.mean()), slope
        start = np.array([level - 0.1 * float(self.loss_db.mean()), 0.1])
        optimum = optimize.minimize(minus_likelihood, start, method="BFGS")
        return float(optimum.x[0]), max(float(optimum.x[1]), 1e-3)

    def _copula(self, score: Floats, pairs: Floats) -> tuple[float, float]:
        """Share of the variance due to shadowing, and its decorrelation distance (m)."""
        received = stats.norm.cdf(score)[:, None]

        def minus_likelihood(parameters: Floats) -> float:
            shared, decorrelation = 1.0 / (1.0 + exp(-parameters[0])), exp(parameters[1])
            correlation = shared * np.exp(-self.lag_m / decorrelation)
            both = received**2 + _beyond_independent(score[:, None], correlation[None, :])
            chances = np.stack(
                [both, 2.0 * (received - both), 1.0 - 2.0 * received + both], axis=-1
            )
            return -float((pairs * np.log(np.clip(chances, 1e-12, 1.0))).sum())

        optimum = optimize.minimize(
            minus_likelihood, np.array([0.0, log(25.0)]), method="Nelder-Mead",
            bounds=((-6.0, 6.0), (0.0, log(10_000.0))), options={"xatol": 1e-3, "fatol": 1e-3},
        )  # fmt: skip
        return 1.0 / (1.0 + exp(-float(optimum.x[0]))), exp(float(optimum.x[1]))


def _beyond_independent(score: Floats, correlation: Floats) -> Floats:
    """Excess probability that two correlated normal numbers are both below `score`.

    The excess over independent numbers is the integral of the bivariate density over the
    correlation (Plackett, Biometrika 41, 1954), here over its arc sine, which is smooth up to 1.
    """
    end = np.arcsin(correlation)
    total = np.zeros(np.broadcast_shapes(score.shape, end.shape))
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        angle = 0.5 * end * (1.0 + node)
        total += weight * np.exp(-(score**2) / (1.0 + np.sin(angle)))
    excess: Floats = total * 0.5 * end / (2.0 * np.pi)
    return excess
