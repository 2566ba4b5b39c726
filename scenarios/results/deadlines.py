"""Deadlines of followers: `[[limits.modes]]`, `[[limits.sources]]` and `[[limits.recovery]]`."""

from dataclasses import dataclass

import numpy as np

from scenarios.definition.schema.limit_tables import ModeLimit, RecoveryLimit, SourceLimit
from scenarios.results.events import sources
from scenarios.results.reaction import is_degraded
from scenarios.results.tables import RunTables
from scenarios.results.true_motion import cross_track_error
from transport.columns import Flags, Integers
from vehicles.schedule import SECOND, nanoseconds

UNRECORDED_NS = SECOND
"""A follower without messages for this time before the end has not recovered."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeadlineFigure:
    """Time (s) that an action took, which is allowed `within_s`; None if it did not happen.

    `key` is that of its table. `is_over`: the run has reached the deadline.
    """

    key: str
    vehicle: str
    action: str
    within_s: float
    took_s: float | None
    is_over: bool

    @property
    def broken(self) -> bool:
        """Whether the action was late, or did not happen before the deadline."""
        return self.is_over if self.took_s is None else self.took_s > self.within_s


def deadline_figures(run: RunTables) -> tuple[DeadlineFigure, ...]:
    """Metrics of all deadlines of the scenario."""
    limits = run.scenario.tables.limits
    rows: list[tuple[str, ModeLimit | SourceLimit | RecoveryLimit]] = [
        *((f"modes[{k}]", limit) for k, limit in enumerate(limits.modes)),
        *((f"sources[{k}]", limit) for k, limit in enumerate(limits.sources)),
        *((f"recovery[{k}]", limit) for k, limit in enumerate(limits.recovery)),
    ]
    return tuple(_figure(run, key, limit) for key, limit in rows)


def _figure(
    run: RunTables, key: str, limit: ModeLimit | SourceLimit | RecoveryLimit
) -> DeadlineFigure:
    at = run.table(limit.vehicle, "tracking").at_ns - run.beginning
    took = None
    match limit:
        case ModeLimit():
            action = f"in mode {limit.mode}, from {limit.after_s:g} s on"
            holds = run.table(limit.vehicle, "tracking")["mode"] == limit.mode
            took = _first(at, holds, limit.after_s)
        case SourceLimit():
            action = f"source {limit.source} {limit.status}, from {limit.after_s:g} s on"
            found = sources(run, limit.vehicle).get(limit.source)
            if found is not None:
                at = found.at_ns - run.beginning
                took = _first(at, found.status == limit.status, limit.after_s)
        case RecoveryLimit():
            action = f"recovered to {limit.error_m:g} m, from {limit.after_s:g} s on"
            took = _recovered(run, limit)
    return DeadlineFigure(
        key=key,
        vehicle=limit.vehicle,
        action=action,
        within_s=limit.within_s,
        took_s=None if took is None else took / SECOND,
        is_over=run.ran_ns >= nanoseconds(limit.after_s + limit.within_s),
    )


def _first(at: Integers, holds: Flags, after_s: float) -> int | None:
    """Time (ns) from `after_s` until a condition first held; None if it did not."""
    after = nanoseconds(after_s)
    (rows,) = np.nonzero(holds & (at >= after))
    return int(at[rows[0]]) - after if len(rows) else None


def _recovered(run: RunTables, limit: RecoveryLimit) -> int | None:
    """Time (ns) until a follower was last degraded or too far off the path.

    None if it is not recovered at the end, or without messages there.
    """
    after, name = nanoseconds(limit.after_s), limit.vehicle
    decided_at = run.table(name, "tracking").at_ns - run.beginning
    error = cross_track_error(run, name)
    known = ~np.isnan(error)
    measured_at = run.table(name, "truth").at_ns[known] - run.beginning
    is_off = np.abs(error[known]) > limit.error_m
    ends = []
    for at, holds in ((decided_at, is_degraded(run, name)), (measured_at, is_off)):
        if not len(at) or at[-1] < max(after, run.ran_ns - UNRECORDED_NS):
            return None
        (rows,) = np.nonzero(holds & (at >= after))
        if len(rows) and rows[-1] == len(at) - 1:
            return None
        ends += at[rows[-1:]].tolist()
    return int(max([*ends, after])) - after
