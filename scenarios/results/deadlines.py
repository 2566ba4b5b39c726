"""Deadlines of followers: `[[limits.modes]]`, `[[limits.sources]]` and `[[limits.recovery]]`.

The messages of each vehicle come in order of time, those of different vehicles in any order.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from scenarios.definition.schema.limit_tables import (
    LimitsTable,
    ModeLimit,
    RecoveryLimit,
    SourceLimit,
)
from scenarios.results.reaction import is_degraded
from vehicles.messages import Tracking
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


class DeadlineWatch(Protocol):
    """Watches one follower for one limit; instants are ns since the start of the run."""

    action: str

    def add_tracking(self, at: int, tracking: Tracking) -> None: ...

    def add_error(self, at: int, error: float) -> None:
        """Take its true distance (m) from the lead's path."""
        ...

    def time_taken(self, ran: int) -> int | None:
        """Time (ns) from the limit's instant until it was met, in a run of `ran` ns."""
        ...


class ModeWatch:
    """Watches when a follower first entered a mode."""

    def __init__(self, limit: ModeLimit) -> None:
        self._after, self._mode = nanoseconds(limit.after_s), limit.mode
        self.action = f"in mode {limit.mode}, from {limit.after_s:g} s on"
        self._first: int | None = None

    def add_tracking(self, at: int, tracking: Tracking) -> None:
        if self._first is None and at >= self._after and tracking.mode == self._mode:
            self._first = at

    def add_error(self, at: int, error: float) -> None:
        """Ignore the error."""

    def time_taken(self, ran: int) -> int | None:  # noqa: ARG002 - for RecoveryWatch
        return None if self._first is None else self._first - self._after


class SourceWatch:
    """Watches when a source of a follower first got a status."""

    def __init__(self, limit: SourceLimit, lead: str) -> None:
        self._after, self._status = nanoseconds(limit.after_s), limit.status
        self.action = f"source {limit.source} {limit.status}, from {limit.after_s:g} s on"
        self._source, self._is_lead = limit.source, limit.source == lead
        self._first: int | None = None

    def add_tracking(self, at: int, tracking: Tracking) -> None:
        status = tracking.lead_status if self._is_lead else tracking.predecessor_status
        status = tracking.statuses().get(self._source, status)
        if self._first is None and at >= self._after and status == self._status:
            self._first = at

    def add_error(self, at: int, error: float) -> None:
        """Ignore the error."""

    def time_taken(self, ran: int) -> int | None:  # noqa: ARG002 - for RecoveryWatch
        return None if self._first is None else self._first - self._after


class RecoveryWatch:
    """Watches when a follower was last degraded or too far off the path."""

    def __init__(self, limit: RecoveryLimit) -> None:
        self._after, self._error = nanoseconds(limit.after_s), limit.error_m
        self.action = f"recovered to {limit.error_m:g} m, from {limit.after_s:g} s on"
        self._seen = self._degraded = -1
        self._measured = self._off = -1

    def add_tracking(self, at: int, tracking: Tracking) -> None:
        self._seen = at
        if at >= self._after and is_degraded(tracking):
            self._degraded = at

    def add_error(self, at: int, error: float) -> None:
        self._measured = at
        if at >= self._after and abs(error) > self._error:
            self._off = at

    def time_taken(self, ran: int) -> int | None:
        """Time (ns) until the last recovery; None if not recovered at the end, or without data."""
        is_silent = min(self._seen, self._measured) < max(self._after, ran - UNRECORDED_NS)
        if is_silent or self._degraded == self._seen or self._off == self._measured:
            return None
        return max(self._degraded, self._off, self._after) - self._after


class Deadlines:
    """All deadlines of a scenario; false without any."""

    def __init__(self, limits: LimitsTable | None = None, lead: str = "") -> None:
        table = limits or LimitsTable()
        self._start_at = 0
        self._limits: list[tuple[str, ModeLimit | SourceLimit | RecoveryLimit, DeadlineWatch]] = [
            *((f"modes[{k}]", limit, ModeWatch(limit)) for k, limit in enumerate(table.modes)),
            *(
                (f"sources[{k}]", limit, SourceWatch(limit, lead))
                for k, limit in enumerate(table.sources)
            ),
            *(
                (f"recovery[{k}]", limit, RecoveryWatch(limit))
                for k, limit in enumerate(table.recovery)
            ),
        ]
        self._of: Mapping[str, Sequence[DeadlineWatch]] = {
            name: [watch for _, limit, watch in self._limits if limit.vehicle == name]
            for name in {limit.vehicle for _, limit, _ in self._limits}
        }

    def __bool__(self) -> bool:
        return bool(self._limits)

    def begin(self, start_at: int) -> None:
        """Set the start of the run (ns), from which instants count."""
        self._start_at = start_at

    def add_tracking(self, tracking: Tracking) -> None:
        for watch in self._of.get(tracking.vehicle, ()):
            watch.add_tracking(tracking.decided_at_ns - self._start_at, tracking)

    def add_error(self, vehicle: str, at: int, error: float) -> None:
        """Take the true distance (m) of a vehicle from the lead's path at an instant (ns)."""
        for watch in self._of.get(vehicle, ()):
            watch.add_error(at - self._start_at, error)

    def figures(self, ran_ns: int) -> tuple[DeadlineFigure, ...]:
        return tuple(self._figure(key, limit, watch, ran_ns) for key, limit, watch in self._limits)

    def _figure(
        self,
        key: str,
        limit: ModeLimit | SourceLimit | RecoveryLimit,
        watch: DeadlineWatch,
        ran_ns: int,
    ) -> DeadlineFigure:
        time_taken = watch.time_taken(ran_ns)
        return DeadlineFigure(
            key=key,
            vehicle=limit.vehicle,
            action=watch.action,
            within_s=limit.within_s,
            took_s=None if time_taken is None else time_taken / SECOND,
            is_over=ran_ns >= nanoseconds(limit.after_s + limit.within_s),
        )
