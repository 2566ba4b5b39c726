"""One cut of all messages in a double lane change, and the figures of its followers."""

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
"""Of the lane changes (m/s²): that of the paper's, 500 m at 30 m/s."""
AFTERWARDS_S = 20.0
"""How long a run goes on after the cut."""
SETTLED_S = 5.0
"""Time at the convoy's speed that a follower has to reach the path that it receives again."""
STANDING = 0.05
"""A car that is slower than this (m/s) stands."""
UNDER_WAY = 0.5
"""A car that drives at this share of the convoy's speed has resumed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkCut:
    """All messages of a convoy at `speed_mps` stop `at_s` after the start, for `for_s`.

    `reaction` is that of the followers among the `vehicles`; `seed` is that of all noise.
    """

    reaction: Reaction
    speed_mps: float
    at_s: float
    for_s: float
    seed: int
    vehicles: int = 3

    def scenario(self) -> Scenario:
        """The double lane change of the paper, each piece a second long at any speed."""
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
    """A change of a follower's mode (s after the start), and its reason."""

    at_s: float
    mode: Mode
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CutFigures:
    """Figures of a follower in a cut (m, s).

    `error` is the largest true distance from the lead's driven path during the cut, `error_inside`
    that within the known path. `error_back` is that after the follower has passed the lead's
    position at the end of the cut and `SETTLED_S` more, before which its path was unknown; 0 if it
    did not get there. `predicted_blind` is the distance beyond the known path that it predicted
    when it lost its last source, `blind` the distance that it drove; both are 0 if it can stop
    within. `ticks_late` is the number of control periods from the loss of its last source by the
    thresholds to its change of mode. `friction` is the largest share used, `command_step` (rad) the
    largest of the steering command. `resumed_after` counts from the end of the cut; inf if it never
    did.
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
    """Messages about one follower, and its errors and stations by instant."""

    truth: list[TruePose] = field(default_factory=list)
    tracking: list[Tracking] = field(default_factory=list)
    steering: list[float] = field(default_factory=list)
    received_at: dict[str, int] = field(default_factory=dict)
    errors: dict[int, float] = field(default_factory=dict)
    stations: dict[int, float] = field(default_factory=dict)


class CutObserver:
    """An observer of a run with a cut that derives the figures of its followers."""

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
        self._of: defaultdict[str, _FollowerRecord] = defaultdict(_FollowerRecord)
        stream.on_error(self._record_error)

    def _record_error(self, foot: CrossTrack) -> None:
        self._of[foot.vehicle].errors[foot.at_ns] = foot.lateral
        self._of[foot.vehicle].stations[foot.at_ns] = foot.station

    def listen(self, _at: int, message: Message) -> None:
        of = self._of[message.vehicle]
        match message:
            case TruePose():
                of.truth.append(message)
                if message.vehicle == self._names[0] and message.true_at_ns <= self._to:
                    self._reached_from = message.distance_m + SETTLED_S * self._cut.speed_mps
            case Tracking():
                of.tracking.append(message)
            case Command():
                of.steering.append(message.steering_rad)
            case LinkVerdict() if (
                message.outcome == "delivered" and message.sent_at_ns < self._from
            ):
                of.received_at[message.sender] = message.received_at_ns

    def figures(self) -> tuple[CutFigures, ...]:
        return tuple(self._figures(name) for name in self._names[1:])

    def _figures(self, name: str) -> CutFigures:
        of = self._of[name]
        away = [one for one in of.tracking if self._from <= one.decided_at_ns < self._to]
        lost = next((one for one in away if one.mode in {"coast", "stop"}), None)
        return CutFigures(
            cut=self._cut,
            vehicle=name,
            error=_largest(of.errors.get(one.decided_at_ns, 0.0) for one in away),
            error_on_known_path=_largest(
                of.errors.get(one.decided_at_ns, 0.0)
                for one in takewhile(lambda one: not one.known_m < 0.0, away)
            ),
            error_after_recovery=_largest(
                error for at, error in of.errors.items() if of.stations[at] > self._reached_from
            ),
            predicted_blind=lost.blind_m if lost else 0.0,
            blind=max([0.0, *(-one.known_m for one in away if not isnan(one.known_m))]),
            stopped=any(
                one.speed_mps < STANDING
                for one in of.truth
                if self._from <= one.true_at_ns < self._to
            ),
            ticks_late=self._ticks_late(of, lost),
            friction=max(one.friction_ratio for one in of.truth),
            command_step=_largest(b - a for a, b in pairwise([0.0, *of.steering])),
            resumed_after=self._resumed_after(of),
            changes=tuple(self._changes(of.tracking)),
        )

    def _ticks_late(self, of: _FollowerRecord, lost: Tracking | None) -> int:
        """Count control periods between the threshold and the change of mode."""
        if lost is None or not of.received_at:
            return 0
        threshold = max(of.received_at.values()) + self._lost_after
        return (lost.decided_at_ns - threshold) // self._period

    def _resumed_after(self, of: _FollowerRecord) -> float:
        speeds = {one.true_at_ns: one.speed_mps for one in of.truth}
        under_way = UNDER_WAY * self._cut.speed_mps
        instants = (
            one.decided_at_ns
            for one in of.tracking
            if one.decided_at_ns >= self._to and one.mode not in {"coast", "stop", "straight"}
        )
        at = next((at for at in instants if speeds.get(at, 0.0) >= under_way), None)
        return inf if at is None else (at - self._to) / SECOND

    def _changes(self, tracking: Sequence[Tracking]) -> list[ModeChange]:
        changes = []
        for before, one in pairwise(tracking):
            if one.mode != before.mode:
                at_s = (one.decided_at_ns - self._start) / SECOND
                changes.append(ModeChange(at_s=at_s, mode=one.mode, reason=one.reason))
        return changes


def _largest(values: Iterable[float]) -> float:
    return max(map(abs, values), default=0.0)


def run_cut(cut: LinkCut) -> tuple[CutFigures, ...]:
    scenario = cut.scenario()
    stream = FigureStream.of(scenario)
    observer = CutObserver(cut, scenario, stream)
    drive(scenario, [stream, observer]).raise_fault()
    return observer.figures()
