"""Fates of the messages on each directed link of a recorded run, as arrays."""

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenarios.results.links import CONFIDENCE, quantile_of_normal
from scenarios.results.log_summary import scenario_in
from transport.log.reader import LogReader
from vehicles.messages import GpsPose, LinkVerdict, RunStart, TruePose
from vehicles.schedule import MILLISECOND, SECOND

# ---- An estimated parameter of a law


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


# ---- Recorded


Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RecordedLink:
    """The messages with a verdict on one link, ordered by number.

    `sent_at_s` counts from the start. `delay_ms` is the delay a message had, or would have had.
    `distance_m` is the true distance at the time of sending; `driven_m` is the distance driven by
    the receiver until then, if known. `reason` is empty for delivered messages.
    """

    sender: str
    receiver: str
    number: NDArray[np.int64]
    sent_at_s: Floats
    delay_ms: Floats
    distance_m: Floats
    reason: NDArray[np.str_]
    driven_m: Floats | None = None

    @property
    def period_s(self) -> float:
        """Median time between two successive messages; 0 if there are none."""
        steps = np.diff(self.number)
        return float(np.median(np.diff(self.sent_at_s)[steps == 1])) if (steps == 1).any() else 0.0

    @property
    def delivered(self) -> NDArray[np.bool_]:
        delivered: NDArray[np.bool_] = self.reason == ""
        return delivered


def recorded_links(log: Path) -> tuple[RecordedLink, ...]:
    """Read the links of the run in `log`, without links that have no verdict; raises LogError."""
    reader = LogReader(log)
    reader.require_all("verdict", "truth")
    scenario = scenario_in(reader)
    start_at = 0
    verdicts: defaultdict[tuple[str, str], dict[int, LinkVerdict]] = defaultdict(dict)
    senders: defaultdict[str, dict[int, tuple[float, float]]] = defaultdict(dict)
    places: defaultdict[str, list[TruePose]] = defaultdict(list)
    for _, source, message in reader.messages(("gps", "verdict", "truth", "start")):
        match message:
            case RunStart():
                start_at = message.start_at_ns
            case GpsPose():
                senders[source][message.seq] = message.true_east_m, message.true_north_m
            case LinkVerdict():
                verdicts[message.sender, source][message.pose_seq] = message
            case TruePose():
                places[source].append(message)
    return tuple(
        _link(pair, start_at, list(verdicts[pair].values()), senders[pair[0]], places[pair[1]])
        for pair in scenario.links
        if verdicts[pair]
    )


def _link(
    pair: tuple[str, str],
    start_at: int,
    verdicts: list[LinkVerdict],
    sender_at: dict[int, tuple[float, float]],
    receiver_at: list[TruePose],
) -> RecordedLink:
    verdicts.sort(key=lambda verdict: verdict.pose_seq)
    sent_at = np.array([verdict.sent_at_ns for verdict in verdicts])
    unknown = (np.nan, np.nan)
    receiver = _receiver_poses_at(sent_at, receiver_at)
    sender = np.array([sender_at.get(verdict.pose_seq, unknown) for verdict in verdicts])
    delays = [verdict.visible_at_ns - verdict.sent_at_ns for verdict in verdicts]
    return RecordedLink(
        sender=pair[0],
        receiver=pair[1],
        number=np.array([verdict.pose_seq for verdict in verdicts]),
        sent_at_s=(sent_at - start_at) / SECOND,
        delay_ms=np.array(delays) / MILLISECOND,
        distance_m=np.hypot(*(sender - receiver[:, :2]).T),
        reason=np.array([verdict.reason for verdict in verdicts], dtype=np.str_),
        driven_m=receiver[:, 2] if receiver_at else None,
    )


def _receiver_poses_at(instants: NDArray[np.int64], places: list[TruePose]) -> Floats:
    """East, north and distance driven of the last true pose before each instant, (n, 3)."""
    if not places:
        return np.full((len(instants), 3), np.nan)
    table = np.array([(pose.east_m, pose.north_m, pose.distance_m) for pose in places])
    before = np.searchsorted([pose.true_at_ns for pose in places], instants, side="right") - 1
    receiver: Floats = table[np.maximum(before, 0)]
    return receiver
