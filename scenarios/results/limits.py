"""Limits of a scenario that a run keeps or breaks: each with its figure and its instant."""

from collections.abc import Iterator, Sequence

from scenarios.definition.schema.limits import LimitsTable
from scenarios.results.degradation.deadlines import DeadlineFigure
from scenarios.results.events.encounters import EventKind
from scenarios.results.events.run_event import RunEvent
from scenarios.results.metrics import Metrics
from scenarios.results.summary import LimitFigure
from scenarios.results.vehicles.figures import VehicleSummary
from vehicles.messages import Message, TruePose

COUNTED: dict[str, EventKind] = {
    "collisions_max": "collision",
    "lane_departures_max": "lane_departure",
    "near_misses_max": "near_miss",
    "paths_lost_max": "path_lost",
    "stops_max": "stop",
    "distrusts_max": "distrust",
}
"""Limits on the number of events of a kind."""
OF_VEHICLES = (
    "cross_track_error_m_max",
    "true_gap_m_min",
    "believed_minus_true_error_m_max",
    "blind_m_max",
    "friction_ratio_max",
)
"""Limits on figures of vehicles."""


def collision_ends_run(limits: LimitsTable, collisions: int) -> bool:
    """Tell whether the run has to end after so many collisions."""
    after, most = limits.after_collision, limits.collisions_max
    if after == "go_on" or (after is None and most is None):
        return False
    return collisions > (most or 0)


def limit_figures(
    limits: LimitsTable,
    events: Sequence[RunEvent],
    vehicles: Sequence[VehicleSummary],
    deadlines: Sequence[DeadlineFigure] = (),
) -> tuple[LimitFigure, ...]:
    """Say how each limit was kept or broken; `events` are in order of time.

    A limit on a figure of vehicles is there once for each of them that has that figure, or without
    one where nobody has.
    """
    return (
        *_counts(limits, events),
        *_figures(limits, vehicles),
        *map(_deadline, deadlines),
    )


def broken_limits(
    limits: LimitsTable,
    events: Sequence[RunEvent],
    vehicles: Sequence[VehicleSummary],
    deadlines: Sequence[DeadlineFigure] = (),
) -> list[str]:
    """Say which limits were broken, a line each; `events` are in order of time."""
    found = limit_figures(limits, events, vehicles, deadlines)
    return [one.line for one in found if one.broken]


class LimitWatch:
    """An observer that knows when a run has to end early: after collisions that break a limit.

    `metrics` take each message before it does. `reason` is empty until then.
    """

    kinds: frozenset[type[Message]] = frozenset({TruePose})  # nothing else brings collisions

    def __init__(self, limits: LimitsTable, metrics: Metrics) -> None:
        self._limits = limits
        self._metrics = metrics
        self.reason = ""

    def listen(self, at: int, _pose: Message) -> None:
        """Look whether the limits require the end of the run, at instant `at` (ns)."""
        collisions = self._metrics.events.collisions
        if collisions and not self.reason and collision_ends_run(self._limits, collisions):
            ran_ns = max(at - (self._metrics.start_at or 0), 0)
            self.reason = why_failed("", self.broken(ran_ns))

    def broken(self, ran_ns: int) -> list[str]:
        """List the limits that are broken by now, after `ran_ns`, a line each."""
        return broken_limits(
            self._limits,
            self._metrics.events.events(),
            self._metrics.vehicle_summaries(ran_ns),
            self._metrics.deadlines.figures(ran_ns),
        )


def why_failed(reason: str, broken: Sequence[str]) -> str:
    """Join why a run ended early with the limits that it broke and that are not said there."""
    return "; ".join([*filter(None, [reason]), *(line for line in broken if line not in reason)])


def _counts(limits: LimitsTable, events: Sequence[RunEvent]) -> Iterator[LimitFigure]:
    for key, kind in COUNTED.items():
        most = getattr(limits, key)
        name = f"{key} = {most}"
        if kind == "collision" and most is None and limits.after_collision == "end":
            name, most = 'after_collision = "end"', 0
        if most is None:
            continue
        found = [event for event in events if event.kind == kind]
        line = f"limits.{name}: {found[most].line}" if len(found) > most else ""
        yield LimitFigure(limit=name.split(" ")[0], bound=most, figure=len(found), line=line)


def _figures(limits: LimitsTable, vehicles: Sequence[VehicleSummary]) -> Iterator[LimitFigure]:
    """Give each limit on a figure of vehicles; one without a figure where nobody has it."""
    found: dict[str, list[LimitFigure]] = {}
    for row in vehicles:
        for key, figure, said in _of_vehicle(row):
            bound = getattr(limits, key)
            if bound is None or figure is None:
                continue
            broken = figure < bound if key.endswith("_min") else figure > bound
            line = f"limits.{key} = {bound:g}: {row.name} {said}" if broken else ""
            one = LimitFigure(limit=key, bound=bound, figure=figure, vehicle=row.name, line=line)
            found.setdefault(key, []).append(one)
    for key in OF_VEHICLES:
        bound = getattr(limits, key)
        if bound is not None:
            yield from found.get(key, [LimitFigure(limit=key, bound=bound, figure=None)])


def _of_vehicle(row: VehicleSummary) -> Iterator[tuple[str, float | None, str]]:
    """Give the limits on figures of a vehicle: key, figure, and what is said if it is broken."""
    error, gap = row.cross_track_error_m_max, row.true_gap_m_min
    belief, blind = row.believed_minus_true_error_m_max, row.reaction.blind_m
    friction = row.friction_ratio_max
    yield (
        "cross_track_error_m_max",
        error,
        f"was {error or 0.0:.2f} m off the lead's path, "
        f"{row.cross_track_error_max_at_s or 0.0:.2f} s after the start",
    )
    yield (
        "true_gap_m_min",
        gap,
        f"was {gap or 0.0:.2f} m from the vehicle ahead, "
        f"{row.true_gap_min_at_s or 0.0:.2f} s after the start",
    )
    if row.role == "follower":
        yield (
            "believed_minus_true_error_m_max",
            belief,
            f"was {belief or 0.0:.2f} m wrong about its error",
        )
        yield "blind_m_max", blind, f"drove {blind:.2f} m beyond the road that it knew"
    yield "friction_ratio_max", friction, f"used {friction or 0.0:.2f} of the friction"


def _deadline(one: DeadlineFigure) -> LimitFigure:
    line = ""
    if one.broken:
        late = "not" if one.took_s is None else f"{one.took_s:.2f} s after it"
        line = f"limits.{one.key}.within_s = {one.within_s:g}: {one.vehicle}: {one.what}: {late}"
    return LimitFigure(
        limit=one.key,
        bound=one.within_s,
        figure=one.took_s,
        vehicle=one.vehicle,
        what=one.what,
        line=line,
    )
