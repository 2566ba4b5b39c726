"""The reaction of one follower to missing messages: modes, recoveries, stops, blind distance.

Lengths are summed in whole micrometres, times in nanoseconds, so that the metrics are the same on
every machine.
"""

from dataclasses import dataclass

import numpy as np

from scenarios.results.events import LOST_MODES, begins, sources
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
    degraded: Flags = np.isin(tracking["mode"], ("coast", "stop"))
    degraded |= np.isin(tracking["predecessor_status"], NOT_RELIED_ON)
    for at, status, _ in sources(run, follower).values():
        degraded |= np.isin(tracking.at_ns, at[np.isin(status, NOT_RELIED_ON)])
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
    at, mode, blind_m = tracking.at_ns, tracking["mode"], tracking["blind_m"]
    if not len(at):
        return NO_REACTION
    changes = np.append(True, mode[1:] != mode[:-1])
    stops = changes & (mode == "stop")
    degraded = spans(at, is_degraded(run, follower))
    lasted = [int(at[last + 1] - at[first]) for first, last in degraded if last + 1 < len(at)]
    is_unplanned = begins(tracking["known_m"] < 0.0) & ~np.isin(mode, LOST_MODES)
    predicted = blind_m[is_unplanned | (stops & np.isfinite(blind_m))]
    _, distance = blind_distance(run, follower)
    return ReactionSummary(
        mode_changes=int(changes.sum()) - 1,
        recoveries=len(lasted),
        recovery_s_mean=sum(lasted) / len(lasted) / SECOND if lasted else None,
        recovery_s_max=max(lasted) / SECOND if lasted else None,
        stops=int(stops.sum()),
        blind_m=float(distance[-1]) if len(distance) else 0.0,
        predicted_blind_m_max=max(predicted.tolist(), default=None),
        hazards=int(begins(tracking["hazard"]).sum()),
    )
