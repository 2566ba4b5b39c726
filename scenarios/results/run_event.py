"""Events of a run as the summary and the log list them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scenarios.results.events import (
    Event,
    EventKind,
    distrusts,
    encounters,
    in_time_order,
    lane_departures,
    lost_paths,
    slides,
    stops,
)
from scenarios.results.own_measures import own_events
from scenarios.results.record import seen_before
from scenarios.results.tables import RunTables, once
from scenarios.results.traffic import overridden, traffic_events
from vehicles.messages import Level

OF_DECISIONS: frozenset[EventKind] = frozenset({"path_lost", "stop", "distrust", "overridden"})
"""Events in the decisions of a follower; the others are in true poses."""
OF_FOLLOWERS = (lane_departures, lost_paths, distrusts, traffic_events, overridden)
"""Events of one follower, as functions of the run and its name."""
OF_VEHICLES = (slides, stops)
"""Events of one vehicle."""
SENTENCES: Mapping[EventKind, str] = {
    "collision": "{1} and {0}, closing at {closing_speed_mps:.1f} m/s",
    "near_miss": "{1} within {gap_m_min:.2f} m of {0}",
    "lane_departure": "{0} across the edge of the lane",
    "path_lost": "{0} has no known path to steer along",
    "slide": "{0} uses all available friction",
    "stop": "{0} brakes to a stop without a reliable source",
    "distrust": "{1} distrusts {0}",
    "falls_behind": "the gap of {0} is wider than its law and the age of its data explain",
    "stranded": "{0} stands although the lead drives",
    "overspeed": "{0} is faster than the lead was",
    "hard_braking": "{0} brakes hard although no vehicle ahead does",
    "overridden": (
        "the guard of {0} overrode its longitudinal law, {overridden_ratio:.2f} of the time"
    ),
    "own": "{0}",
}
"""What happened, by kind, with the vehicles and the figures of the event."""


@once
def events(run: RunTables) -> Sequence[Event]:
    """All events of a run in order of time."""
    of_vehicles = [event for name in run.names for of in OF_VEHICLES for event in of(run, name)]
    of_followers = [
        event for name in run.followers for of in OF_FOLLOWERS for event in of(run, name)
    ]
    return in_time_order([*encounters(run), *of_vehicles, *of_followers, *own_events(run)])


def run_events(run: RunTables, found: Sequence[Event] | None = None) -> "tuple[RunEvent, ...]":
    """Events of a run, by default all, as the summary lists them."""
    return tuple(_run_event(run, event) for event in (events(run) if found is None else found))


def _run_event(run: RunTables, event: Event) -> "RunEvent":
    lead = [run.lead] if event.kind == "lane_departure" else []
    witnesses, topic = [*event.vehicles, *lead], "truth"
    if event.kind in OF_DECISIONS:
        witnesses, topic = [event.vehicles[-1]], "tracking"
    before = seen_before(run, topic, witnesses, event.at_ns)
    return RunEvent(
        kind=event.kind,
        name=event.name,
        at_s=run.seconds(event.at_ns),
        after_s=None if before is None else run.seconds(before),
        vehicles=event.vehicles,
        figures=dict(event.figures),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEvent:
    """An event as listed in the summary; instants in seconds from the start of the run."""

    kind: EventKind
    """collision, near_miss, lane_departure, path_lost, slide, stop (braking to a stop for lack of
    data, which ends early if data returns; a lead: standing behind a silent member of its convoy),
    distrust (the follower rejects a source as implausible), falls_behind (the gap is wider than law
    and data age explain: by 10 m + 1.5 s of driving, for 1 s), stranded (stands for 2 s, and 2 s
    more for each vehicle between it and the lead, although the lead drives), overspeed (more than
    1.1 times the lead's fastest speed of the last 10 s, or since it was at the same place),
    hard_braking (more than 2 m/s² on average over 0.1 s, and no vehicle ahead braked beyond
    1.5 m/s² in the 5 s before), overridden (the guard overrode the longitudinal law for more than
    0.2 of the time after the first 2 s), or own (an event of the user)."""
    name: str = ""
    """Name of an event of the user's, that of its class; else empty."""
    at_s: float
    """When the event began, or was first seen."""
    after_s: float | None = None
    """Set for an event that began in a hole of the log: it began between this time and at_s."""
    vehicles: tuple[str, ...]
    """Vehicles involved, in the order of the convoy."""
    figures: Mapping[str, float]
    """Figures by kind. collision: closing_speed_mps. near_miss: gap_m_min,
    time_to_collision_s_min. lane_departure: excess_m_max, duration_s. path_lost, distrust:
    duration_s. slide: friction_ratio_max, slip_rad_max, duration_s. stop: known_m,
    predicted_blind_m, duration_s. falls_behind: gap_excess_m_max, duration_s. stranded: duration_s.
    overspeed: speed_excess_mps_max, duration_s. hard_braking: braking_mps2_max, duration_s.
    overridden: overridden_ratio, duration_s."""

    @property
    def line(self) -> str:
        name = self.name or self.kind.replace("_", " ")
        return f"{name}: {_what(self)}, {self.period} after the start"

    @property
    def period(self) -> str:
        """When the event began; an interval if that lies in a hole of the log."""
        if self.after_s is None:
            return f"{self.at_s:.2f} s"
        return f"between {self.after_s:.2f} and {self.at_s:.2f} s"

    @property
    def when(self) -> str:
        return f"at {self.period}" if self.after_s is None else self.period

    @property
    def level(self) -> Level:
        return "error" if self.kind == "collision" else "warning"


def _what(event: RunEvent) -> str:
    figures = event.figures
    text = SENTENCES[event.kind].format(*event.vehicles, **figures)
    if (left := figures.get("time_to_collision_s_min")) is not None:
        text += f", {left:.1f} s from a collision"
    if event.kind == "stop" and (known := figures.get("known_m")) is not None:
        text += f"; {road_known(known)}"
    if blind := figures.get("predicted_blind_m"):
        text += f"; predicted blind distance {blind:.1f} m"
    return text


def road_known(known: float) -> str:
    """Known length (m) of road ahead in words; a negative one ends behind the vehicle."""
    if known >= 0.0:
        return f"{known:.1f} m of known path"
    return f"known path ended {-known:.1f} m behind the car"
