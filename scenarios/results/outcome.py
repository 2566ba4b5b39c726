"""The outcome of a run in one line, with the most important fact first."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
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
    incidents, caveats = list(_incidents(summary)), list(_caveats(summary))
    kinds = Counter(event.kind for event in summary.events)
    own = _number(kinds["own"], "own event") if kinds["own"] else "no events"
    worst = _worst_error(summary)
    if summary.outcome == "completed" and not incidents:
        ok = f"OK ({', '.join(caveats)})" if caveats else "OK"
        limits = f"limits: {_limits(summary)}" if summary.limits else ""
        facts = [_count(summary), _duration(summary), worst, own, limits]
        return f"{ok}: {', '.join(filter(None, facts))}"
    facts = [*incidents, "" if kinds["lane_departure"] else worst]
    if summary.ran_s:
        facts.append(own if not incidents else "" if kinds["collision"] else "0 collisions")
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
    return "; ".join(filter(None, (*facts, *caveats)))


def _number(things: Sequence[object] | int, one: str, several: str = "") -> str:
    count = things if isinstance(things, int) else len(things)
    return f"1 {one}" if count == 1 else f"{count} {several or f'{one}s'}"


def _count(summary: RunSummary) -> str:
    return _number(summary.vehicles, "vehicle")


def _duration(summary: RunSummary) -> str:
    planned = f"{summary.duration_s:.1f} s"
    ran = f"{summary.ran_s:.1f} s"
    return ran if ran == planned else f"{summary.ran_s:.1f} of {planned}"


def _reasons(reason: str) -> str:
    """The first reason of a failure, and the number of the others."""
    first, *others = reason.split("; ")
    return f"{first}; {_number(others, 'more reason')}" if others else first


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
        yield f"{_number(missing, 'pose')} not recorded"
    absent = sum(map(lost_in_transport, summary.links))
    if absent:
        yield f"{_number(absent, 'message')} did not arrive"
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


# ---- What went wrong on the road


def _names(events: Sequence[RunEvent]) -> list[str]:
    return list(dict.fromkeys(event.vehicles[0] for event in events))


def _share(summary: RunSummary, names: Sequence[str]) -> str:
    return f"{len(names)} of {_count(summary)}"


def _pair(event: RunEvent) -> str:
    return f"{' and '.join(event.vehicles)} {event.when}"


def _collided(_: RunSummary, events: Sequence[RunEvent]) -> str:
    first = "first " if len(events) > 1 else ""
    return f"{_number(events, 'collision')}, {first}{_pair(events[0])}"


def _silent(summary: RunSummary, _: Sequence[RunEvent]) -> str:
    silent = [vehicle for vehicle in summary.vehicles if vehicle.silent_from_s is not None]
    if not silent or summary.outcome == "running":
        return ""
    first = min(silent, key=lambda vehicle: vehicle.silent_from_s or 0.0)
    since = f"{first.name} silent from {first.silent_from_s:.2f} s"
    names = [vehicle.name for vehicle in silent]
    return since if len(silent) == 1 else f"{_share(summary, names)} silent, first {since}"


def _departed(summary: RunSummary, events: Sequence[RunEvent]) -> str:
    left, furthest = _names(events), ""
    worst = _furthest_off([vehicle for vehicle in summary.vehicles if vehicle.name in left])
    if worst is not None:
        furthest = f", worst {worst.name} {length(worst.cross_track_error_m_max or 0.0)}"
        if worst.cross_track_error_max_at_s is not None:
            furthest += f" at {worst.cross_track_error_max_at_s:.2f} s"
    return f"{_share(summary, left)} left the lane{furthest}"


def _lost(summary: RunSummary, events: Sequence[RunEvent]) -> str:
    lost = _names(events)
    return f"{_share(summary, lost)} lost {'its' if len(lost) == 1 else 'their'} path"


def _stopped(summary: RunSummary, events: Sequence[RunEvent]) -> str:
    first, share = events[0], _share(summary, _names(events))
    blind = max((vehicle.reaction.blind_m for vehicle in summary.vehicles), default=0.0)
    beyond = f", up to {blind:.1f} m blind" if blind >= 0.05 else ""
    return (
        f"{share} braked without a reliable source, first {first.vehicles[0]} {first.when}{beyond}"
    )


def _nearly_collided(_: RunSummary, events: Sequence[RunEvent]) -> str:
    closest = min(events, key=lambda event: event.figures.get("gap_m_min", 0.0))
    count, gap = _number(events, "near miss", "near misses"), closest.figures.get("gap_m_min", 0.0)
    return f"{count}, closest {gap:.2f} m, {_pair(closest)}"


TRAFFIC: Mapping[EventKind, str] = {
    "stranded": "stands for {:.0f} s although the lead drives",
    "falls_behind": "falls behind by up to {:.0f} m",
    "hard_braking": "brakes at up to {:.1f} m/s² without a cause ahead",
    "overspeed": "exceeds the lead's speed by up to {:.1f} m/s",
    "overridden": "overridden by its guard for {:.2f} of the time",
}
"""What a traffic engineer would notice, the worst first, with its figure."""


def _dissolved(summary: RunSummary, _: Sequence[RunEvent]) -> str:
    """The worst event of the worst kind of TRAFFIC, and the names of the other kinds."""
    by_kind = {kind: [one for one in summary.events if one.kind == kind] for kind in TRAFFIC}
    kinds = [kind for kind, found in by_kind.items() if found]
    if not kinds:
        return ""
    kind, *others = kinds
    figure = FIGURE_OF.get(kind, "duration_s")
    worst = max(by_kind[kind], key=lambda event: event.figures.get(figure, 0.0))
    names, text = _names(by_kind[kind]), TRAFFIC[kind].format(worst.figures.get(figure, 0.0))
    more = f" ({_share(summary, names)})" if len(names) > 1 else ""
    also = f"; also: {', '.join(other.replace('_', ' ') for other in others)}" if others else ""
    return f"{worst.vehicles[0]} {text}, {worst.when}{more}{also}"


INCIDENTS: Sequence[tuple[EventKind | None, Callable[[RunSummary, Sequence[RunEvent]], str]]] = (
    ("collision", _collided),
    (None, _silent),
    ("lane_departure", _departed),
    ("path_lost", _lost),
    ("stop", _stopped),
    ("near_miss", _nearly_collided),
    (None, _dissolved),
    ("slide", lambda run, events: f"{_share(run, _names(events))} slid"),
    ("distrust", lambda _, events: f"sources distrusted: {', '.join(_names(events))}"),
)
"""What went wrong on the road, the worst first: events of a kind, and their description."""


def _incidents(summary: RunSummary) -> Iterator[str]:
    for kind, describe in INCIDENTS:
        events = [event for event in summary.events if event.kind == kind]
        if (events or kind is None) and (text := describe(summary, events)):
            yield text
