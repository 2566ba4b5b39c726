"""Cuts of links in convoys on several roads, and figures of the followers."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import inf, pi
from typing import Any

import numpy as np
import tomli_w

from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.events import encounters, lane_departures
from scenarios.results.tables import Collector, RunTables
from scenarios.results.true_motion import path_feet
from scenarios.runs.observer import OnMessage
from scenarios.runs.virtual import drive
from vehicles.driver.settings import Braking
from vehicles.driver.situation import stopping_distance
from vehicles.messages import Command, LinkVerdict, Message, Mode, Tracking, TruePose
from vehicles.schedule import SECOND

Table = Mapping[str, Any]

LATERAL_ACCELERATION = 1.8
"""Lateral acceleration of the lane changes (m/s²), as in the paper: 500 m at 30 m/s."""
CORNER_M, CIRCLE_M, EXIT_M, SLALOM_M = 9.0, 14.0, 20.0, 50.0
"""Radii of a street corner, a roundabout and its exits, and a slalom."""


def straight(length_m: float) -> Table:
    return {"length_m": length_m}


def bend(turn: str, radius_m: float, angle_deg: float) -> Table:
    return {"length_m": radius_m * angle_deg * pi / 180.0, "radius_m": radius_m, "turn": turn}


def lane_change(speed_mps: float) -> Table:
    second, radius = speed_mps, speed_mps**2 / LATERAL_ACCELERATION
    right = {"length_m": second, "radius_m": radius, "turn": "right"}
    left = right | {"turn": "left"}
    before, within, between, after = (straight(count * second) for count in (5, 1, 4, 80))
    segments = [before, right, within, left, between, left, within, right, after]
    return fast(segments, speed_mps, followers="same")


def slalom() -> Table:
    """Bends to alternate sides at 12 m/s, up to 2.9 m/s²."""
    turns = [bend(turn, SLALOM_M, 40.0) for turn in ("left", "right") * 6]
    road = [straight(40.0), bend("right", SLALOM_M, 20.0), *turns, straight(400.0)]
    return fast(road, 12.0, followers="gap")


def block() -> Table:
    pieces = [straight(40.0)]
    for turn in ("right", "left", "left", "left", "left", "right", "right", "left"):
        pieces += [bend(turn, CORNER_M, 90.0), straight(35.0)]
    return {**town(9.0), "path": path([*pieces, straight(200.0)])}


def roundabout() -> Table:
    entry = bend("right", EXIT_M, 45.0)
    pieces = [straight(50.0), entry, bend("left", CIRCLE_M, 180.0), entry, straight(40.0)]
    pieces += [entry, bend("left", CIRCLE_M, 270.0), entry, straight(300.0)]
    return {**town(10.0), "path": path(pieces)}


def fast(segments: list[Table], speed_mps: float, followers: str) -> Table:
    return {
        "extends": "lane_change",
        "speed": {"set_mps": speed_mps, "followers": followers},
        "control": {"controller": "slip_compensated"},
        "path": path(segments),
    }


def town(speed_mps: float) -> Table:
    profile = [{"at_s": 0.0, "speed_mps": 1.4}, {"at_s": 3.0, "speed_mps": speed_mps}]
    return {"extends": "church_lot", "speed": {"profile": profile}}


def path(segments: list[Table]) -> Table:
    return {"kind": "segments", "segments": segments}


ROADS: Mapping[str, Callable[[float], Table]] = {
    "lane_change": lane_change,
    "highway": lambda _: {"extends": "highway"},
    "church_lot": lambda _: town(6.0),
    "block": lambda _: block(),
    "slalom": lambda _: slalom(),
    "roundabout": lambda _: roundabout(),
}
"""Scenario tables of each road at a set speed (m/s), which only the lane change uses."""
LINKS = ("all", "lead", "link", "vehicle")
"""Links that are cut: all, those from the lead, one from a predecessor, or all of one vehicle."""
FIXES = ("", "", "", "float", "none")
"""Fix states of a failing receiver; empty if none fails."""
AFTERWARDS_S = 15.0
FOR_GOOD_S = 14.0
"""Duration of the run after a permanent cut begins: all cars have stopped by then."""
FLAPPING_S = 0.2, 1.2
"""Range of the times for which flapping links are cut, and restored."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkCut:
    """Links of a convoy are cut at `at_s` (after the start) for `for_s`, or permanently if None.

    `flapping` links are cut and restored at random times meanwhile. `vehicle` is the number of the
    car that is cut off, or that receives nothing from its predecessor, and of the one whose
    receiver fails at `at_s` for `for_s`.
    """

    reaction: str = "degrade"
    sends_history: bool = True
    road: str = "lane_change"
    speed_mps: float
    at_s: float
    for_s: float | None
    seed: int
    vehicles: int = 3
    links: str = "all"
    flapping: bool = False
    vehicle: int = 2
    fix: str = ""

    @property
    def ends_at_s(self) -> float:
        return self.at_s + (FOR_GOOD_S if self.for_s is None else self.for_s)

    def scenario(self) -> Scenario:
        road = ROADS[self.road](self.speed_mps)
        control = {**road.get("control", {}), "degradation": {"reaction": self.reaction}}
        text = {
            **road,
            "name": "cut",
            "duration_s": self.ends_at_s + (0.0 if self.for_s is None else AFTERWARDS_S),
            "seed": self.seed,
            "convoy": {"vehicles": self.vehicles},
            "control": control,
            "change": [*self._cuts(), *self._failure()],
        }
        if not self.sends_history:
            text["sending"] = {"path_history_m": 0.0}
        return scenario_from_text(tomli_w.dumps(text), label="cut")

    def _cuts(self) -> Iterator[Table]:
        name, ahead = f"v{self.vehicle}", f"v{self.vehicle - 1}"
        nobody_behind = self.vehicle == self.vehicles and self.road != "church_lot"
        ends: Mapping[str, Sequence[Table]] = {
            "all": [{}],
            "lead": [{"sender": "v1"}],
            "link": [{"sender": ahead, "receiver": name}],
            "vehicle": ({"sender": name}, {"receiver": name})[nobody_behind:],
        }
        for span, links in product(self._spans(), ends[self.links]):
            yield {"kind": "cut", **span, **links}

    def _spans(self) -> Iterator[Table]:
        if not self.flapping:
            yield {"at_s": self.at_s} | ({} if self.for_s is None else {"for_s": self.for_s})
            return
        random, at_s = np.random.Generator(np.random.PCG64(self.seed)), self.at_s
        while (left_s := round(self.ends_at_s - at_s, 3)) > 0.0:
            cut_s, restored_s = (round(float(span), 3) for span in random.uniform(*FLAPPING_S, 2))
            yield {"at_s": round(at_s, 3), "for_s": min(cut_s, left_s)}
            at_s += cut_s + restored_s

    def _failure(self) -> Iterator[Table]:
        if self.fix:
            vehicle, at_s = f"v{self.vehicle}", self.at_s
            for_s = {} if self.for_s is None else {"for_s": self.for_s}
            yield {"kind": "gnss", "vehicle": vehicle, "fix": self.fix, "at_s": at_s, **for_s}


def draw_cuts(count: int) -> Iterator[LinkCut]:
    for number in range(count):
        random = np.random.Generator(np.random.PCG64([1, number]))
        vehicles = int(random.integers(3, 8, endpoint=True))
        for_s = round(float(random.uniform(0.2, 8.0)), 3)
        yield LinkCut(
            sends_history=number // len(ROADS) % 2 == 0,
            road=list(ROADS)[number % len(ROADS)],
            speed_mps=round(float(random.uniform(8.0, 30.0)), 2),
            at_s=round(float(random.uniform(3.0, 17.0)), 3),
            for_s=None if random.random() < 0.2 else for_s,
            seed=number + 1,
            vehicles=vehicles,
            links=LINKS[random.integers(len(LINKS))],
            flapping=bool(random.random() < 0.2),
            vehicle=int(random.integers(2, vehicles, endpoint=True)),
            fix=FIXES[random.integers(len(FIXES))],
        )


STANDING = 0.05
"""Speed (m/s) below which a car has stopped."""
NO_SOURCE: frozenset[Mode] = frozenset({"coast", "stop"})
GROWN_M = 0.5
"""A known path grows if its end moves ahead by more than this (m)."""
ON_PATH_M = 0.3
"""Largest lateral error of a car that is on the lead's path."""
NOTICED_S = 0.5
"""Silence after which a follower has to brake."""
HARDEST = Braking(6.0, 12.0)
BLIND_RATIO, BLIND_M = 0.05, 0.5
"""Allowed error of the predicted blind distance: a ratio, or at least a distance."""


@dataclass(slots=True)
class CarRecord:
    """Messages of a follower; errors and stations along the lead's path by instant (ns)."""

    truth: dict[int, TruePose] = field(default_factory=dict)
    tracking: list[Tracking] = field(default_factory=list)
    steering: list[float] = field(default_factory=list)
    deliveries: list[LinkVerdict] = field(default_factory=list)
    errors: dict[int, float] = field(default_factory=dict)
    stations: dict[int, float] = field(default_factory=dict)
    departures: list[int] = field(default_factory=list)
    collisions: int = 0
    """Number of collisions with a car ahead."""

    def known(self) -> Iterator[tuple[Tracking, TruePose]]:
        for row in self.tracking:
            if (pose := self.truth.get(row.decided_at_ns)) is not None:
                yield row, pose

    def departures_avoidable(self) -> int:
        """Count the departures from the lane for which the known path sufficed to stop.

        It did if the car left within the known path, or if that was longer than the braking
        distance `NOTICED_S` after it last grew. Until the car is back on the lead's path, its
        departures belong to the same drive beyond the known path.
        """
        left, avoidable = sorted(self.departures, reverse=True), 0
        end = grew_at = -inf
        could_stop = is_beyond = False
        for row, pose in self.known():
            at, known = row.decided_at_ns, row.known_m
            off_path = abs(self.errors.get(at, 0.0)) > ON_PATH_M
            is_beyond = known < 0.0 or (is_beyond and off_path)
            if not is_beyond:
                if pose.distance_m + known > end + GROWN_M:
                    end, grew_at, could_stop = pose.distance_m + known, at, False
                if at < grew_at + NOTICED_S * SECOND:
                    could_stop = known >= stopping_distance(pose.speed_mps, 0.0, HARDEST)
            while left and left[-1] <= at:
                left.pop()
                avoidable += could_stop or not is_beyond
        return avoidable

    def blind_stop(self) -> tuple[float, float] | None:
        """Distance driven without a known path until a standstill, and its prediction (m).

        A stop begins when the known path grew last. Of several stops, that with the largest
        difference.
        """
        stops: list[tuple[float, float]] = []
        began: Tracking | None = None
        path_end = -inf
        for row, pose in self.known():
            stands = pose.speed_mps < STANDING
            if row.mode not in NO_SOURCE and row.known_m >= 0.0:
                began, path_end = None, -inf
            elif pose.distance_m + row.known_m > path_end + GROWN_M:
                began, path_end = None if stands else row, pose.distance_m + row.known_m
            elif began is not None and stands:
                stops.append((max(pose.distance_m - path_end, 0.0), began.blind_m))
                began = None
        return max(stops, key=lambda stop: abs(stop[0] - stop[1]), default=None)

    def blind_deviation(self) -> float:
        """Difference (m) of driven and predicted blind distance, 0 if it is allowed."""
        blind, predicted = self.blind_stop() or (0.0, 0.0)
        off = abs(blind - predicted)
        return off if off > max(BLIND_M, BLIND_RATIO * predicted) else 0.0


def simulated(scenario: Scenario) -> Mapping[str, CarRecord]:
    """Simulate a scenario; returns the records of its vehicles, the lead first."""
    cars = {name: CarRecord() for name in scenario.vehicle_names}

    def record(_at: int, message: Message) -> None:
        car = cars[message.vehicle]
        match message:
            case TruePose():
                car.truth[message.true_at_ns] = message
            case Tracking():
                car.tracking.append(message)
            case Command():
                car.steering.append(message.steering_rad)
            case LinkVerdict() if message.outcome == "delivered":
                car.deliveries.append(message)

    collector = Collector()
    kinds = frozenset({Command, LinkVerdict, Tracking, TruePose})
    drive(scenario, [collector, OnMessage(record, kinds)]).raise_fault()
    run = RunTables(scenario, collector.tables())
    for name in run.followers:
        at, (station, lateral) = run.table(name, "truth").at_ns, path_feet(run, name)
        known = ~np.isnan(lateral)
        instants = at[known].tolist()
        cars[name].errors = dict(zip(instants, lateral[known].tolist(), strict=True))
        cars[name].stations = dict(zip(instants, station[known].tolist(), strict=True))
        cars[name].departures = [event.at_ns for event in lane_departures(run, name)]
    for event in encounters(run):
        cars[event.vehicles[-1]].collisions += event.kind == "collision"
    return cars
