"""Fit the radio of a link: delivery over distance, per message or per reservation.

The correlation between the fates of two messages is zero for independent losses and approaches 1
for neighbouring messages if a reservation shares one fate.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenarios.results.links import CONFIDENCE, share
from scenarios.studies.channel.recorded import Estimate, FittedKeys, Flags, Floats, RecordedLink

MIN_PER_BIN = 200
"""Least number of messages to estimate a delivery ratio from."""
MIN_BIN_M = 2.0
"""Least width of a bin of distances."""
MAX_BINS = 40
SIGNIFICANT_ERRORS = 4.0
"""Standard errors from which a correlation is significant."""
SHARED_FATE_CORRELATION = 0.88
"""Correlation of neighbouring messages above which they share one fate."""
MIN_RESERVATIONS = 15
"""Least number of reservations per bin of distances."""
MAX_LAGS = 200
STANDARD_LENGTHS = ((1, 3), (2, 6), (5, 15), (10, 30), (25, 75))
"""Shortest and longest reservation in messages (3GPP TS 36.321: 5 to 15 at 10 Hz, and so on)."""
CORRELATED_NOTE = "losses correlated as by shadowing: given as a table with bursts"
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
    table, estimates, _ = _reservations(fates)
    return table, estimates, [CORRELATED_NOTE]


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
    fits = []
    for shortest, longest in candidates:
        keep_ratio = min(max(1.0 - 0.5 * (shortest + longest) / mean, 0.0), 0.99)
        shared = _shared_reservation(shortest, longest, keep_ratio, len(correlations))
        fits.append((shortest, longest, keep_ratio, shared))
    return min(fits, key=lambda fit: float(((fit[-1] - correlations)[:lags] ** 2).sum()))


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
