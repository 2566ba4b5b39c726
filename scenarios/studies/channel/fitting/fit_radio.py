"""Deliveries of a link over distance: a table, alone or by reservations, or shadowing.

Losses of a radio are distinguished by the correlation of two messages' fates. Independent losses
have none. Messages of one reservation share their fate, so the correlation approaches 1 as they
come closer. In shadowing each message has a chance of its own, so it does not.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenarios.results.channel.estimates import CONFIDENCE, share
from scenarios.studies.channel.fitting.estimate import Estimate
from scenarios.studies.channel.fitting.fit_shadowing import SHADOWING_NOTE, fit_shadowing
from scenarios.studies.channel.fitting.recorded import RecordedLink

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
FittedKeys = tuple[dict[str, Any], list[Estimate], list[str]]

MIN_PER_BIN = 200
"""Least number of messages to estimate a share of deliveries at a distance from."""
MIN_BIN_M = 2.0
"""Distances that differ by less are the same."""
MAX_BINS = 40
SIGNIFICANT_ERRORS = 4.0
"""Standard errors from which a correlation is there."""
SHARED_FATE_CORRELATION = 0.88
"""A correlation of messages next to one another above which they share one fate."""
MIN_LOSSES = 100
"""Least number of losses to fit shadowing from."""
MIN_RESERVATIONS = 15
"""In each stretch of distances."""
MAX_LAGS = 200
STANDARD_LENGTHS = ((1, 3), (2, 6), (5, 15), (10, 30), (25, 75))
"""Messages of a reservation at least and at most (3GPP TS 36.321: 5 to 15 at 10 Hz, and so on)."""
FEW_LOSSES_NOTE = "losses waver, but are too few to tell by what law: given as a table with bursts"
RESERVATION_NOTE = "the mean reservation is told, its limits and what is kept of it hardly"


@dataclass(frozen=True)
class RadioFates:
    """The messages that a link's radio judged, in order: numbers, distances (m), fates."""

    number: NDArray[np.int64]
    distance_m: Floats
    lost: Flags
    min_per_bin: int = MIN_PER_BIN

    @cached_property
    def bins(self) -> tuple[NDArray[np.intp], ...]:
        """Messages by stretches of distance: equally many in each, none too narrow."""
        ordered = np.argsort(self.distance_m, kind="stable")
        wide = float(self.distance_m[ordered[-1]] - self.distance_m[ordered[0]])
        bins = max(1, min(MAX_BINS, len(ordered) // self.min_per_bin, int(wide / MIN_BIN_M)))
        return tuple(np.sort(part) for part in np.array_split(ordered, bins))

    @cached_property
    def bin_distance_m(self) -> Floats:
        return np.array([float(self.distance_m[one].mean()) for one in self.bins])

    @cached_property
    def delivery_ratios(self) -> Floats:
        return np.array([1.0 - float(self.lost[one].mean()) for one in self.bins])

    @cached_property
    def expected_loss(self) -> Floats:
        """Loss probability of each message, by the table."""
        found: Floats = 1.0 - np.interp(self.distance_m, self.bin_distance_m, self.delivery_ratios)
        return found

    def pairs(self, lag: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Indices of messages `lag` numbers apart."""
        later = np.searchsorted(self.number, self.number + lag)
        there = later < len(self.number)
        there[there] = self.number[later[there]] == self.number[there] + lag
        first: NDArray[np.intp] = np.flatnonzero(there)
        return first, later[first]

    @cached_property
    def correlations(self) -> Floats:
        """Correlation of the fates of messages at lags from 1 on, beyond that by distance."""
        chance = self.expected_loss
        beyond, spread = self.lost - chance, np.sqrt(chance * (1.0 - chance))
        found = []
        for lag in range(1, MAX_LAGS + 1):
            one, other = self.pairs(lag)
            scale = float(spread[one] @ spread[other])
            found.append(float(beyond[one] @ beyond[other]) / scale if scale else 0.0)
        return np.array(found)


def fit_radio(link: RecordedLink, judged: Flags, lost: Flags) -> FittedKeys:
    """Find the radio of a link from the messages that it judged."""
    judged = judged & np.isfinite(link.distance_m)
    if not (lost & judged).any():
        return {}, [], []
    fates = RadioFates(link.number[judged], link.distance_m[judged], lost[judged])
    close = fates.correlations[:2]
    error = 1.0 / sqrt(max(float((fates.expected_loss > 0.0).sum()), 1.0))
    if close[0] < SIGNIFICANT_ERRORS * error:
        return _table(fates, {}, np.zeros(0))
    if 2.0 * close[0] - close[1] > SHARED_FATE_CORRELATION:
        return _reservations(fates)
    if link.driven_m is None or int(fates.lost.sum()) < MIN_LOSSES:
        table, estimates, _ = _reservations(fates)
        return table, estimates, [FEW_LOSSES_NOTE]
    found = fit_shadowing(fates.distance_m, link.driven_m[judged], fates.lost, fates.pairs)
    return _reservations(fates) if found is None else (*found, [SHADOWING_NOTE])


def _reservations(fates: RadioFates) -> FittedKeys:
    """A table, with losses of whole reservations."""
    mean, error = _mean_reservation(fates)
    coarse = max(MIN_PER_BIN, round(MIN_RESERVATIONS * mean))
    fates = replace(fates, min_per_bin=coarse)
    mean, error = _mean_reservation(fates)
    least, most, kept, shared = _lengths(mean, fates.correlations)
    keys = {
        "burst": "reservation",
        "keep_ratio": round(kept, 3),
        "reselection_messages_min": least,
        "reselection_messages_max": most,
    }
    table, estimates, notes = _table(fates, keys, shared)
    reservation = Estimate.normal("radio, messages of a reservation", mean, error, 1.0)
    return table, [reservation, *estimates], [*notes, RESERVATION_NOTE]


def _mean_reservation(fates: RadioFates) -> tuple[float, float]:
    """Mean number of messages for which resources are held, and its standard error.

    New ones are selected with the chance h before a message; then it is lost as by the table, else
    like the one before it, unless the distance has changed that. The mean is 1 / h.
    """
    one, other = fates.pairs(1)
    chance, lost = fates.expected_loss, fates.lost
    moved = float(np.abs(chance[other] - chance[one]).sum())
    changes = max(float((lost[one] != lost[other]).sum()) - moved, 1.0)
    possible = float(np.where(lost[one], 1.0 - chance[other], chance[other]).sum())
    mean = max(possible / changes, 1.0)
    return mean, mean / sqrt(changes)


def _lengths(mean: float, correlations: Floats) -> tuple[int, int, float, Floats]:
    """The usual lengths, and the share kept on, that fit the correlations best at this mean."""
    lags = min(len(correlations), max(4, round(2.0 * mean)))
    usual = [pair for pair in STANDARD_LENGTHS if sum(pair) / 2.0 <= mean * 1.15] or [(1, 1)]
    best: tuple[float, int, int, float, Floats] | None = None
    for least, most in usual:
        kept = min(max(1.0 - 0.5 * (least + most) / mean, 0.0), 0.99)
        shared = _shared_reservation(least, most, kept, len(correlations))
        miss = float(((shared - correlations)[:lags] ** 2).sum())
        if best is None or miss < best[0]:
            best = miss, least, most, kept, shared
    assert best is not None  # noqa: S101 - there is one candidate at least
    return best[1:]


def _shared_reservation(least: int, most: int, kept: float, lags: int) -> Floats:
    """Probability that two messages have the same resources, by the lag between them from 1 on."""
    length = np.zeros(most)
    length[least - 1 :] = 1.0 / (most - least + 1)  # of 1 to `most` messages
    left = np.cumsum(length[::-1])[::-1] / (length @ np.arange(1, most + 1))
    found = []
    for _ in range(lags):
        over = left[0]
        left = np.append(left[1:], 0.0) + over * kept * length
        found.append(float(left.sum()))
    return np.array(found)


def _table(fates: RadioFates, keys: dict[str, Any], shared: Floats) -> FittedKeys:
    """Deliveries over distance, a row for each stretch; `held` correlates messages by their lag."""
    estimates = []
    for at, ratio, chosen in zip(
        fates.bin_distance_m, fates.delivery_ratios, fates.bins, strict=True
    ):
        count, variance_ratio = len(chosen), _variance_ratio(fates.number[chosen], shared)
        interval = share(ratio * count, count, CONFIDENCE, variance_ratio)
        alone = (
            count / variance_ratio
        )  # independent messages; one more of each kind, against 0 and 1
        likely = (ratio * alone + 1.0) / (alone + 2.0)
        error = sqrt(likely * (1.0 - likely) / alone)
        key = f"radio.delivery_ratio at {at:.1f} m"
        estimates.append(Estimate(key, float(ratio), error, interval.low, interval.high))
    distances = [round(at, 3) for at in fates.bin_distance_m.tolist()]
    delivery_ratios = [round(ratio, 4) for ratio in fates.delivery_ratios.tolist()]
    table = {
        "kind": "table",
        # Beyond its last row nothing is delivered, so that is held on to the farthest message.
        "distance_m": [*distances, round(float(fates.distance_m.max()) + MIN_BIN_M, 3)],
        "delivery_ratio": [*delivery_ratios, delivery_ratios[-1]],
        **keys,
    }
    return {"radio": table}, estimates, []


def _variance_ratio(number: NDArray[np.int64], shared: Floats) -> float:
    """Ratio of the variance of a share to that of independent messages."""
    there = np.zeros(int(number[-1] - number[0]) + 1, dtype=np.bool_)
    there[number - number[0]] = True
    lags = range(1, min(len(shared), len(there) - 1) + 1)
    pairs = [float((there[:-lag] & there[lag:]).sum()) for lag in lags]
    return 1.0 + 2.0 * float(np.dot(pairs, shared[: len(pairs)])) / len(number)
