"""A cut of all links in a double lane change, and the figures of its followers."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, takewhile
from math import inf, isnan

import tomli_w

from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.stream import FigureStream
from scenarios.runs.virtual.drive import drive
from vehicles.driver.degradation.settings import Reaction
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import Command, LinkVerdict, Message, Mode, Tracking, TruePose
from vehicles.schedule import SECOND, nanoseconds

LATERAL_ACCELERATION = 1.8
"""Lateral acceleration of the lane changes (m/s²), as in the paper: 500 m at 30 m/s."""
AFTERWARDS_S = 20.0
"""Duration of the run after the cut."""
SETTLED_S = 5.0
"""Time at the speed of the convoy that a follower has to return to the lead's path."""
STANDING = 0.05
"""Speed (m/s) below which a car has stopped."""
RESUMED = 0.5
"""Share of the convoy's speed from which on a car has resumed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkCut:
    """All links of a convoy at `speed_mps` are cut at `at_s` (after the start) for `for_s`."""

    reaction: Reaction
    speed_mps: float
    at_s: float
    for_s: float
    seed: int
    vehicles: int = 3

    def scenario(self) -> Scenario:
        """The double lane change of the paper, with segments of one second at any speed."""
        second, radius = self.speed_mps, self.speed_mps**2 / LATERAL_ACCELERATION
        right = {"length_m": second, "radius_m": radius, "turn": "right"}
        left = right | {"turn": "left"}
        straights = [{"length_m": count * second} for count in (5, 1, 4, 1, 80)]
        change, back = [right, straights[1], left], [left, straights[3], right]
        text = {
            "extends": "lane_change",
            "name": "cut",
            "duration_s": self.at_s + self.for_s + AFTERWARDS_S,
            "seed": self.seed,
            "convoy": {"vehicles": self.vehicles},
            "speed": {"set_mps": self.speed_mps},
            "control": {
                "controller": "slip_compensated",
                "degradation": {"reaction": self.reaction},
            },
            "path": {
                "kind": "segments",
                "segments": [straights[0], *change, straights[2], *back, straights[4]],
            },
            "links": {
                "outages": [{"kind": "window", "from_s": self.at_s, "to_s": self.at_s + self.for_s}]
            },
        }
        return scenario_from_text(tomli_w.dumps(text), label="cut")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeChange:
    """A change of mode at `at_s` after the start."""

    at_s: float
    mode: Mode
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CutFigures:
    """Figures of a follower in a cut (m, s).

    `error` is the largest true error during the cut, `error_on_known_path` before the end of the
    known path, `error_after_recovery` from `SETTLED_S` after the lead's position at the end of the
    cut (0 if not reached). `predicted_blind` is the distance without a known path that the follower
    predicted when it lost its last source, `blind` the distance driven; both are 0 if it can stop
    in time. `ticks_late` counts control periods between the threshold for losing the last source
    and the change of mode. `friction` is the largest share used, `command_step` (rad) the largest
    step of the steering command. `resumed_after` counts from the end of the cut; inf if never.
    """

    cut: LinkCut
    vehicle: str
    error: float
    error_on_known_path: float
    error_after_recovery: float
    predicted_blind: float
    blind: float
    stopped: bool
    ticks_late: int
    friction: float
    command_step: float
    resumed_after: float
    changes: tuple[ModeChange, ...]


@dataclass(slots=True)
class _FollowerRecord:
    """Messages of a follower, and its errors and stations by instant (ns)."""

    truth: list[TruePose] = field(default_factory=list)
    tracking: list[Tracking] = field(default_factory=list)
    steering: list[float] = field(default_factory=list)
    received_at: dict[str, int] = field(default_factory=dict)
    errors: dict[int, float] = field(default_factory=dict)
    stations: dict[int, float] = field(default_factory=dict)


class CutObserver:
    """Observer of a run with a cut that derives the figures of its followers."""

    kinds: frozenset[type[Message]] = frozenset((Command, LinkVerdict, Tracking, TruePose))

    def __init__(self, cut: LinkCut, scenario: Scenario, stream: FigureStream) -> None:
        self._cut = cut
        self._names = scenario.vehicle_names
        self._period = nanoseconds(1.0 / scenario.control_rate_hz)
        self._start = scenario.start_at_ns
        self._from = self._start + nanoseconds(cut.at_s)
        self._to = self._from + nanoseconds(cut.for_s)
        self._reached_from = inf
        degradation = scenario.tables.control.degradation.value
        period = 1.0 / scenario.tables.gnss.value.rate
        self._lost_after = nanoseconds(degradation.lost_after_silence(period))
        self._records: defaultdict[str, _FollowerRecord] = defaultdict(_FollowerRecord)
        stream.on_error(self._record_error)

    def _record_error(self, foot: CrossTrack) -> None:
        self._records[foot.vehicle].errors[foot.at_ns] = foot.lateral
        self._records[foot.vehicle].stations[foot.at_ns] = foot.station

    def listen(self, _at: int, message: Message) -> None:
        record = self._records[message.vehicle]
        match message:
            case TruePose():
                record.truth.append(message)
                if message.vehicle == self._names[0] and message.true_at_ns <= self._to:
                    self._reached_from = message.distance_m + SETTLED_S * self._cut.speed_mps
            case Tracking():
                record.tracking.append(message)
            case Command():
                record.steering.append(message.steering_rad)
            case LinkVerdict() if (
                message.outcome == "delivered" and message.sent_at_ns < self._from
            ):
                record.received_at[message.sender] = message.received_at_ns

    def figures(self) -> tuple[CutFigures, ...]:
        return tuple(self._figures(name) for name in self._names[1:])

    def _figures(self, name: str) -> CutFigures:
        record = self._records[name]
        during = [
            tracking
            for tracking in record.tracking
            if self._from <= tracking.decided_at_ns < self._to
        ]
        lost = next((tracking for tracking in during if tracking.mode in {"coast", "stop"}), None)
        return CutFigures(
            cut=self._cut,
            vehicle=name,
            error=_largest(record.errors.get(row.decided_at_ns, 0.0) for row in during),
            error_on_known_path=_largest(
                record.errors.get(row.decided_at_ns, 0.0)
                for row in takewhile(lambda row: not row.known_m < 0.0, during)
            ),
            error_after_recovery=_largest(
                error
                for at, error in record.errors.items()
                if record.stations[at] > self._reached_from
            ),
            predicted_blind=lost.blind_m if lost else 0.0,
            blind=max([0.0, *(-row.known_m for row in during if not isnan(row.known_m))]),
            stopped=any(
                pose.speed_mps < STANDING
                for pose in record.truth
                if self._from <= pose.true_at_ns < self._to
            ),
            ticks_late=self._ticks_late(record, lost),
            friction=max(pose.friction_ratio for pose in record.truth),
            command_step=_largest(b - a for a, b in pairwise([0.0, *record.steering])),
            resumed_after=self._resumed_after(record),
            changes=tuple(self._changes(record.tracking)),
        )

    def _ticks_late(self, record: _FollowerRecord, lost: Tracking | None) -> int:
        """Count control periods between the threshold and the change of mode."""
        if lost is None or not record.received_at:
            return 0
        threshold = max(record.received_at.values()) + self._lost_after
        return (lost.decided_at_ns - threshold) // self._period

    def _resumed_after(self, record: _FollowerRecord) -> float:
        speeds = {pose.true_at_ns: pose.speed_mps for pose in record.truth}
        resumed = RESUMED * self._cut.speed_mps
        instants = (
            row.decided_at_ns
            for row in record.tracking
            if row.decided_at_ns >= self._to and row.mode not in {"coast", "stop", "straight"}
        )
        at = next((at for at in instants if speeds.get(at, 0.0) >= resumed), None)
        return inf if at is None else (at - self._to) / SECOND

    def _changes(self, tracking: Sequence[Tracking]) -> list[ModeChange]:
        changes = []
        for before, after in pairwise(tracking):
            if after.mode != before.mode:
                at_s = (after.decided_at_ns - self._start) / SECOND
                changes.append(ModeChange(at_s=at_s, mode=after.mode, reason=after.reason))
        return changes


def _largest(values: Iterable[float]) -> float:
    return max(map(abs, values), default=0.0)


def run_cut(cut: LinkCut) -> tuple[CutFigures, ...]:
    scenario = cut.scenario()
    stream = FigureStream.of(scenario)
    observer = CutObserver(cut, scenario, stream)
    drive(scenario, [stream, observer]).raise_fault()
    return observer.figures()
