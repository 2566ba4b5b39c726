"""Shadowing of a link from the fates of its messages, as a path-loss law that reproduces them.

Received is Φ(a + b x - c S), with x = -10 log₁₀ of the distance and S a standard normal quantity
over the metres driven by the receiver, of autocorrelation e^(-Δ/D). Over S that is a probit law of
x alone, and the fates of two messages have a normal copula of the correlation v e^(-Δ/D), with
v = c²/(1 + c²): shares over distance determine a and b, pairs of messages c and D.
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

SHADOWING_NOTE = (
    "vehicles in between are in power, exponent and shadowing: fates do not tell them apart"
)
SNR_DB, ERROR_RATIO = (1.0, 3.1), (0.5, 0.1)
"""The first two points of IEEE 802.11p in sight, of one line on probability paper."""
PER_DB = (stats.norm.isf(ERROR_RATIO[1]) - stats.norm.isf(ERROR_RATIO[0])) / (SNR_DB[1] - SNR_DB[0])
LAGS = (1, 2, 3, 5, 8, 12, 17, 25, 40, 60)
BINS = 24
BLOCKS = 16
"""Pieces of the run; each is left out once to estimate the errors (jackknife)."""
MIN_RANGE_DB = 0.5
"""A smaller range of x does not determine the slope."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)


def fit_shadowing(
    distance_m: Floats, driven_m: Floats, lost: Flags, pairs: PairsAt
) -> tuple[dict[str, Any], list[Estimate]] | None:
    """Keys of the link and their estimates; None where nothing was delivered."""
    if lost.all():
        return None
    loss_db = -10.0 * np.log10(np.maximum(distance_m, 1.0))
    counts = _FatesByDistance(loss_db, driven_m, lost, pairs)
    values = counts.fitted(range(BLOCKS))
    left_out = np.array([counts.fitted(set(range(BLOCKS)) - {one}) for one in range(BLOCKS)])
    spread = left_out - left_out.mean(axis=0)
    errors = np.sqrt((BLOCKS - 1) / BLOCKS * (spread**2).sum(axis=0))
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
    """Fates by stretches of distance, and of pairs of messages, for each block of the run."""

    def __init__(self, loss_db: Floats, driven_m: Floats, lost: Flags, pairs: PairsAt) -> None:
        edges = np.quantile(loss_db, np.linspace(0.0, 1.0, BINS + 1))[1:-1]
        place = np.searchsorted(edges, loss_db, side="right")
        block = np.arange(len(lost)) * BLOCKS // len(lost)
        self.is_flat = float(np.ptp(loss_db)) < MIN_RANGE_DB
        self.loss_db = np.bincount(place, loss_db, BINS) / np.maximum(
            np.bincount(place, None, BINS), 1
        )
        self.count = np.zeros((BLOCKS, BINS, 2))
        np.add.at(self.count, (block, place, lost.astype(int)), 1.0)
        self.apart_m = np.zeros(len(LAGS))
        self.pairs = np.zeros((BLOCKS, BINS, len(LAGS), 3))
        for index, lag in enumerate(LAGS):
            one, other = pairs(lag)
            alike = place[one] == place[other]
            one, other = one[alike], other[alike]
            self.apart_m[index] = (
                float(np.median(driven_m[other] - driven_m[one])) if len(one) else 0.0
            )
            fates = lost[one].astype(int) + lost[other].astype(int)
            np.add.at(self.pairs, (block[one], place[one], index, fates), 1.0)

    def fitted(self, blocks: Any) -> tuple[float, float, float, float]:
        """Power (dBm), exponent, deviation (dB) and decorrelation distance (m), of some blocks."""
        chosen = sorted(blocks)
        offset, slope = self._marginal(self.count[chosen].sum(axis=0))
        shared, decorrelation = self._copula(
            offset + slope * self.loss_db, self.pairs[chosen].sum(axis=0)
        )
        rest = sqrt(1.0 - shared)
        usual = PathLossRadio()
        noise = noise_power(usual.bandwidth_hz, usual.noise_figure_db)
        power = usual.reference_loss_db + noise + SNR_DB[0] + offset / (rest * PER_DB)
        exponent = min(max(slope / (rest * PER_DB), 0.5), 10.0)
        return (
            min(max(power, -300.0), 300.0),
            exponent,
            min(sqrt(shared) / rest / PER_DB, 60.0),
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
        found = optimize.minimize(minus_likelihood, start, method="BFGS")
        return float(found.x[0]), max(float(found.x[1]), 1e-3)

    def _copula(self, score: Floats, pairs: Floats) -> tuple[float, float]:
        """Share of the variance that is shadowing, and its decorrelation distance (m)."""
        received = stats.norm.cdf(score)[:, None]

        def minus_likelihood(parameters: Floats) -> float:
            shared, decorrelation = 1.0 / (1.0 + exp(-parameters[0])), exp(parameters[1])
            correlation = shared * np.exp(-self.apart_m / decorrelation)
            both = received**2 + _beyond_independent(score[:, None], correlation[None, :])
            chances = np.stack(
                [both, 2.0 * (received - both), 1.0 - 2.0 * received + both], axis=-1
            )
            return -float((pairs * np.log(np.clip(chances, 1e-12, 1.0))).sum())

        found = optimize.minimize(
            minus_likelihood, np.array([0.0, log(25.0)]), method="Nelder-Mead",
            bounds=((-6.0, 6.0), (0.0, log(10_000.0))), options={"xatol": 1e-3, "fatol": 1e-3},
        )  # fmt: skip
        return 1.0 / (1.0 + exp(-float(found.x[0]))), exp(float(found.x[1]))


def _beyond_independent(score: Floats, correlation: Floats) -> Floats:
    """Chance of two correlated normal numbers both below `score`, less that of independent ones.

    It is the integral of the bivariate density over the correlation (Plackett, Biometrika 41,
    1954), here over its arc sine, where the integrand is smooth up to 1.
    """
    end = np.arcsin(correlation)
    total = np.zeros(np.broadcast_shapes(score.shape, end.shape))
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        angle = 0.5 * end * (1.0 + node)
        total += weight * np.exp(-(score**2) / (1.0 + np.sin(angle)))
    found: Floats = total * 0.5 * end / (2.0 * np.pi)
    return found
