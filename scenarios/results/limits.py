"""Limits of a scenario that a run breaks: each with its figure and its instant."""

from collections.abc import Iterator, Sequence

from scenarios.definition.schema.tables import LimitsTable
from scenarios.results.encounters import EventKind
from scenarios.results.events import RunEvent
from scenarios.results.summary import VehicleSummary

COUNTED: dict[str, EventKind] = {
    "collisions_max": "collision",
    "lane_departures_max": "lane_departure",
    "near_misses_max": "near_miss",
    "paths_lost_max": "path_lost",
}
"""Limits on the number of events of a kind."""


def collision_ends_run(limits: LimitsTable, collisions: int) -> bool:
    """Tell whether the run has to end after so many collisions."""
    after, most = limits.after_collision, limits.collisions_max
    if after == "go_on" or (after is None and most is None):
        return False
    return collisions > (most or 0)


def broken_limits(
    limits: LimitsTable, events: Sequence[RunEvent], vehicles: Sequence[VehicleSummary]
) -> list[str]:
    """Say which limits were broken, a line each; `events` are in order of time."""
    return [*_counts(limits, events), *_figures(limits, vehicles)]


def why_failed(reason: str, broken: Sequence[str]) -> str:
    """Join why a run ended early with the limits that it broke and that are not said there."""
    return "; ".join([*filter(None, [reason]), *(line for line in broken if line not in reason)])


def _counts(limits: LimitsTable, events: Sequence[RunEvent]) -> Iterator[str]:
    for key, kind in COUNTED.items():
        most = getattr(limits, key)
        name = f"{key} = {most}"
        if kind == "collision" and most is None and limits.after_collision == "end":
            name, most = 'after_collision = "end"', 0
        found = [event for event in events if event.kind == kind]
        if most is not None and len(found) > most:
            yield f"limits.{name}: {found[most].line}"


def _figures(limits: LimitsTable, vehicles: Sequence[VehicleSummary]) -> Iterator[str]:
    error, gap = limits.cross_track_error_m_max, limits.true_gap_m_min
    for row in vehicles:
        most, least = row.cross_track_error_m_max, row.true_gap_m_min
        if error is not None and most is not None and most > error:
            yield (
                f"limits.cross_track_error_m_max = {error:g}: {row.name} was {most:.2f} m off the "
                f"lead's path, {row.cross_track_error_max_at_s:.2f} s after the start"
            )
        if gap is not None and least is not None and least < gap:
            yield (
                f"limits.true_gap_m_min = {gap:g}: {row.name} was {least:.2f} m from the vehicle "
                f"ahead, {row.true_gap_min_at_s:.2f} s after the start"
            )
