"""The limits of a run: the figure of each one, kept, broken, or not judged for lack of messages."""

from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from operator import attrgetter, itemgetter
from typing import TypeVar

import numpy as np

from scenarios.definition.run_limits import Limit, limits_of
from scenarios.definition.schema.limit_rows import LimitRow, Live
from scenarios.definition.schema.limit_tables import (
    DEADLINES,
    DeadlineTable,
    LimitsTable,
    ModeLimit,
    RecoveryLimit,
    SourceLimit,
)
from scenarios.definition.schema.plug_ins.point import PlugInError
from scenarios.results.events import Event, sources
from scenarios.results.reaction import is_degraded
from scenarios.results.record import RecordKind, UnseenSpan
from scenarios.results.run_event import RunEvent, events
from scenarios.results.summary import LimitFigure, RunSummary
from scenarios.results.tables import RunTables, Signal
from scenarios.results.vehicle_figures import (
    VehicleSummary,
    blind_distances,
    friction,
    road_errors,
    self_estimate_errors,
    true_errors,
    true_gaps,
)
from vehicles.schedule import SECOND, nanoseconds

ROUNDING_S = 1e-9
USUAL_LATE_S = 1.0
"""Largest delay with which a vehicle may be driven without limits.late_s_max."""
UNRECORDED_NS = SECOND
"""A follower without messages for this time before the end has not recovered."""
Needed = tuple[str, RecordKind]
"""Vehicle and kind of its messages."""
AnyEvent = TypeVar("AnyEvent", Event, RunEvent)


# ---- Limits judged by the figures and events of a run: each with its figure and its instant


def limit_figures(
    limits: LimitsTable,
    events: Sequence[RunEvent],
    vehicles: Sequence[VehicleSummary],
    deadlines: Sequence[LimitFigure] = (),
    unseen: Sequence[UnseenSpan] = (),
    *,
    late_s: Mapping[str, float] | None = None,
) -> tuple[LimitFigure, ...]:
    """Return the figure of each limit, kept, broken or not judged; `events` are in order of time.

    A limit on a figure of vehicles is there once for each of them that has that figure or lacks
    messages, or without one where no vehicle has it. A limit of one vehicle replaces that of the
    convoy for it. Limits over messages that are missing in the log, in the times `unseen`, are not
    judged, nor are those on vehicles that were driven late, by up to `late_s` (s).
    """
    known, collisions = list(limits_of(limits)), [one for one in events if one.kind == "collision"]
    counts = [_count(limit, events) for limit in known if limit.row.event]
    if limits.collisions_max is None and limits.after_collision == "end":
        line = f'limits.after_collision = "end": {collisions[0].line}' if collisions else ""
        count = float(len(collisions))
        first = LimitFigure(limit="after_collision", bound=0.0, value=count, message=line)
        counts = [first, *counts]
    lacking = {span.vehicle for span in unseen}
    figures = [
        row
        for limit in known
        if not limit.row.event
        for row in _figures(limit, known, vehicles, lacking)
    ]
    late_s = late_s or {row.name: 0.0 for row in vehicles}
    return _judged_by_record([*counts, *figures, *deadlines], limits, unseen, late_s)


def _figure(
    limit: Limit, value: float | None, vehicle: str = "", line: str = "", *, judged: bool = True
) -> LimitFigure:
    message = f"limits.{limit.name} = {limit.bound:g}: {line}" if line else ""
    return LimitFigure(
        limit=limit.name,
        bound=float(limit.bound),
        value=None if value is None else float(value),
        vehicle=vehicle,
        message=message,
        judged=judged,
    )


def _counted(limit: Limit, events: Sequence[AnyEvent]) -> list[AnyEvent]:
    """Events that a limit counts; a limit of one vehicle counts those that involve it."""
    return [
        event
        for event in events
        if event.kind == limit.row.event and (not limit.vehicle or limit.vehicle in event.vehicles)
    ]


def _count(limit: Limit, events: Sequence[RunEvent]) -> LimitFigure:
    counted, most = _counted(limit, events), int(limit.bound)
    line = counted[most].line if len(counted) > most else ""
    return _figure(limit, len(counted), limit.vehicle, line)


def _figures(
    limit: Limit,
    limits: Sequence[Limit],
    vehicles: Sequence[VehicleSummary],
    lacking: Collection[str],
) -> list[LimitFigure]:
    """Figures of the vehicles that a limit applies to, or one None if none is known.

    One that is `lacking` messages has a figure in any case.
    """
    own = {other.vehicle for other in limits if other.key == limit.key and other.vehicle}
    names = {limit.vehicle} if limit.vehicle else {row.name for row in vehicles} - own
    rows = [row for row in vehicles if row.name in names and _applies(limit.row, row)]
    found = []
    for row in rows:
        value = _value(limit.row, row)
        if value is not None:
            at = getattr(row, limit.row.at) if limit.row.at else None
            breach = limit.row.breach.format(figure=value, at=at or 0.0)
            line = f"{row.name} {breach}" if limit.is_beyond(value) else ""
            found.append(_figure(limit, value, row.name, line))
        elif _is_unmeasured(limit.row, row):
            line = f"not judged: {unmeasured(limit.row.own_figure, row.name)}"
            found.append(_figure(limit, None, row.name, line, judged=False))
        elif row.name in lacking:
            found.append(_figure(limit, None, row.name))
    if not found and (rows or limit.vehicle or not own):
        found.append(_figure(limit, None, limit.vehicle))
    return found


def _applies(row: LimitRow, vehicle: VehicleSummary) -> bool:
    return vehicle.role == "follower" or row.of_lead


def _value(row: LimitRow, vehicle: VehicleSummary) -> float | None:
    if row.own_figure:
        return vehicle.own_figures.get(row.own_figure)
    value: float | None = attrgetter(row.figure)(vehicle)
    return value


def _is_unmeasured(row: LimitRow, vehicle: VehicleSummary) -> bool:
    """Whether a function of the user failed to measure its figure, or is not here."""
    return bool(row.own_figure) and row.own_figure not in vehicle.own_figures


def unmeasured(figure: str, vehicle: str) -> str:
    return f"{vehicle} has no figure {figure}, because its class failed or is missing"


def collision_ends_run(limits: LimitsTable, collisions: int) -> bool:
    """Whether the run has to end after this number of collisions."""
    after, most = limits.after_collision, limits.collisions_max
    if after == "continue" or (after is None and most is None):
        return False
    return collisions > (most or 0)


def failure_reason(reason: str, broken: Sequence[str]) -> str:
    """Join the reason of an early end with broken limits that it does not mention."""
    return "; ".join([*filter(None, [reason]), *(line for line in broken if line not in reason)])


def broken_by(limit: Limit, summary: RunSummary) -> bool:
    """Whether a run broke a limit, of a largest figure that no vehicle has as if it were 0.

    Raises PlugInError if a function of the user failed to measure the figure.
    """
    if limit.row.event:
        return len(_counted(limit, summary.events)) > limit.bound
    rows = [row for row in summary.vehicles if limit.vehicle in {"", row.name}]
    if without := [row.name for row in rows if _is_unmeasured(limit.row, row)]:
        raise PlugInError(f"{limit}: {unmeasured(limit.row.own_figure, without[0])}")
    values = [_value(limit.row, row) for row in rows if _applies(limit.row, row)]
    known = [value for value in values if value is not None]
    return any(map(limit.is_beyond, known or ([] if limit.row.is_least else [0.0])))


# ---- Deadlines of followers: `[[limits.modes]]`, `[[limits.sources]]` and `[[limits.recovery]]`


def deadline_figures(run: RunTables) -> tuple[LimitFigure, ...]:
    """Time (s) that each action with a deadline took; None if it did not happen.

    It is broken if the action was late, or did not happen although the run reached the deadline.
    """
    limits = run.scenario.tables.limits
    return tuple(
        _deadline(run, f"{name}[{place}]", limit)
        for name in DEADLINES
        for place, limit in enumerate(getattr(limits, name))
    )


def _deadline(run: RunTables, key: str, limit: DeadlineTable) -> LimitFigure:
    name, after = limit.vehicle, run.beginning + nanoseconds(limit.after_s)
    done_at: Sequence[int] = ()
    match limit:
        case ModeLimit():
            action, tracking = f"in mode {limit.mode}", run.table(name, "tracking")
            done_at = tracking.at_ns[tracking["mode"] == limit.mode]
        case SourceLimit():
            action, source = f"source {limit.source} {limit.status}", sources(run, name)
            if limit.source in source:
                at, status, _ = source[limit.source]
                done_at = at[status == limit.status]
        case RecoveryLimit():
            action, done_at = f"recovered to {limit.error_m:g} m", _recovered(run, limit, after)
    took_s = min(((int(at) - after) / SECOND for at in done_at if at >= after), default=None)
    is_over = run.ran_ns >= nanoseconds(limit.after_s + limit.within_s)
    action, line = f"{action}, from {limit.after_s:g} s on", ""
    if is_over if took_s is None else took_s > limit.within_s:
        took = "did not happen" if took_s is None else f"after {took_s:.2f} s"
        line = f"limits.{key}.within_s = {limit.within_s:g}: {name}: {action}: {took}"
    return LimitFigure(
        limit=key, bound=limit.within_s, value=took_s, vehicle=name, action=action, message=line
    )


def _recovered(run: RunTables, limit: RecoveryLimit, after: int) -> list[int]:
    """Instant (ns) from which on a follower was neither degraded nor too far off the path.

    Empty if it is not recovered at the end, or without messages there.
    """
    errors = true_errors(run, limit.vehicle)
    known = ~np.isnan(errors.values)
    is_off = np.abs(errors.values[known]) > limit.error_m
    decided_at = run.table(limit.vehicle, "tracking").at_ns
    latest, end = after, run.beginning + run.ran_ns - UNRECORDED_NS
    for at, holds in (
        (decided_at, is_degraded(run, limit.vehicle)),
        (errors.at_ns[known], is_off),
    ):
        if not len(at) or at[-1] < max(after, end) or holds[-1]:
            return []
        latest = max(latest, int(at[holds].max(initial=0)))
    return [latest]


# ---- Limits that cannot be judged: messages are missing, or vehicles were driven late


def _judged_by_record(
    figures: Sequence[LimitFigure],
    limits: LimitsTable,
    unseen: Sequence[UnseenSpan],
    late_s: Mapping[str, float],
) -> tuple[LimitFigure, ...]:
    """Mark kept limits on vehicles that lack messages, or were driven late, for too long.

    `late_s` are the largest delays (s) with which each vehicle, lead first, was driven. The bounds
    are limits.holes_s_max and limits.late_s_max; explicit ones are limits of their own.
    """
    holes = defaultdict[Needed, list[UnseenSpan]](list)
    for span in unseen:
        holes[span.vehicle, span.kind].append(span)
    missing_s = {needed: sum([span.missing_s for span in spans]) for needed, spans in holes.items()}
    allowed, most_late = limits.holes_s_max or 0.0, limits.late_s_max
    most_late = USUAL_LATE_S if most_late is None else most_late
    late = {
        name: f"{name} was driven up to {seconds:.2f} s late"
        for name, seconds in late_s.items()
        if seconds > most_late + ROUNDING_S
    }
    reasons = late | {
        needed[0]: _words(holes[needed])
        for needed, missing in missing_s.items()
        if missing > allowed + ROUNDING_S
    }
    result = [_with_reason(figure, list(late_s), reasons) for figure in figures]
    if limits.holes_s_max is not None:
        worst, value = max(missing_s.items(), key=itemgetter(1), default=(None, 0.0))
        line = ""
        if worst is not None and value > allowed + ROUNDING_S:
            line = f"limits.holes_s_max = {allowed:g}: {value:.2f} s: {_words(holes[worst])}"
        result.append(LimitFigure(limit="holes_s_max", bound=allowed, value=value, message=line))
    if limits.late_s_max is not None:
        result += [
            LimitFigure(
                limit="late_s_max",
                bound=most_late,
                value=seconds,
                vehicle=name,
                message=f"limits.late_s_max = {most_late:g}: {late[name]}" if name in late else "",
            )
            for name, seconds in late_s.items()
        ]
    return tuple(result)


def _with_reason(
    figure: LimitFigure, names: Sequence[str], reasons: Mapping[str, str]
) -> LimitFigure:
    """Return a figure, marked as not judged if it is kept but messages are missing or late.

    A limit on a vehicle needs the messages of it, of the vehicle ahead and of the lead, another one
    those of all vehicles. `reasons` are those of the vehicles that lack messages.
    """
    if figure.broken or not reasons:
        return figure
    needed = names
    if figure.vehicle:
        place = names.index(figure.vehicle)
        needed = [figure.vehicle, names[max(place - 1, 0)], names[0]]
    found = [reasons[name] for name in needed if name in reasons]
    if not found:
        return figure
    line = f"limits.{figure.limit} = {figure.bound:g}: not judged: {found[0]}"
    return replace(figure, judged=False, message=line)


def _words(spans: Sequence[UnseenSpan]) -> str:
    first, more = spans[0], len(spans) - 1
    others = f" and {more} more {'time' if more == 1 else 'times'}" if more else ""
    return (
        f"the log lacks {first.kind}s of {first.vehicle} from {first.from_s:.2f} to "
        f"{first.to_s:.2f} s{others}"
    )


# ---- When a limit was first broken


SIGNALS: Mapping[Live, Callable[[RunTables, str], Signal]] = {
    "error": true_errors,
    "road_error": road_errors,
    "gap": true_gaps,
    "friction": friction,
    "self_estimate": self_estimate_errors,
    "blind": blind_distances,
}
"""Signals of which a limit bounds the magnitude, by `LimitRow.live`."""


def first_breach(run: RunTables, limit: Limit) -> int | None:
    """Instant (ns) at which a limit was first broken, None if it was kept.

    None also for a limit on a metric that only a whole run has, see `LimitRow.live`.
    """
    if limit.row.event:
        counted, most = _counted(limit, events(run)), int(limit.bound)
        return counted[most].at_ns if len(counted) > most else None
    if limit.row.live not in SIGNALS:
        return None
    names = run.names if limit.row.of_lead else run.followers
    breaches = []
    for name in [limit.vehicle] if limit.vehicle else names:
        at, values = SIGNALS[limit.row.live](run, name)
        sizes = np.abs(values)
        (rows,) = np.nonzero(sizes < limit.bound if limit.row.is_least else sizes > limit.bound)
        breaches += at[rows[:1]].tolist()
    return min(breaches, default=None)
