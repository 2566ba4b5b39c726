"""The reaction of one follower to missing messages: modes, recoveries, stops, blind distance.

Lengths are summed in whole micrometres, times in nanoseconds, so that the figures are the same on
every machine and for any order of messages of different kinds.
"""

from dataclasses import dataclass, field
from math import isfinite

from vehicles.messages import Mode, SourceStatus, Tracking, TruePose
from vehicles.schedule import SECOND

MICROMETRES = 1_000_000
MOST_BEHIND = 250
"""Stored instants while one kind of message is behind the other: 5 s at 50 Hz."""
WITHOUT_SOURCE: frozenset[Mode] = frozenset({"coast", "stop", "straight"})
"""Modes of a follower that relies on none of its sources, or stops before a hole in its path."""
NOT_RELIED_ON: frozenset[SourceStatus] = frozenset({"lost", "distrusted", "probation"})


@dataclass(frozen=True, slots=True, kw_only=True)
class ReactionSummary:
    """Figures of one follower; a recovery lasts from leaving a source until all are relied on.

    `predicted_blind_m_max` is the largest that was predicted when a stop or a crossing of a hole
    began, or when the known path ended although sources were received; None without any of these.
    """

    mode_changes: int = 0
    """Number of changes of the steering mode."""
    recoveries: int = 0
    """Number of times that the follower relied on all its sources again."""
    recovery_s_mean: float | None = None
    """Mean time during which it relied on fewer sources."""
    recovery_s_max: float | None = None
    """Longest time during which it relied on fewer sources."""
    stops: int = 0
    """Number of emergency stops begun for lack of a known path; they end early if data returns."""
    blind_m: float = 0.0
    """Distance driven beyond the known path, in any mode."""
    predicted_blind_m_max: float | None = None
    """Largest such distance that was predicted when it began."""
    hazards: int = 0
    """Number of warnings to the vehicles behind."""


NO_REACTION = ReactionSummary()
"""For a vehicle that received all messages."""


def is_degraded(tracking: Tracking) -> bool:
    """Whether a follower relies on less than all its sources."""
    return (
        tracking.lead_status in NOT_RELIED_ON
        or tracking.predecessor_status in NOT_RELIED_ON
        or not NOT_RELIED_ON.isdisjoint(tracking.statuses().values())
        or tracking.mode in {"coast", "stop"}
    )


@dataclass(slots=True)
class Reaction:
    """Gathers the reaction of one follower."""

    _mode: Mode | None = None
    _mode_changes: int = 0
    _since: int | None = None
    _recoveries: list[int] = field(default_factory=list)
    _stops: int = 0
    _predicted: list[float] = field(default_factory=list)
    _hazard: bool = False
    _hazards: int = 0
    _blind: int = 0
    _is_blind: bool = False
    _beyond: dict[int, int] = field(default_factory=dict)
    _driven: dict[int, int] = field(default_factory=dict)
    _driven_before: int | None = None

    def add_tracking(self, tracking: Tracking) -> None:
        """Take a follower's state at a command, in order of time."""
        mode, hazard, at = tracking.mode, tracking.hazard, tracking.decided_at_ns
        if mode != self._mode:
            self._enter(tracking)
        if hazard != self._hazard:
            self._hazards += hazard
            self._hazard = hazard
        if is_degraded(tracking):
            if self._since is None:
                self._since = at
        elif self._since is not None:
            self._recoveries.append(at - self._since)
            self._since = None
        blind = tracking.known_m < 0.0  # false for NaN
        if blind and not self._is_blind and mode not in WITHOUT_SOURCE:
            self._predicted.append(tracking.blind_m)
        self._is_blind = blind
        beyond = _whole(-tracking.known_m) if blind else 0
        driven = self._driven.pop(at, None)
        if driven is None:
            _keep(self._beyond, at, beyond)
        else:
            self._drive_on(driven, beyond)

    def _enter(self, tracking: Tracking) -> None:
        self._mode_changes += self._mode is not None
        if tracking.mode == "stop":
            self._stops += 1
        if tracking.mode == "stop" and isfinite(tracking.blind_m):
            self._predicted.append(tracking.blind_m)
        self._mode = tracking.mode

    def add_truth(self, pose: TruePose) -> None:
        """Take the distance driven, in order of time."""
        at, driven = pose.true_at_ns, _whole(pose.distance_m)
        beyond = self._beyond.pop(at, None)
        if beyond is None:
            _keep(self._driven, at, driven)
        else:
            self._drive_on(driven, beyond)

    def _drive_on(self, driven: int, beyond: int) -> None:
        """Add the distance driven beyond the known path up to an instant with both messages.

        It is at most the distance since the previous such instant, and at most that beyond the
        path's end.
        """
        before, self._driven_before = self._driven_before, driven
        if beyond and before is not None:
            self._blind += min(max(driven - before, 0), beyond)

    @property
    def blind_m(self) -> float:
        """Distance driven beyond the known path (m)."""
        return self._blind / MICROMETRES

    @property
    def summary(self) -> ReactionSummary:
        durations = self._recoveries
        return ReactionSummary(
            mode_changes=self._mode_changes,
            recoveries=len(durations),
            recovery_s_mean=sum(durations) / len(durations) / SECOND if durations else None,
            recovery_s_max=max(durations) / SECOND if durations else None,
            stops=self._stops,
            blind_m=self.blind_m,
            predicted_blind_m_max=max(self._predicted, default=None),
            hazards=self._hazards,
        )


def _whole(metres: float) -> int:
    scaled = metres * MICROMETRES
    return round(scaled) if isfinite(scaled) else 0


def _keep(waiting: dict[int, int], at: int, value: int) -> None:
    waiting[at] = value
    if len(waiting) > MOST_BEHIND:
        del waiting[next(iter(waiting))]
