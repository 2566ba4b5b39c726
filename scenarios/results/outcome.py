"""The outcome of a run in one line, with the most important fact first."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from scenarios.results.events import EventKind
from scenarios.results.links import lost_in_transport
from scenarios.results.run_event import RunEvent
from scenarios.results.summary import RunSummary
from scenarios.results.traffic import FIGURE_OF
from scenarios.results.vehicle_figures import VehicleSummary

LATE_RATIO = 0.01
"""Share of late ticks above which a run was not in real time."""
INCOMPLETE_RATIO = 0.01
"""Share of poses missing in the log above which a run has failed as incomplete."""


def with_outcome_line(summary: RunSummary) -> RunSummary:
    """Fill in the outcome line, unless the summary has one."""
    return summary if summary.outcome_line else replace(summary, outcome_line=_line(summary))


def incomplete(vehicles: Sequence[VehicleSummary]) -> str:
    """Reason of a run of whose poses more than INCOMPLETE_RATIO are missing in the log."""
    missing = sum([vehicle.missing_poses for vehicle in vehicles])
    due = missing + sum([vehicle.poses for vehicle in vehicles])
    if missing <= INCOMPLETE_RATIO * due:
        return ""
    worst = max(vehicles, key=lambda vehicle: vehicle.missing_poses)
    return f"{missing} of {due} poses not recorded, most of them of {worst.name}"


def late_ratio(vehicles: Sequence[VehicleSummary]) -> float:
    """Share of the ticks of all vehicles that began late."""
    ticks = sum([vehicle.ticks for vehicle in vehicles])
    return sum([vehicle.late_ticks for vehicle in vehicles]) / ticks if ticks else 0.0


def _line(summary: RunSummary) -> str:
    incidents = list(_incidents(summary))
    if summary.outcome == "completed" and not incidents:
        caveats = list(_caveats(summary))
        ok = f"OK ({', '.join(caveats)})" if caveats else "OK"
        facts = [_count(summary), _duration(summary), _worst_error(summary), _own_events(summary)]
        if summary.limits:
            facts.append(f"limits: {_limits(summary)}")
        return f"{ok}: {', '.join(filter(None, facts))}"
    facts = incidents[:]
    if not any(event.kind == "lane_departure" for event in summary.events):
        facts.append(_worst_error(summary))
    if summary.ran_s:
        facts.append(_collisions(summary) if incidents else _own_events(summary))
    match summary.outcome:
        case "failed":
            head = f"FAILED: {_reasons(summary.reason)}"
            facts = [head, f"ran {_duration(summary)}", *facts]
        case "incomplete":
            facts = [f"INCOMPLETE: {summary.reason}", *facts]
        case "running":
            facts = [f"RUNNING: {_duration(summary)}", *facts]
        case "completed":
            facts.append(f"limits: {_limits(summary)}")
    return "; ".join(filter(None, (*facts, *_caveats(summary))))


def _count(summary: RunSummary) -> str:
    count = len(summary.vehicles)
    return "1 vehicle" if count == 1 else f"{count} vehicles"


def _duration(summary: RunSummary) -> str:
    planned = f"{summary.duration_s:.1f} s"
    ran = f"{summary.ran_s:.1f} s"
    return ran if ran == planned else f"{summary.ran_s:.1f} of {planned}"


def _reasons(reason: str) -> str:
    """The first reason of a failure, and the number of the others."""
    first, *others = reason.split("; ")
    more = f"{len(others)} more {'reason' if len(others) == 1 else 'reasons'}"
    return f"{first}; {more}" if others else first


def _limits(summary: RunSummary) -> str:
    """State of the limits of a run that broke none."""
    names = dict.fromkeys(limit.limit for limit in summary.limits)
    judged = [limit for limit in summary.limits if limit.judged]
    measured = {limit.limit for limit in judged if limit.value is not None}
    if not names:
        return "none set"
    missing = len(names) - len(measured)
    return f"{len(measured)} kept{f', {missing} not measured' if missing else ''}"


def _caveats(summary: RunSummary) -> Iterator[str]:
    """Facts that make the figures incomplete or the run slower than real time."""
    missing = sum(hole.poses for hole in summary.holes)
    if missing:
        yield f"{missing} {'pose' if missing == 1 else 'poses'} not recorded"
    absent = sum(map(lost_in_transport, summary.links))
    if absent:
        yield f"{absent} {'message' if absent == 1 else 'messages'} did not arrive"
    late_messages = sum([row.late for row in summary.links])
    share = late_messages / max(sum([row.judged for row in summary.links]), 1)
    if share > LATE_RATIO:
        yield f"{100.0 * share:.2g} % of the messages late"
    late = late_ratio(summary.vehicles)
    if late > LATE_RATIO:
        yield f"{100.0 * late:.2g} % of the ticks late"


def length(metres: float) -> str:
    return f"{100.0 * metres:.1f} cm" if metres < 0.9995 else f"{metres:.2f} m"


def _furthest_off(vehicles: Sequence[VehicleSummary]) -> VehicleSummary | None:
    measured = [vehicle for vehicle in vehicles if vehicle.cross_track_error_m_max is not None]
    return max(measured, key=lambda vehicle: vehicle.cross_track_error_m_max or 0.0, default=None)


def _worst_error(summary: RunSummary) -> str:
    worst = _furthest_off(summary.vehicles)
    if worst is None:
        return ""
    return f"worst error {length(worst.cross_track_error_m_max or 0.0)} ({worst.name})"


def _own_events(summary: RunSummary) -> str:
    """Number of the user's events, where there are no others."""
    count = len(_of(summary, "own"))
    return f"{count} own event{'s' * (count > 1)}" if count else "no events"


def _of(summary: RunSummary, kind: EventKind) -> list[RunEvent]:
    return [event for event in summary.events if event.kind == kind]


def _vehicles_of(events: Sequence[RunEvent], place: int = 0) -> list[str]:
    return list(dict.fromkeys(event.vehicles[place] for event in events))


def _share(summary: RunSummary, names: Sequence[str]) -> str:
    return f"{len(names)} of {_count(summary)}"


def _collisions(summary: RunSummary) -> str:
    """The number of collisions, if none of them is among the incidents."""
    return "" if _of(summary, "collision") else "0 collisions"


def _incidents(summary: RunSummary) -> Iterator[str]:
    """Yield what went wrong on the road, the worst first."""
    yield from _collided(summary)
    yield from _silent(summary)
    yield from _departed(summary)
    if lost := _vehicles_of(_of(summary, "path_lost")):
        yield f"{_share(summary, lost)} lost {'its' if len(lost) == 1 else 'their'} path"
    yield from _stopped(summary)
    yield from _nearly_collided(summary)
    yield from _dissolved(summary)
    if slid := _vehicles_of(_of(summary, "slide")):
        yield f"{_share(summary, slid)} slid"
    if doubtful := _vehicles_of(_of(summary, "distrust")):
        yield f"sources distrusted: {', '.join(doubtful)}"


def _collided(summary: RunSummary) -> Iterator[str]:
    if events := _of(summary, "collision"):
        first = events[0]
        pair = f"{' and '.join(first.vehicles)} {first.when}"
        many = f"{len(events)} collisions, first {pair}"
        yield many if len(events) > 1 else f"1 collision, {pair}"


def _silent(summary: RunSummary) -> Iterator[str]:
    silent = [vehicle for vehicle in summary.vehicles if vehicle.silent_from_s is not None]
    if silent and summary.outcome != "running":
        first = min(silent, key=lambda vehicle: vehicle.silent_from_s or 0.0)
        since = f"{first.name} silent from {first.silent_from_s:.2f} s"
        names = [vehicle.name for vehicle in silent]
        yield since if len(silent) == 1 else f"{_share(summary, names)} silent, first {since}"


def _departed(summary: RunSummary) -> Iterator[str]:
    left = _vehicles_of(_of(summary, "lane_departure"))
    if not left:
        return
    worst = _furthest_off([vehicle for vehicle in summary.vehicles if vehicle.name in left])
    furthest = ""
    if worst is not None:
        furthest = f", worst {worst.name} {length(worst.cross_track_error_m_max or 0.0)}"
        if worst.cross_track_error_max_at_s is not None:
            furthest += f" at {worst.cross_track_error_max_at_s:.2f} s"
    yield f"{_share(summary, left)} left the lane{furthest}"


def _stopped(summary: RunSummary) -> Iterator[str]:
    events = _of(summary, "stop")
    if not events:
        return
    stopped = _vehicles_of(events)
    first = events[0]
    blind = max((vehicle.reaction.blind_m for vehicle in summary.vehicles), default=0.0)
    beyond = f", up to {blind:.1f} m blind" if blind >= 0.05 else ""
    yield (
        f"{_share(summary, stopped)} braked without a reliable source, first {first.vehicles[0]} "
        f"{first.when}{beyond}"
    )


TRAFFIC: Mapping[EventKind, str] = {
    "stranded": "stands for {:.0f} s although the lead drives",
    "falls_behind": "falls behind by up to {:.0f} m",
    "hard_braking": "brakes at up to {:.1f} m/s² without a cause ahead",
    "overspeed": "exceeds the lead's speed by up to {:.1f} m/s",
    "overridden": "overridden by its guard for {:.2f} of the time",
}
"""What a traffic engineer would notice, the worst first, with its figure."""


def _dissolved(summary: RunSummary) -> Iterator[str]:
    """Yield the worst event of the worst kind of TRAFFIC, and the names of the other kinds."""
    kinds = [kind for kind in TRAFFIC if _of(summary, kind)]
    if not kinds:
        return
    kind, figure = kinds[0], FIGURE_OF.get(kinds[0], "duration_s")
    events = _of(summary, kind)
    worst = max(events, key=lambda event: event.figures.get(figure, 0.0))
    names = _vehicles_of(events)
    text = TRAFFIC[kind].format(worst.figures.get(figure, 0.0))
    more = f" ({_share(summary, names)})" if len(names) > 1 else ""
    others = ", ".join(kind.replace("_", " ") for kind in kinds[1:])
    yield f"{worst.vehicles[0]} {text}, {worst.when}{more}{others and f'; also: {others}'}"


def _nearly_collided(summary: RunSummary) -> Iterator[str]:
    events = _of(summary, "near_miss")
    if events:
        closest = min(events, key=lambda event: event.figures.get("gap_m_min", 0.0))
        gap = closest.figures.get("gap_m_min", 0.0)
        count = "1 near miss" if len(events) == 1 else f"{len(events)} near misses"
        pair = f"{' and '.join(closest.vehicles)} {closest.when}"
        yield f"{count}, closest {gap:.2f} m, {pair}"
