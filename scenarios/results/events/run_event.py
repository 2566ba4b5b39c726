"""Events of a run as the summary and the log list them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from scenarios.results.events.encounters import Episode, EventKind
from vehicles.messages import Level


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEvent:
    """An event as listed in the summary; instants in seconds from the start of the run."""

    kind: EventKind
    """collision, near_miss, lane_departure, path_lost, slide, stop, or distrust of a source."""
    at_s: float
    """When the event began."""
    vehicles: tuple[str, ...]
    """Vehicles involved, in the order of the convoy."""
    figures: Mapping[str, float]
    """closing_speed_mps; gap_m_min, time_to_collision_s_min; excess_m_max, duration_s;
    friction_ratio_max, slip_rad_max, duration_s; known_m, predicted_blind_m, duration_s."""

    @property
    def line(self) -> str:
        return f"{WHAT[self.kind](self)}, {self.at_s:.2f} s after the start"

    @property
    def level(self) -> Level:
        return "error" if self.kind == "collision" else "warning"


def _collision(event: RunEvent) -> str:
    ahead, behind = event.vehicles
    closing = event.figures["closing_speed_mps"]
    return f"collision: {behind} and {ahead}, closing at {closing:.1f} m/s"


def _near_miss(event: RunEvent) -> str:
    ahead, behind = event.vehicles
    left = event.figures.get("time_to_collision_s_min")
    also = "" if left is None else f", {left:.1f} s from a collision"
    return f"near miss: {behind} within {event.figures['gap_m_min']:.2f} m of {ahead}{also}"


def _lane_departure(event: RunEvent) -> str:
    return f"lane departure: {event.vehicles[0]} across the edge of the lane"


def _path_lost(event: RunEvent) -> str:
    return f"path lost: {event.vehicles[0]} receives too little to steer along"


def _slide(event: RunEvent) -> str:
    return f"slide: {event.vehicles[0]} has no more friction to steer by"


def _stop(event: RunEvent) -> str:
    known, blind = event.figures.get("known_m"), event.figures.get("predicted_blind_m")
    left = "" if known is None else f", {road_known(known)}"
    beyond = f", {blind:.1f} m beyond it" if blind else ""
    return f"stop: {event.vehicles[0]} brakes to a standstill{left}{beyond}"


def road_known(known: float) -> str:
    """Known length (m) of road ahead in words; a negative one ends behind the vehicle."""
    if known >= 0.0:
        return f"{known:.1f} m of the road known"
    return f"the road known ends {-known:.1f} m behind"


def _distrust(event: RunEvent) -> str:
    source, name = event.vehicles
    return f"distrust: {name} does not believe {source}"


WHAT: Mapping[EventKind, Callable[[RunEvent], str]] = {
    "collision": _collision,
    "near_miss": _near_miss,
    "lane_departure": _lane_departure,
    "path_lost": _path_lost,
    "slide": _slide,
    "stop": _stop,
    "distrust": _distrust,
}


class EventLog:
    """Events of a run in the order of detection; `collisions` counts those so far.

    Figures of a continuing event still grow.
    """

    def __init__(self, seconds: Callable[[int], float]) -> None:
        """`seconds` converts an instant (ns) to seconds from the start of the run."""
        self._seconds = seconds
        self._found: list[Episode] = []
        self._reported = 0
        self.collisions = 0

    def add(self, episode: Episode) -> None:
        self._found.append(episode)
        self.collisions += episode.kind == "collision"

    def news(self) -> list[RunEvent]:
        new = self._found[self._reported :]
        self._reported = len(self._found)
        return [self._event(episode) for episode in new]

    def episodes(self, first: int) -> list[Episode]:
        """Events in the order in which they were found, from number `first` on."""
        return self._found[first:]

    def events(self) -> tuple[RunEvent, ...]:
        """All events so far in order of time."""
        found = [self._event(episode) for episode in self._found]
        return tuple(sorted(found, key=lambda one: (one.at_s, one.kind, one.vehicles)))

    def _event(self, episode: Episode) -> RunEvent:
        return RunEvent(
            kind=episode.kind,
            at_s=self._seconds(episode.at_ns),
            vehicles=episode.vehicles,
            figures=dict(episode.figures),
        )
