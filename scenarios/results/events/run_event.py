"""An event on the road as the summary and the log tell it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from scenarios.results.events.encounters import EventKind
from vehicles.messages import Level


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEvent:
    """An event as it stands in the summary; instants in seconds from the start of the run."""

    kind: EventKind
    at_s: float
    vehicles: tuple[str, ...]
    figures: Mapping[str, float]

    @property
    def line(self) -> str:
        """What happened, in one line."""
        return f"{WHAT[self.kind](self)}, {self.at_s:.2f} s after the start"

    @property
    def level(self) -> Level:
        """How bad it is, for the log."""
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
    """Say how far ahead (m) the road is known; where that is negative, it ends behind."""
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
