"""Fates of the messages on each directed link of a recorded run, as arrays."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenarios.results.links import CONFIDENCE, quantile_of_normal
from scenarios.results.log_summary import tables_of
from scenarios.results.tables import RunTables
from transport.log.reader import LogReader
from vehicles.schedule import MILLISECOND, SECOND


@dataclass(frozen=True, slots=True)
class Estimate:
    """Estimated value of a link's key, its standard error, and its 95 % interval."""

    key: str
    value: float
    error: float
    low: float
    high: float

    @classmethod
    def normal(
        cls, key: str, value: float, error: float, least: float = 0.0, most: float = float("inf")
    ) -> "Estimate":
        """Build an estimate with a normal interval, clipped to the key's range."""
        half = quantile_of_normal(CONFIDENCE) * error
        return cls(key, value, error, max(least, value - half), min(most, value + half))

    def __str__(self) -> str:
        return f"{self.key} {self.value:.4g} ({self.low:.4g} to {self.high:.4g})"


Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


FittedKeys = tuple[dict[str, Any], list["Estimate"], list[str]]
"""Keys of a link, their estimates, and notes on what the log leaves open."""


def rounded(value: float) -> float:
    return float(f"{max(value, 0.0):.6g}")


@dataclass(frozen=True, slots=True)
class RecordedLink:
    """The messages with a verdict on one link, ordered by number.

    `sent_at_s` counts from the start. `delay_ms` is the delay a message had, or would have had.
    `distance_m` is the true distance at the time of sending. `reason` is empty for delivered
    messages.
    """

    sender: str
    receiver: str
    number: NDArray[np.int64]
    sent_at_s: Floats
    delay_ms: Floats
    distance_m: Floats
    reason: NDArray[np.str_]

    @property
    def period_s(self) -> float:
        """Median time between two successive messages; 0 if there are none."""
        steps = np.diff(self.number)
        return float(np.median(np.diff(self.sent_at_s)[steps == 1])) if (steps == 1).any() else 0.0

    @property
    def delivered(self) -> Flags:
        delivered: Flags = self.reason == ""
        return delivered


def recorded_links(log: Path) -> tuple[RecordedLink, ...]:
    """Read the links of the run in `log`, without links that have no verdict; raises LogError."""
    LogReader(log).require_all("verdict", "truth")
    run = tables_of(log)
    links = (_link(run, sender, receiver) for sender, receiver in run.scenario.links)
    return tuple(link for link in links if len(link.number))


def _link(run: RunTables, sender: str, receiver: str) -> RecordedLink:
    verdicts = run.table(receiver, "verdict")
    verdicts = verdicts.of(verdicts["sender"] == sender)
    _, rows = np.unique(verdicts["pose_seq"], return_index=True)
    verdicts = verdicts.of(rows)
    poses, truth = run.table(sender, "gps"), run.table(receiver, "truth")
    distance = np.full(len(verdicts), np.nan)
    if len(truth) and len(poses):
        last = np.searchsorted(truth.at_ns, verdicts["sent_at_ns"], side="right") - 1
        own = np.maximum(last, 0)
        sent = np.minimum(np.searchsorted(poses["seq"], verdicts["pose_seq"]), len(poses) - 1)
        distance = np.hypot(
            poses["true_east_m"][sent] - truth["east_m"][own],
            poses["true_north_m"][sent] - truth["north_m"][own],
        )
        distance[poses["seq"][sent] != verdicts["pose_seq"]] = np.nan
    return RecordedLink(
        sender=sender,
        receiver=receiver,
        number=verdicts["pose_seq"],
        sent_at_s=(verdicts["sent_at_ns"] - run.beginning) / SECOND,
        delay_ms=(verdicts["visible_at_ns"] - verdicts["sent_at_ns"]) / MILLISECOND,
        distance_m=distance,
        reason=verdicts["reason"].astype(np.str_),
    )
