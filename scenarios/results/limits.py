"""The limits of a run: the figure of each one, kept, broken, or not judged for lack of messages."""

from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import TypeVar, get_args

import numpy as np

from scenarios.definition.run_limits import Limit, limits_of
from scenarios.definition.schema.limit_rows import LIMITS, LimitRow, Live, row_of
from scenarios.definition.schema.limit_tables import LimitsTable
from scenarios.definition.schema.plug_ins.point import PlugInError
from scenarios.results.deadlines import DeadlineFigure
from scenarios.results.events import Event
from scenarios.results.record import RecordKind, UnseenSpan
from scenarios.results.run_event import RunEvent, events
from scenarios.results.summary import LimitFigure, RunSummary
from scenarios.results.tables import RunTables
from scenarios.results.vehicle_figures import (
    Signal,
    VehicleSummary,
    blind_distances,
    friction,
    road_errors,
    self_estimate_errors,
    true_errors,
    true_gaps,
)

ROUNDING_S = 1e-9
USUAL_LATE_S = 1.0
"""Largest delay with which a vehicle may be driven without limits.late_s_max."""
Needed = tuple[str, RecordKind]
"""Vehicle and kind of its messages."""
AnyEvent = TypeVar("AnyEvent", Event, RunEvent)


def judged_by_record(
    figures: Sequence[LimitFigure],
    limits: LimitsTable,
    unseen: Sequence[UnseenSpan],
    late_s: Mapping[str, float],
) -> tuple[LimitFigure, ...]:
    """Mark kept limits on vehicles that lack messages, or were driven late, for too long.

    `late_s` are the largest delays (s) with which each vehicle, lead first, was driven. The bounds
    are limits.holes_s_max and limits.late_s_max; explicit ones are limits of their own.
    """
    names = list(late_s)
    spans: defaultdict[Needed, list[UnseenSpan]] = defaultdict(list)
    for span in unseen:
        spans[span.vehicle, span.kind].append(span)
    allowed, allowed_late = limits.holes_s_max or 0.0, limits.late_s_max
    if allowed_late is None:
        allowed_late = USUAL_LATE_S
    reasons: dict[Needed, str] = {}
    for name, late in late_s.items():
        if late > allowed_late + ROUNDING_S:
            line = f"{name} was driven up to {late:.2f} s late"
            reasons |= {(name, kind): line for kind in get_args(RecordKind)}
    reasons |= {
        needed: _words(missed)
        for needed, missed in spans.items()
        if sum([span.missing_s for span in missed]) > allowed + ROUNDING_S
    }
    result = [_judged(figure, names, reasons) for figure in figures] if reasons else [*figures]
    if limits.holes_s_max is not None:
        result.append(_holes(spans, allowed))
    if limits.late_s_max is not None:
        result += [_late(name, late, allowed_late) for name, late in late_s.items()]
    return tuple(result)


def _judged(
    figure: LimitFigure, names: Sequence[str], reasons: Mapping[Needed, str]
) -> LimitFigure:
    """Return a figure, marked as not judged if it is kept but messages are missing or late."""
    if figure.broken:
        return figure
    for needed in _needed(figure, names):
        if needed in reasons:
            line = f"limits.{figure.limit} = {figure.bound:g}: not judged: {reasons[needed]}"
            return replace(figure, judged=False, message=line)
    return figure


def _late(name: str, late_s: float, allowed_s: float) -> LimitFigure:
    line = ""
    if late_s > allowed_s + ROUNDING_S:
        line = f"limits.late_s_max = {allowed_s:g}: {name} was driven up to {late_s:.2f} s late"
    return LimitFigure(
        limit="late_s_max", bound=allowed_s, value=late_s, vehicle=name, message=line
    )


def _words(spans: Sequence[UnseenSpan]) -> str:
    first, more = spans[0], len(spans) - 1
    others = f" and {more} more {'time' if more == 1 else 'times'}" if more else ""
    return (
        f"the log lacks {first.kind}s of {first.vehicle} from {first.from_s:.2f} to "
        f"{first.to_s:.2f} s{others}"
    )


def _holes(spans: Mapping[Needed, Sequence[UnseenSpan]], allowed: float) -> LimitFigure:
    """Return the figure of the limit on holes: the largest missing time of one vehicle."""
    missing = {needed: sum([span.missing_s for span in missed]) for needed, missed in spans.items()}
    worst = max(missing, key=missing.__getitem__, default=None)
    value, line = (0.0, "") if worst is None else (missing[worst], "")
    if worst is not None and value > allowed + ROUNDING_S:
        line = f"limits.holes_s_max = {allowed:g}: {value:.2f} s: {_words(spans[worst])}"
    return LimitFigure(limit="holes_s_max", bound=allowed, value=value, message=line)


def _needed(figure: LimitFigure, names: Sequence[str]) -> Iterator[Needed]:
    """Yield the messages that a limit judges."""
    key = figure.limit.removeprefix(f"{figure.vehicle}.")
    row = LIMITS["collisions_max"] if key == "after_collision" else row_of(key)
    if row is not None:
        for name in _own(figure, row, names):
            if row.by_decisions:
                yield name, "decision"
            if row.by_truth:
                for witness in _witnesses(row, name, names):
                    yield witness, "true pose"
        return
    yield figure.vehicle, "decision"  # a deadline
    if key.startswith("recovery"):
        yield figure.vehicle, "true pose"
        yield names[0], "true pose"


def _own(figure: LimitFigure, row: LimitRow, names: Sequence[str]) -> Sequence[str]:
    if figure.vehicle:
        return [figure.vehicle]
    return names if row.of_lead else names[1:]


def _witnesses(row: LimitRow, name: str, names: Sequence[str]) -> Sequence[str]:
    match row.witness:
        case "all":
            return names
        case "lead":
            return [name, names[0]]
        case "predecessor" if name != names[0]:
            return [name, names[names.index(name) - 1]]
    return [name]


# ---- Limits judged by the figures and events of a run: each with its figure and its instant


def collision_ends_run(limits: LimitsTable, collisions: int) -> bool:
    """Whether the run has to end after this number of collisions."""
    after, most = limits.after_collision, limits.collisions_max
    if after == "continue" or (after is None and most is None):
        return False
    return collisions > (most or 0)


def limit_figures(
    limits: LimitsTable,
    events: Sequence[RunEvent],
    vehicles: Sequence[VehicleSummary],
    deadlines: Sequence[DeadlineFigure] = (),
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
    known = list(limits_of(limits))
    counts = [_count(limit, events) for limit in known if limit.row.event]
    if limits.collisions_max is None and limits.after_collision == "end":
        counts = [_first_collision(events), *counts]
    incomplete = {span.vehicle for span in unseen}
    figures = [
        result
        for limit in known
        if not limit.row.event
        for result in _figures(limit, known, vehicles, incomplete)
    ]
    every = (*counts, *figures, *map(_deadline, deadlines))
    return judged_by_record(every, limits, unseen, late_s or {row.name: 0.0 for row in vehicles})


def failure_reason(reason: str, broken: Sequence[str]) -> str:
    """Join the reason of an early end with broken limits that it does not mention."""
    return "; ".join([*filter(None, [reason]), *(line for line in broken if line not in reason)])


def broken_by(limit: Limit, summary: RunSummary) -> bool:
    """Whether a run broke a limit, of a largest figure that no vehicle has as if it were 0.

    Raises PlugInError if a class of the user failed to measure the figure.
    """
    if limit.row.event:
        return len(_counted(limit, summary.events)) > limit.bound
    rows = [row for row in summary.vehicles if limit.vehicle in {"", row.name}]
    if without := [row.name for row in rows if _is_unmeasured(limit.row, row)]:
        raise PlugInError(f"{limit}: {unmeasured(limit.row.own_figure, without[0])}")
    known = [value for row in rows if (value := _figure(limit.row, row)) is not None]
    return any(map(limit.is_beyond, known or ([] if limit.row.is_least else [0.0])))


def _counted(limit: Limit, events: Sequence[AnyEvent]) -> list[AnyEvent]:
    """Events that a limit counts; a limit of one vehicle counts those that involve it."""
    return [
        event
        for event in events
        if event.kind == limit.row.event and (not limit.vehicle or limit.vehicle in event.vehicles)
    ]


def _count(limit: Limit, events: Sequence[RunEvent]) -> LimitFigure:
    counted, most = _counted(limit, events), int(limit.bound)
    line = f"limits.{limit.name} = {most}: {counted[most].line}" if len(counted) > most else ""
    return LimitFigure(
        limit=limit.name, bound=most, value=len(counted), vehicle=limit.vehicle, message=line
    )


def _first_collision(events: Sequence[RunEvent]) -> LimitFigure:
    """Implicit limit of a run that ends at the first collision."""
    collisions = [event for event in events if event.kind == "collision"]
    line = f'limits.after_collision = "end": {collisions[0].line}' if collisions else ""
    return LimitFigure(limit="after_collision", bound=0, value=len(collisions), message=line)


def _figures(
    limit: Limit,
    limits: Sequence[Limit],
    vehicles: Sequence[VehicleSummary],
    incomplete: Collection[str],
) -> Iterator[LimitFigure]:
    """Yield the figure of each vehicle that a limit applies to, or one None if none is known.

    An `incomplete` vehicle, which lacks messages, has one in any case.
    """
    own = {other.vehicle for other in limits if other.key == limit.key and other.vehicle}
    if limit.vehicle:
        rows = [row for row in vehicles if row.name == limit.vehicle]
    else:
        rows = [row for row in vehicles if row.name not in own]
    known = [(row, value) for row in rows if (value := _figure(limit.row, row)) is not None]
    for row, figure in known:
        line = _breach(limit, row, figure) if limit.is_beyond(figure) else ""
        yield LimitFigure(
            limit=limit.name, bound=limit.bound, value=figure, vehicle=row.name, message=line
        )
    judged = [row for row in rows if row.role == "follower" or limit.row.of_lead]
    failed = [row.name for row in judged if _is_unmeasured(limit.row, row)]
    for name in failed:
        line = f"limits.{limit.name} = {limit.bound:g}: not judged: "
        yield LimitFigure(
            limit=limit.name,
            bound=limit.bound,
            value=None,
            vehicle=name,
            message=line + unmeasured(limit.row.own_figure, name),
            judged=False,
        )
    names = [*(row.name for row, _ in known), *failed]
    lacking = [row.name for row in judged if row.name in incomplete and row.name not in names]
    for name in lacking:
        yield LimitFigure(limit=limit.name, bound=limit.bound, value=None, vehicle=name)
    if not names and not lacking and (judged or limit.vehicle or not own):
        yield LimitFigure(limit=limit.name, bound=limit.bound, value=None, vehicle=limit.vehicle)


def _figure(row: LimitRow, vehicle: VehicleSummary) -> float | None:
    if vehicle.role == "lead" and not row.of_lead:
        return None
    if row.own_figure:
        return vehicle.own_figures.get(row.own_figure)
    figure: float | None = attrgetter(row.figure)(vehicle)
    return figure


def _is_unmeasured(row: LimitRow, vehicle: VehicleSummary) -> bool:
    """Whether a class of the user failed to measure its figure, or is not here."""
    return bool(row.own_figure) and row.own_figure not in vehicle.own_figures


def unmeasured(figure: str, vehicle: str) -> str:
    return f"{vehicle} has no figure {figure}, because its class failed or is missing"


def _breach(limit: Limit, vehicle: VehicleSummary, figure: float) -> str:
    at = getattr(vehicle, limit.row.at) if limit.row.at else None
    breach = limit.row.breach.format(figure=figure, at=at or 0.0)
    return f"limits.{limit.name} = {limit.bound:g}: {vehicle.name} {breach}"


def _deadline(deadline: DeadlineFigure) -> LimitFigure:
    line = ""
    if deadline.broken:
        after = "did not happen" if deadline.took_s is None else f"after {deadline.took_s:.2f} s"
        limit = f"limits.{deadline.key}.within_s = {deadline.within_s:g}"
        line = f"{limit}: {deadline.vehicle}: {deadline.action}: {after}"
    return LimitFigure(
        limit=deadline.key,
        bound=deadline.within_s,
        value=deadline.took_s,
        vehicle=deadline.vehicle,
        action=deadline.action,
        message=line,
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
