"""Limits judged by the figures and events of a run: each with its figure and its instant."""

from collections.abc import Collection, Iterator, Sequence
from operator import attrgetter

from scenarios.definition.run_limits import Limit, limits_of
from scenarios.definition.schema.limit_rows import LimitRow
from scenarios.definition.schema.limit_tables import LimitsTable
from scenarios.definition.schema.plug_ins.guards import PlugInError
from scenarios.results.events.run_event import RunEvent
from scenarios.results.holes import UnseenSpan
from scenarios.results.limits.deadlines import DeadlineFigure
from scenarios.results.limits.unjudged import judged_by_record
from scenarios.results.summary import LimitFigure, RunSummary
from scenarios.results.vehicles.vehicle_figures import VehicleSummary


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
) -> tuple[LimitFigure, ...]:
    """Return the figure of each limit, kept, broken or not judged; `events` are in order of time.

    A limit on a figure of vehicles is there once for each of them that has that figure or lacks
    messages, or without one where no vehicle has it. A limit of one vehicle replaces that of the
    convoy for it. Limits over messages that are missing in the log, in the times `unseen`, are not
    judged.
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
    names = [vehicle.name for vehicle in vehicles]
    return judged_by_record(every, names, unseen, limits.holes_s_max)


def broken_limits(
    limits: LimitsTable,
    events: Sequence[RunEvent],
    vehicles: Sequence[VehicleSummary],
    deadlines: Sequence[DeadlineFigure] = (),
    unseen: Sequence[UnseenSpan] = (),
) -> list[str]:
    """List limits broken or not judged, a line each; `events` are in order of time."""
    results = limit_figures(limits, events, vehicles, deadlines, unseen)
    return [result.message for result in results if result.broken]


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


def _counted(limit: Limit, events: Sequence[RunEvent]) -> list[RunEvent]:
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
