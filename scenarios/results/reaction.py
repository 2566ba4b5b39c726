"""The reaction of one follower to missing messages: modes, recoveries, stops, blind distance.

Lengths are summed in whole micrometres, times in nanoseconds, so that the metrics are the same on
every machine.
"""

from dataclasses import dataclass

import numpy as np

from scenarios.results.events import LOST_MODES, begins, is_one_of, sources
from scenarios.results.tables import RunTables, common, once, spans
from transport.columns import Flags, Floats, Integers
from vehicles.schedule import SECOND

MICROMETRES = 1_000_000
NOT_RELIED_ON = ("lost", "distrusted", "probation")
"""Statuses of a source."""


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


@once
def is_degraded(run: RunTables, follower: str) -> Flags:
    """Whether a follower relies on less than all its sources, at its decisions (N)."""
    tracking = run.table(follower, "tracking")
    degraded = is_one_of(tracking["mode"], "coast", "stop")
    degraded |= is_one_of(tracking["predecessor_status"], *NOT_RELIED_ON)
    for at, status, _ in sources(run, follower).values():
        degraded |= np.isin(tracking.at_ns, at[is_one_of(status, *NOT_RELIED_ON)])
    return degraded


@once
def blind_distance(run: RunTables, follower: str) -> tuple[Integers, Floats]:
    """Distance (m) driven so far beyond the known path, in any mode, at instants (ns).

    In each step it is at most the distance driven, and at most that beyond the path's end.
    """
    tracking, truth = run.table(follower, "tracking"), run.table(follower, "truth")
    at, (decisions, poses) = common(tracking.at_ns, truth.at_ns)
    known = tracking["known_m"][decisions]
    beyond = np.where(known < 0.0, np.round(-known * MICROMETRES), 0.0)
    driven = np.diff(np.round(truth["distance_m"][poses] * MICROMETRES), prepend=np.nan)
    steps = np.minimum(np.maximum(np.nan_to_num(driven), 0.0), beyond)
    return at, np.cumsum(steps) / MICROMETRES


@once
def reaction(run: RunTables, follower: str) -> ReactionSummary:
    tracking = run.table(follower, "tracking")
    at, mode = tracking.at_ns, tracking["mode"]
    if not len(at):
        return NO_REACTION
    entered = np.concatenate(([0], np.flatnonzero(mode[1:] != mode[:-1]) + 1))
    stops = entered[is_one_of(mode[entered], "stop")]
    degraded = spans(at, is_degraded(run, follower))
    lasted = [int(at[last + 1] - at[first]) for first, last in degraded if last + 1 < len(at)]
    is_blind, blind_m = tracking["known_m"] < 0.0, tracking["blind_m"]
    is_unplanned = begins(is_blind) & ~is_one_of(mode, *LOST_MODES)
    planned = blind_m[stops]
    predicted = [*blind_m[is_unplanned], *planned[np.isfinite(planned)]]
    _, distance = blind_distance(run, follower)
    return ReactionSummary(
        mode_changes=len(entered) - 1,
        recoveries=len(lasted),
        recovery_s_mean=sum(lasted) / len(lasted) / SECOND if lasted else None,
        recovery_s_max=max(lasted) / SECOND if lasted else None,
        stops=len(stops),
        blind_m=float(distance[-1]) if len(distance) else 0.0,
        predicted_blind_m_max=max(map(float, predicted), default=None),
        hazards=int(np.count_nonzero(begins(tracking["hazard"]))),
    )
