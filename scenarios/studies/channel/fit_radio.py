"""Fit the radio of a link: delivery over distance, per message or reservation, or shadowing.

The correlation between the fates of two messages distinguishes these laws. It is zero for
independent losses. It approaches 1 for neighbouring messages if a reservation shares one fate, and
stays below 1 under shadowing.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import exp, log, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from scenarios.results.link_summary import CONFIDENCE, share
from scenarios.studies.channel.recorded import Estimate, RecordedLink
from transport.links.laws.radio import PathLossRadio, noise_power

# ---- Fit a path-loss law with shadowing to the fates of a link's messages
#
# The delivery probability is Φ(a + b x - c S), with x = -10 log₁₀ of the distance and S standard
# normal over the distance driven by the receiver, with autocorrelation e^(-Δ/D). Averaged over S it
# is a probit law of x. The fates of two messages have a normal copula of correlation v e^(-Δ/D)
# with v = c²/(1 + c²). Delivery over distance determines a and b; pairs of messages determine c and
# D.


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


# ---- Fit radio


FittedKeys = tuple[dict[str, Any], list[Estimate], list[str]]
"""Keys of a link, their estimates, and notes on what the log leaves open."""

MIN_PER_BIN = 200
"""Least number of messages to estimate a delivery ratio from."""
MIN_BIN_M = 2.0
"""Least width of a bin of distances."""
MAX_BINS = 40
SIGNIFICANT_ERRORS = 4.0
"""Standard errors from which a correlation is significant."""
SHARED_FATE_CORRELATION = 0.88
"""Correlation of neighbouring messages above which they share one fate."""
MIN_LOSSES = 100
"""Least number of losses to fit shadowing to."""
MIN_RESERVATIONS = 15
"""Least number of reservations per bin of distances."""
MAX_LAGS = 200
STANDARD_LENGTHS = ((1, 3), (2, 6), (5, 15), (10, 30), (25, 75))
"""Shortest and longest reservation in messages (3GPP TS 36.321: 5 to 15 at 10 Hz, and so on)."""
FEW_LOSSES_NOTE = "correlated losses, too few to identify their law: given as a table with bursts"
RESERVATION_NOTE = "the mean reservation is well determined; its limits and keep_ratio are not"


@dataclass(frozen=True)
class RadioFates:
    """Numbers, distances (m) and fates of the messages that a link's radio judged, in order."""

    number: NDArray[np.int64]
    distance_m: Floats
    lost: Flags
    min_per_bin: int = MIN_PER_BIN

    @cached_property
    def bins(self) -> tuple[NDArray[np.intp], ...]:
        """Indices of the messages in each bin of distances; bins are equally full."""
        ordered = np.argsort(self.distance_m, kind="stable")
        span_m = float(self.distance_m[ordered[-1]] - self.distance_m[ordered[0]])
        count = max(1, min(MAX_BINS, len(ordered) // self.min_per_bin, int(span_m / MIN_BIN_M)))
        return tuple(np.sort(part) for part in np.array_split(ordered, count))

    @cached_property
    def bin_distance_m(self) -> Floats:
        return np.array([float(self.distance_m[indices].mean()) for indices in self.bins])

    @cached_property
    def delivery_ratios(self) -> Floats:
        return np.array([1.0 - float(self.lost[indices].mean()) for indices in self.bins])

    @cached_property
    def expected_loss(self) -> Floats:
        """Loss probability of each message at its distance."""
        loss: Floats = 1.0 - np.interp(self.distance_m, self.bin_distance_m, self.delivery_ratios)
        return loss

    def pairs(self, lag: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        later = np.searchsorted(self.number, self.number + lag)
        exists = later < len(self.number)
        exists[exists] = self.number[later[exists]] == self.number[exists] + lag
        first: NDArray[np.intp] = np.flatnonzero(exists)
        return first, later[first]

    @cached_property
    def correlations(self) -> Floats:
        """Correlation of two fates at lags from 1 on, with the effect of distance removed."""
        chance = self.expected_loss
        residual, deviation = self.lost - chance, np.sqrt(chance * (1.0 - chance))
        correlations = []
        for lag in range(1, MAX_LAGS + 1):
            first, second = self.pairs(lag)
            scale = float(deviation[first] @ deviation[second])
            product = float(residual[first] @ residual[second])
            correlations.append(product / scale if scale else 0.0)
        return np.array(correlations)


def fit_radio(link: RecordedLink, judged: Flags, lost: Flags) -> FittedKeys:
    judged = judged & np.isfinite(link.distance_m)
    if not (lost & judged).any():
        return {}, [], []
    fates = RadioFates(link.number[judged], link.distance_m[judged], lost[judged])
    first, second = fates.correlations[:2].tolist()
    error = 1.0 / sqrt(max(float((fates.expected_loss > 0.0).sum()), 1.0))
    if first < SIGNIFICANT_ERRORS * error:
        return _table(fates, {}, np.zeros(0))
    if 2.0 * first - second > SHARED_FATE_CORRELATION:  # extrapolated to lag 0
        return _reservations(fates)
    if link.driven_m is None or int(fates.lost.sum()) < MIN_LOSSES:
        table, estimates, _ = _reservations(fates)
        return table, estimates, [FEW_LOSSES_NOTE]
    fitted = fit_shadowing(fates.distance_m, link.driven_m[judged], fates.lost, fates.pairs)
    return _reservations(fates) if fitted is None else (*fitted, [SHADOWING_NOTE])


def _reservations(fates: RadioFates) -> FittedKeys:
    """Fit a table in which whole reservations are lost."""
    mean, error = _mean_reservation(fates)
    coarse = max(MIN_PER_BIN, round(MIN_RESERVATIONS * mean))
    fates = replace(fates, min_per_bin=coarse)
    mean, error = _mean_reservation(fates)
    shortest, longest, keep_ratio, shared = _lengths(mean, fates.correlations)
    keys = {
        "burst": "reservation",
        "keep_ratio": round(keep_ratio, 3),
        "reselection_messages_min": shortest,
        "reselection_messages_max": longest,
    }
    table, estimates, notes = _table(fates, keys, shared)
    reservation = Estimate.normal("radio, messages of a reservation", mean, error, 1.0)
    return table, [reservation, *estimates], [*notes, RESERVATION_NOTE]


def _mean_reservation(fates: RadioFates) -> tuple[float, float]:
    """Mean number of messages of a reservation, and its standard error.

    Before each message new resources are selected with probability h. The message is then lost with
    the probability of its distance; otherwise its fate is that of the previous message, apart from
    changes of the distance. The mean is 1 / h.
    """
    first, second = fates.pairs(1)
    chance, lost = fates.expected_loss, fates.lost
    moved = float(np.abs(chance[second] - chance[first]).sum())
    changes = max(float((lost[first] != lost[second]).sum()) - moved, 1.0)
    possible = float(np.where(lost[first], 1.0 - chance[second], chance[second]).sum())
    mean = max(possible / changes, 1.0)
    return mean, mean / sqrt(changes)


def _lengths(mean: float, correlations: Floats) -> tuple[int, int, float, Floats]:
    """Shortest and longest reservation, keep ratio and correlations that fit best at this mean."""
    lags = min(len(correlations), max(4, round(2.0 * mean)))
    candidates = [pair for pair in STANDARD_LENGTHS if sum(pair) / 2.0 <= mean * 1.15] or [(1, 1)]
    best: tuple[float, int, int, float, Floats] | None = None
    for shortest, longest in candidates:
        keep_ratio = min(max(1.0 - 0.5 * (shortest + longest) / mean, 0.0), 0.99)
        shared = _shared_reservation(shortest, longest, keep_ratio, len(correlations))
        error = float(((shared - correlations)[:lags] ** 2).sum())
        if best is None or error < best[0]:
            best = error, shortest, longest, keep_ratio, shared
    assert best is not None  # noqa: S101 - candidates are never empty
    return best[1:]


def _shared_reservation(shortest: int, longest: int, keep_ratio: float, lags: int) -> Floats:
    """Probability that two messages use the same resources, by their lag from 1 on."""
    length = np.zeros(longest)
    length[shortest - 1 :] = 1.0 / (longest - shortest + 1)  # of 1 to `longest` messages
    remaining = np.cumsum(length[::-1])[::-1] / (length @ np.arange(1, longest + 1))
    shared = []
    for _ in range(lags):
        ended = remaining[0]
        remaining = np.append(remaining[1:], 0.0) + ended * keep_ratio * length
        shared.append(float(remaining.sum()))
    return np.array(shared)


def _table(fates: RadioFates, keys: dict[str, Any], shared: Floats) -> FittedKeys:
    """Delivery ratio of each bin; `shared` is the correlation of two messages by lag."""
    estimates = []
    for at, ratio, chosen in zip(
        fates.bin_distance_m, fates.delivery_ratios, fates.bins, strict=True
    ):
        count, variance_ratio = len(chosen), _variance_ratio(fates.number[chosen], shared)
        interval = share(ratio * count, count, CONFIDENCE, variance_ratio)
        independent = count / variance_ratio
        likely = (ratio * independent + 1.0) / (independent + 2.0)  # never exactly 0 or 1
        error = sqrt(likely * (1.0 - likely) / independent)
        key = f"radio.delivery_ratio at {at:.1f} m"
        estimates.append(Estimate(key, float(ratio), error, interval.low, interval.high))
    distances = [round(at, 3) for at in fates.bin_distance_m.tolist()]
    delivery_ratios = [round(ratio, 4) for ratio in fates.delivery_ratios.tolist()]
    table = {
        "kind": "table",
        # A table delivers nothing beyond its last row, so the last row is the farthest message.
        "distance_m": [*distances, round(float(fates.distance_m.max()) + MIN_BIN_M, 3)],
        "delivery_ratio": [*delivery_ratios, delivery_ratios[-1]],
        **keys,
    }
    return {"radio": table}, estimates, []


def _variance_ratio(number: NDArray[np.int64], shared: Floats) -> float:
    """Ratio of the variance of a share to that for independent messages."""
    present = np.zeros(int(number[-1] - number[0]) + 1, dtype=np.bool_)
    present[number - number[0]] = True
    lags = range(1, min(len(shared), len(present) - 1) + 1)
    pairs = [float((present[:-lag] & present[lag:]).sum()) for lag in lags]
    return 1.0 + 2.0 * float(np.dot(pairs, shared[: len(pairs)])) / len(number)
