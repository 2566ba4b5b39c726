"""Fates of the messages of each directed link of a recorded run, as arrays."""

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenarios.results.log_summary import scenario_in
from transport.log.reader import LogReader
from vehicles.messages import GpsPose, LinkVerdict, RunStart, TruePose
from vehicles.schedule import MILLISECOND, SECOND

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RecordedLink:
    """The messages of one link on which it decided, by number.

    `sent_at_s` is from the start, `delay_ms` from sending until it was or would have been there,
    `distance_m` the true one at the sending, `reason` empty for what was delivered. `driven_m` is
    what the receiver had driven by then since the start, if that is known.
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
        """Usual time between two messages that were sent one after the other."""
        steps = np.diff(self.number)
        return float(np.median(np.diff(self.sent_at_s)[steps == 1])) if (steps == 1).any() else 0.0

    @property
    def delivered(self) -> NDArray[np.bool_]:
        """Which messages were delivered."""
        found: NDArray[np.bool_] = self.reason == ""
        return found


def recorded_links(log: Path) -> tuple[RecordedLink, ...]:
    """Read the links of the run in `log`, by receiver from the lead back; raises LogError.

    Links on which nothing was decided are left out.
    """
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
    verdicts.sort(key=lambda one: one.pose_seq)
    sent_at = np.array([one.sent_at_ns for one in verdicts])
    nowhere = (np.nan, np.nan)
    here = _receiver_poses_at(sent_at, receiver_at)
    there = np.array([sender_at.get(one.pose_seq, nowhere) for one in verdicts])
    return RecordedLink(
        sender=pair[0],
        receiver=pair[1],
        number=np.array([one.pose_seq for one in verdicts]),
        sent_at_s=(sent_at - start_at) / SECOND,
        delay_ms=np.array([one.visible_at_ns - one.sent_at_ns for one in verdicts]) / MILLISECOND,
        distance_m=np.hypot(*(there - here[:, :2]).T),
        reason=np.array([one.reason for one in verdicts], dtype=np.str_),
        driven_m=here[:, 2] if receiver_at else None,
    )


def _receiver_poses_at(instants: NDArray[np.int64], places: list[TruePose]) -> Floats:
    """East, north and metres driven of the receiver at its last true pose until each instant."""
    if not places:
        return np.full((len(instants), 3), np.nan)
    table = np.array([(one.east_m, one.north_m, one.distance_m) for one in places])
    before = np.searchsorted([one.true_at_ns for one in places], instants, side="right") - 1
    found: Floats = table[np.maximum(before, 0)]
    return found
