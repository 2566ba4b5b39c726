"""Events of a run as the summary and the log list them."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.plug_ins.point import PlugInError
from scenarios.definition.schema.plug_ins.points import EventDetector, RunFigure
from scenarios.definition.schema.plug_ins.table import PlugInTable
from scenarios.results.encounters import Episode, EventKind
from vehicles.messages import Level, TruePose
from vehicles.schedule import SECOND


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


OF_ONE: Mapping[EventKind, str] = {
    "lane_departure": "{} across the edge of the lane",
    "path_lost": "{} has no known path to steer along",
    "slide": "{} uses all available friction",
    "falls_behind": "the gap of {} is wider than its law and the age of its data explain",
    "stranded": "{} stands although the lead drives",
    "overspeed": "{} is faster than the lead was",
    "hard_braking": "{} brakes hard although no vehicle ahead does",
    "own": "{}",
}
"""Events that involve one vehicle, as text."""


def _what(event: RunEvent) -> str:
    figures, (first, *others) = event.figures, event.vehicles
    match event.kind:
        case "collision":
            text = f"{others[0]} and {first}, closing at {figures['closing_speed_mps']:.1f} m/s"
        case "near_miss":
            left = figures.get("time_to_collision_s_min")
            also = "" if left is None else f", {left:.1f} s from a collision"
            text = f"{others[0]} within {figures['gap_m_min']:.2f} m of {first}{also}"
        case "stop":
            known, blind = figures.get("known_m"), figures.get("predicted_blind_m")
            ends = "" if known is None else f"; {road_known(known)}"
            beyond = f"; predicted blind distance {blind:.1f} m" if blind else ""
            text = f"{first} brakes to a stop without a reliable source{ends}{beyond}"
        case "distrust":
            text = f"{others[0]} distrusts {first}"
        case "overridden":
            share = figures["overridden_ratio"]
            text = f"the guard of {first} overrode its longitudinal law, {share:.2f} of the time"
        case kind:
            text = OF_ONE[kind].format(first)
    return text


def road_known(known: float) -> str:
    """Known length (m) of road ahead in words; a negative one ends behind the vehicle."""
    if known >= 0.0:
        return f"{known:.1f} m of known path"
    return f"known path ended {-known:.1f} m behind the car"


OF_DECISIONS: frozenset[EventKind] = frozenset({"path_lost", "stop", "distrust", "overridden"})
"""Events in the decisions of a follower; the others are in true poses."""


class EventLog:
    """Events of a run in the order of detection; `collisions` counts those so far.

    Figures of a continuing event still grow.
    """

    def __init__(
        self,
        seconds: Callable[[int], float],
        seen_before: Callable[[Episode], int | None] = lambda _: None,
    ) -> None:
        """`seconds` converts an instant (ns) to seconds from the start of the run.

        `seen_before` returns the instant (ns) before the hole in which an event began, if any.
        """
        self._seconds = seconds
        self._seen_before = seen_before
        self._episodes: list[Episode] = []
        self._reported = 0
        self.collisions = 0

    def add(self, episode: Episode) -> None:
        self._episodes.append(episode)
        self.collisions += episode.kind == "collision"

    def take_new(self) -> list[RunEvent]:
        new = self._episodes[self._reported :]
        self._reported = len(self._episodes)
        return [self._event(episode) for episode in new]

    def events(self) -> tuple[RunEvent, ...]:
        """All events so far in order of time."""
        events = [self._event(episode) for episode in self._episodes]
        return tuple(sorted(events, key=lambda event: (event.at_s, event.kind, event.vehicles)))

    def _event(self, episode: Episode) -> RunEvent:
        seen_before = self._seen_before(episode)
        return RunEvent(
            kind=episode.kind,
            name=episode.name,
            at_s=self._seconds(episode.at_ns),
            after_s=None if seen_before is None else self._seconds(seen_before),
            vehicles=episode.vehicles,
            figures=dict(episode.figures),
        )


# ---- Events and figures of the user's classes, from the true poses of each vehicle


class OwnMeasures:
    """Detectors and figures of all vehicles; one that fails is left out, with a line in `faults`.

    A class that measures must not end a run.
    """

    def __init__(
        self,
        vehicles: Sequence[str],
        events: Sequence[PlugInTable] = (),
        figures: Sequence[PlugInTable] = (),
    ) -> None:
        self._detectors: dict[str, dict[str, EventDetector]] = {
            name: {table.class_name: table.build() for table in events} for name in vehicles
        }
        self._figures: dict[str, dict[str, RunFigure]] = {
            name: {table.class_name: table.build() for table in figures} for name in vehicles
        }
        self._has_any = bool(events or figures)
        self._open: dict[tuple[str, str], Episode] = {}
        self.faults: list[str] = []

    @classmethod
    def of(cls, scenario: Scenario) -> "OwnMeasures | None":
        """Measures of a scenario whose classes are here; None without any."""
        tables = scenario.tables
        if not tables.event and not tables.figure:
            return None
        try:
            return cls(scenario.vehicle_names, tables.event, tables.figure)
        except PlugInError:  # of a recorded run
            return None

    def add(self, pose: TruePose) -> Iterable[Episode]:
        """Take a true pose; returns the events that begin."""
        return list(self._measured(pose)) if self._has_any else ()

    def _measured(self, pose: TruePose) -> Iterator[Episode]:
        vehicle, at = pose.vehicle, pose.true_at_ns
        figures, detectors = self._figures[vehicle], self._detectors[vehicle]
        for name, figure in list(figures.items()):
            try:
                figure.add(pose)
            except PlugInError as error:
                self._leave_out(figures, vehicle, name, error)
        for name, detector in list(detectors.items()):
            try:
                holds = detector.holds(pose)
            except PlugInError as error:
                self._leave_out(detectors, vehicle, name, error)
                continue
            if not holds:
                continue
            episode = self._open.get((vehicle, name))
            if episode is None or episode.is_over(at):
                place = (pose.east_m, pose.north_m)
                episode = Episode("own", (vehicle,), at, at, place=place, name=name)
                self._open[vehicle, name] = episode
                yield episode
            episode.until_ns = at
            episode.most("duration_s", (at - episode.at_ns) / SECOND)

    def values(self, vehicle: str) -> dict[str, float | None]:
        """Figures of a vehicle by the names of their classes, without those that failed."""
        figures = self._figures.get(vehicle, {})
        result: dict[str, float | None] = {}
        for name, figure in list(figures.items()):
            try:
                result[name] = figure.value()
            except PlugInError as error:
                self._leave_out(figures, vehicle, name, error)
        return result

    def _leave_out(
        self,
        measures: dict[str, RunFigure] | dict[str, EventDetector],
        vehicle: str,
        name: str,
        error: PlugInError,
    ) -> None:
        del measures[name]
        self.faults.append(f"{vehicle}: {error}; left out from then on")
