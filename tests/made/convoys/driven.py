"""Convoys in virtual time without a log: their summary, and their messages by vehicle and kind."""

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TypeVar, cast

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.summary import RunSummary
from scenarios.runs.observer import ALL_KINDS, OnMessage
from scenarios.runs.virtual import run_unlogged
from vehicles.messages import Message, TruePose

M = TypeVar("M", bound=Message)


@dataclass
class Driven:
    scenario: Scenario
    messages: defaultdict[tuple[str, str], list[Message]] = field(
        default_factory=lambda: defaultdict(list)
    )
    _summary: RunSummary | None = None

    @property
    def summary(self) -> RunSummary:
        assert self._summary is not None
        return self._summary

    @property
    def followers(self) -> list[str]:
        return list(self.scenario.vehicle_names[1:])

    def of(self, vehicle: str, kind: type[M]) -> list[M]:
        """Messages of one kind, in the order in which a vehicle sent them."""
        return cast("list[M]", self.messages[vehicle, kind.__name__])

    def all(self, kind: type[M]) -> list[M]:
        """Messages of one kind of all vehicles, those of the lead first."""
        return [one for name in self.scenario.vehicle_names for one in self.of(name, kind)]

    def speeds(self, vehicle: str) -> list[float]:
        """True speed (m/s) at each control instant."""
        return [pose.speed_mps for pose in self.of(vehicle, TruePose)]

    def errors(self) -> list[float]:
        """Largest true error (m) of each follower."""
        return errors(self.summary)

    def kinds_of_events(self) -> set[str]:
        return {event.kind for event in self.summary.events}


def driven(name: str | Scenario, *overrides: str, seed: int | None = None) -> Driven:
    """Drive a scenario and keep all messages."""
    scenario = load_scenario(name, overrides, seed) if isinstance(name, str) else name
    run = Driven(scenario)

    def keep(_at: int, message: Message) -> None:
        run.messages[message.vehicle, type(message).__name__].append(message)

    run._summary = run_unlogged(scenario, [OnMessage(keep, ALL_KINDS)])
    return run


def summary_of(name: str, *overrides: str, seed: int | None = None) -> RunSummary:
    """Drive a scenario of which only the summary matters."""
    return run_unlogged(load_scenario(name, overrides, seed))


def collisions(summary: RunSummary) -> int:
    return sum(event.kind == "collision" for event in summary.events)


def errors(summary: RunSummary) -> list[float]:
    """Largest true error (m) of each follower."""
    return [row.cross_track_error_m_max or 0.0 for row in summary.vehicles[1:]]


def least_gap_m(summary: RunSummary) -> float:
    return min(row.true_gap_m_min for row in summary.vehicles if row.true_gap_m_min is not None)
