"""Figures of the followers in a run with a cut."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, takewhile
from math import inf

from scenarios.definition.scenario import Scenario
from scenarios.results.events.encounters import TrueGap
from scenarios.results.stream import FigureStream
from scenarios.runs.virtual.drive import drive
from scenarios.studies.cuts.cut import LinkCut
from scenarios.studies.cuts.road_record import RoadObserver
from vehicles.messages import Command, LinkVerdict, Message, Mode, Tracking, TruePose
from vehicles.schedule import SECOND, nanoseconds

SETTLED_S = 5.0
"""Time at the speed of the convoy that a follower has to return to the lead's path."""
STANDING = 0.05
"""Speed (m/s) below which a car has stopped."""
RESUMED = 0.5
"""A car has resumed once it reaches this share of its speed before the cut."""
NO_SOURCE: frozenset[Mode] = frozenset({"coast", "stop"})
GROWN_M = 0.5
"""A known path grows if its end moves ahead by more than this (m)."""
REASON_M = 2.0
"""A standing car has a reason if its gap exceeds the standstill gap by at most this distance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeChange:
    """A change of mode at `at_s` after the start."""

    at_s: float
    mode: Mode
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CutFigures:
    """Figures of a follower in a cut (m, s).

    `error` is the largest true error from the cut to the end of the run, `error_on_known_path`
    during the cut before the end of the known path, `error_after_recovery` from `SETTLED_S` after
    the lead's position at the end of the cut (0 if not reached). `departures` counts how often the
    car left its lane, `departures_avoidable` those of them for which the received path sufficed to
    stop, `collisions` those with the car ahead of it. `predicted_blind` is the distance without a
    known path that the follower predicted when it began a stop to a standstill, `blind` the
    distance driven until then, None without such a stop. `stood` is the longest standstill after
    the cut without a reason on the road. `ticks_late` counts control periods between the threshold
    for losing the last source and the change of mode. `friction` is the largest share used,
    `command_step` (rad) the largest step of the steering command. `resumed_after` counts from the
    end of the cut; inf if never.
    """

    cut: LinkCut
    vehicle: str
    error: float
    error_on_known_path: float
    error_after_recovery: float
    departures: int
    departures_avoidable: int
    collisions: int
    predicted_blind: float | None
    blind: float | None
    stopped: bool
    stood: float
    ticks_late: int
    friction: float
    command_step: float
    resumed_after: float
    changes: tuple[ModeChange, ...]


@dataclass(slots=True)
class _FollowerRecord:
    """Estimates and commands of a follower, and its last reception from each source (ns)."""

    tracking: list[Tracking] = field(default_factory=list)
    steering: list[float] = field(default_factory=list)
    received_at: dict[str, int] = field(default_factory=dict)
    near: set[int] = field(default_factory=set)
    """Instants at which the gap to the predecessor is about the standstill gap."""


class CutObserver:
    """Observer of a run with a cut that derives the figures of its followers."""

    kinds: frozenset[type[Message]] = RoadObserver.kinds | {Command, Tracking}

    def __init__(self, cut: LinkCut, scenario: Scenario, stream: FigureStream) -> None:
        self._cut = cut
        self._lead, *self._followers = scenario.vehicle_names
        self._period = nanoseconds(1.0 / scenario.control_rate_hz)
        self._start = scenario.start_at_ns
        self._from = self._start + nanoseconds(cut.at_s)
        self._to = self._start + nanoseconds(cut.ends_at_s)
        self._reached_from = inf
        self._speed_before = cut.speed_mps
        self._near = scenario.tables.speed.gap.standstill_m + REASON_M
        degradation = scenario.tables.control.degradation.value
        period = 1.0 / scenario.tables.gnss.value.rate
        self._lost_after = nanoseconds(degradation.lost_after_silence(period))
        self._records: defaultdict[str, _FollowerRecord] = defaultdict(_FollowerRecord)
        self._road = RoadObserver(stream)
        stream.on_gap(self._record_gap)

    def _record_gap(self, gap: TrueGap) -> None:
        if gap.now_at_ns > self._to and gap.now_m <= self._near:
            self._records[gap.vehicle].near.add(gap.now_at_ns)

    def listen(self, at: int, message: Message) -> None:
        if type(message) in self._road.kinds:
            self._road.listen(at, message)
        record = self._records[message.vehicle]
        match message:
            case TruePose() if message.vehicle == self._lead and message.true_at_ns <= self._to:
                self._reached_from = message.distance_m + SETTLED_S * message.speed_mps
                if message.true_at_ns <= self._from:
                    self._speed_before = message.speed_mps
            case Tracking():
                record.tracking.append(message)
            case Command():
                record.steering.append(message.steering_rad)
            case LinkVerdict() if (
                message.outcome == "delivered" and message.sent_at_ns < self._from
            ):
                record.received_at[message.sender] = message.received_at_ns

    def figures(self) -> tuple[CutFigures, ...]:
        avoidable = self._road.avoidable_departures()
        return tuple(self._figures(name, avoidable[name]) for name in self._followers)

    def _figures(self, name: str, departures_avoidable: int) -> CutFigures:
        record, car = self._records[name], self._road.cars[name]
        during = [
            tracking
            for tracking in record.tracking
            if self._from <= tracking.decided_at_ns < self._to
        ]
        poses = {pose.true_at_ns: pose for pose in car.truth}
        blind, predicted = _blind(record.tracking, poses)
        return CutFigures(
            cut=self._cut,
            vehicle=name,
            error=_largest(error for at, error in car.errors.items() if at >= self._from),
            error_on_known_path=_largest(
                car.errors.get(row.decided_at_ns, 0.0)
                for row in takewhile(lambda row: not row.known_m < 0.0, during)
            ),
            error_after_recovery=_largest(
                error for at, error in car.errors.items() if car.stations[at] > self._reached_from
            ),
            departures=len(car.departures),
            departures_avoidable=departures_avoidable,
            collisions=car.collisions,
            predicted_blind=predicted,
            blind=blind,
            stopped=any(_stands(pose) for at, pose in poses.items() if self._from <= at < self._to),
            stood=self._stood(record, car.truth),
            ticks_late=self._ticks_late(record, during),
            friction=max(pose.friction_ratio for pose in car.truth),
            command_step=_largest(b - a for a, b in pairwise([0.0, *record.steering])),
            resumed_after=self._resumed_after(record, poses),
            changes=tuple(self._changes(record.tracking)),
        )

    def _stood(self, record: _FollowerRecord, truth: Sequence[TruePose]) -> float:
        """Longest standstill after the cut without a reason on the road (s)."""
        longest = since = 0
        for pose in truth:
            at = pose.true_at_ns
            if at > self._to and _stands(pose) and at not in record.near:
                since = since or at
                longest = max(longest, at - since)
            else:
                since = 0
        return longest / SECOND

    def _ticks_late(self, record: _FollowerRecord, during: Sequence[Tracking]) -> int:
        """Count control periods between the threshold and the change of mode."""
        lost = next((tracking for tracking in during if tracking.mode in NO_SOURCE), None)
        if lost is None or not record.received_at:
            return 0
        threshold = max(record.received_at.values()) + self._lost_after
        return (lost.decided_at_ns - threshold) // self._period

    def _resumed_after(self, record: _FollowerRecord, poses: Mapping[int, TruePose]) -> float:
        resumed = RESUMED * self._speed_before
        instants = (
            row.decided_at_ns
            for row in record.tracking
            if row.decided_at_ns >= self._to and row.mode not in NO_SOURCE | {"creep", "straight"}
        )
        driving = (at for at in instants if at in poses and poses[at].speed_mps >= resumed)
        at = next(driving, None)
        return inf if at is None else (at - self._to) / SECOND

    def _changes(self, tracking: Sequence[Tracking]) -> Iterator[ModeChange]:
        for before, after in pairwise(tracking):
            if after.mode != before.mode:
                at_s = (after.decided_at_ns - self._start) / SECOND
                yield ModeChange(at_s=at_s, mode=after.mode, reason=after.reason)


def _blind(
    tracking: Sequence[Tracking], poses: Mapping[int, TruePose]
) -> tuple[float, float] | tuple[None, None]:
    """Blind distance of a stop to a standstill, driven and predicted (m).

    A stop begins when the known path grew last. The driven distance is the true one, less the known
    path at its beginning. Of several stops, that with the largest difference.
    """
    stops: list[tuple[float, float]] = []
    began: Tracking | None = None
    path_end = -inf
    for row in tracking:
        pose = poses.get(row.decided_at_ns)
        if pose is None or not _is_stopping(row):
            began, path_end = None, -inf
        elif pose.distance_m + row.known_m > path_end + GROWN_M:
            began, path_end = None if _stands(pose) else row, pose.distance_m + row.known_m
        elif began is not None and _stands(pose):
            stops.append((max(pose.distance_m - path_end, 0.0), began.blind_m))
            began = None
    return max(stops, key=lambda stop: abs(stop[0] - stop[1]), default=(None, None))


def _is_stopping(row: Tracking) -> bool:
    """Whether a car has no source or, in any mode but "creep", no known path."""
    return row.mode in NO_SOURCE or (row.mode != "creep" and row.known_m < 0.0)


def _stands(pose: TruePose) -> bool:
    return pose.speed_mps < STANDING


def _largest(values: Iterable[float]) -> float:
    return max(map(abs, values), default=0.0)


def run_cut(cut: LinkCut) -> tuple[CutFigures, ...]:
    scenario = cut.scenario()
    stream = FigureStream.of(scenario)
    observer = CutObserver(cut, scenario, stream)
    drive(scenario, [stream, observer]).raise_fault()
    return observer.figures()
