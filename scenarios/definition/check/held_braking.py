"""Braking of the lead that the gaps hold: simulated with usual data, and in closed form without."""

from collections import deque
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import nan
from typing import Final, NamedTuple

from scenarios.definition.channel.build import usual_delay_ms
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.plug_ins.point import PlugInError
from vehicles.car.dynamics import achieved_acceleration
from vehicles.driver.controller import OwnMotion, SourceState, SpacingPolicy, VehiclesAhead
from vehicles.driver.own_state import Pose
from vehicles.driver.situation import Situation
from vehicles.driver.speed import GapKeeping, SpeedLaw
from vehicles.driver.speed_guard import SpeedGuard
from vehicles.schedule import MILLISECOND, SECOND

SETTLING_S = 1.0
"""Time at constant speed before the lead brakes."""
LONGEST_S = 20.0
AFTER_S = 4.0
"""Time after the lead stands in which its followers may still touch."""
MOST_CARS = 3
"""Simulated cars: the first follower, for which lead and predecessor are one, and the second."""
STEPS = 6
"""Halvings of the searched interval: 0.125 m/s² of 8."""
SILENCES_S = (0.0, 0.5, 1.0)
"""Lengths of a cut from the onset of braking on, for which the closed form is stated."""


TYRES: Final = 8.0  # Hardest braking (m/s²) of cars on a dry road


def braking_held(gap: float, unknown: float, tyres: float = TYRES) -> float:
    """Braking (m/s²) of a vehicle a `gap` (m) ahead that may stay unknown for a time (s).

    At equal speeds it brakes at b from then on, and the follower `unknown` later at `tyres` b_m
    (m/s²). A contact is avoidable while g > b T² b_m / (2 (b_m - b)) (kinematics).
    """
    if gap <= 0.0:
        return 0.0
    return gap * tyres / (gap + 0.5 * tyres * unknown * unknown)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldBraking:
    """Largest braking (m/s²) of the lead, from `speed_mps`, that its followers hold.

    `simulated_mps2` is that without losses, at most TYRES. `without_data_mps2` is the closed
    form of the smallest gap if all messages are lost from the onset on, by the length of the cut
    (s).
    """

    vehicles: tuple[str, ...]
    speed_mps: float
    simulated_mps2: float
    without_data_mps2: dict[str, float]


class _Sample(NamedTuple):
    """State of a car at an instant (s): position, speed, achieved and commanded acceleration."""

    at: float
    place: float
    speed: float
    achieved: float
    command: float


@dataclass(slots=True)
class _Car:
    """A point mass on a line with its speed control, and what it has sent."""

    name: str
    place: float
    speed: float
    lag: float
    period: float
    least: float = 0.0
    delays: dict[str, float] = field(default_factory=dict)
    sources: tuple[str, ...] = ()
    law: SpeedLaw | None = None
    guard: SpeedGuard | None = None
    sensor_delay: float = nan
    command: float = 0.0
    achieved: float = 0.0
    due: float = -SETTLING_S
    sent: deque[_Sample] = field(default_factory=lambda: deque(maxlen=100))
    gaps: deque[tuple[float, float, float]] = field(default_factory=lambda: deque(maxlen=100))

    def send(self, now: float) -> None:
        if now >= self.due - 1e-9:
            sample = _Sample(now, self.place, self.speed, self.achieved, self.command)
            self.sent.append(sample)
            self.due += self.period

    def move(self, span: float) -> None:
        """Move by `span` (s) with the command, which the drive follows with its lag."""
        after = achieved_acceleration(self.achieved, self.command, span, self.lag)
        mean = self.command + (self.achieved - after) * self.lag / span
        speed = max(self.speed + mean * span, 0.0)
        self.place += 0.5 * (self.speed + speed) * span
        self.speed, self.achieved = speed, after if speed > 0.0 else 0.0


def held_braking(scenario: Scenario) -> HeldBraking | None:
    """Simulate a lead that brakes from its highest speed to a standstill; None without followers.

    Its braking begins just after a message. The followers have their laws, guards, periods,
    latencies and drive lags; they know their own state, and no message is lost.
    """
    speed = max(scenario.route.profile.speeds)
    names = scenario.vehicle_names[:MOST_CARS]
    followers = [
        name
        for name in names[1:]
        if name not in scenario.tables.replayed
        and scenario.vehicle(name).predecessor in scenario.vehicle(name).senders
    ]
    if followers != [*names[1:]] or not followers or not speed > 0.0:
        return None
    try:
        low, high = 0.0, TYRES
        if _holds(scenario, names, speed, high):
            low = high
        for _ in range(STEPS if low < high else 0):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _holds(scenario, names, speed, middle) else (low, middle)
    except PlugInError:  # a class of the user needs more than this simulation has
        return None
    cars = _convoy(scenario, names, speed)
    gaps = [ahead.place - car.place - car.least for ahead, car in pairwise(cars)]
    unknown = max(max(car.delays.values()) for car in cars[1:]) + max(car.period for car in cars)
    return HeldBraking(
        vehicles=names,
        speed_mps=speed,
        simulated_mps2=low,
        without_data_mps2={
            f"{silence:g}": braking_held(min(gaps), silence + unknown) for silence in SILENCES_S
        },
    )


def _holds(scenario: Scenario, names: tuple[str, ...], speed: float, braking: float) -> bool:
    """Whether no car touches another while the lead brakes (m/s²) from `speed` (m/s)."""
    cars, span = _convoy(scenario, names, speed), 1.0 / scenario.control_rate_hz
    lead = cars[0]
    ends = min(speed / braking + lead.lag + AFTER_S, LONGEST_S)
    onset: float | None = None
    for tick in range(round((SETTLING_S + ends) / span)):
        now = tick * span - SETTLING_S
        sent = len(lead.sent)
        for car in cars:
            car.send(now)
        if now >= -1e-9 and onset is None and (len(lead.sent) > sent or lead.period < span):
            onset = now
        lead.command = 0.0 if onset is None else -braking
        for place, car in enumerate(cars[1:], 1):
            car.command = _commanded(place, cars, now, span)
        for car in cars:
            car.move(span)
        for ahead, car in pairwise(cars):
            if ahead.place - car.place <= car.least:
                return False
    return True


def _convoy(scenario: Scenario, names: tuple[str, ...], speed: float) -> list[_Car]:
    """Cars at `speed` (m/s) and the gaps that they keep."""
    cars, place = list[_Car](), 0.0
    for number, name in enumerate(names):
        setup = scenario.vehicle(name)
        rate = setup.usual_rate_hz(speed) or 1.0
        policy = scenario.kept_spacing(number) if number else SpacingPolicy(0.0)
        place -= policy.desired(speed)
        car = _Car(name, place, speed, setup.parameters.drive_lag, 1.0 / rate)
        cars.append(car)
        if not number:
            continue
        car.least = scenario.least_spacings[number]
        car.sources = setup.flow.longitudinal
        for sender in {setup.lead, setup.predecessor or ""} & set(setup.senders):
            link = scenario.links[sender, name]
            latency_ms = scenario.vehicle(sender).gnss.latency / MILLISECOND
            car.delays[sender] = (latency_ms + usual_delay_ms(link)) / 1000.0
            source = cars[names.index(sender)]
            source.period = max(source.period, 1.0 / link.rate_hz if link.rate_hz else 0.0)
        if setup.gap_sensor is not None:
            car.sensor_delay = setup.gap_sensor.latency / SECOND
        car.law, car.guard = _guard(scenario, name, policy)
    return cars


def _guard(
    scenario: Scenario, name: str, policy: SpacingPolicy
) -> tuple[SpeedLaw, SpeedGuard | None]:
    setup, start = scenario.vehicle(name), scenario.longitudinal_setup(name)
    keeps_gap = scenario.tables.speed.followers == "gap"
    law = GapKeeping(start, scenario.longitudinal_controller(name, start) if keeps_gap else None)
    if setup.degradation.reaction != "degrade":
        return law, None
    start = replace(start, initial_spacing=policy.desired(max(scenario.route.profile.speeds)))
    return law, SpeedGuard(law, setup.degradation, start)


def _commanded(place: int, cars: list[_Car], now: float, span: float) -> float:
    """Acceleration (m/s²) that a follower commands at `now` (s)."""
    car, ahead = cars[place], cars[place - 1]
    if car.law is None:
        return 0.0
    lead = _received(car, cars[0], now)
    predecessor = lead if ahead is cars[0] else _received(car, ahead, now)
    first, second = predecessor.predicted(), lead.predicted()
    from_lead = cars[0].name in car.sources and cars[0].name in car.delays
    seen = VehiclesAhead(
        spacing=predecessor.spacing + first.driven,
        predecessor_speed=first.speed,
        predecessor_acceleration=first.acceleration,
        lead_speed=second.speed if from_lead else nan,
        lead_acceleration=second.acceleration if from_lead else nan,
        own=OwnMotion(span, car.command, car.achieved),
        sources={
            name: source
            for name, source in ((cars[0].name, lead), (ahead.name, predecessor))
            if name in car.sources
        },
    )
    car.gaps.append((now, ahead.place - car.place - car.least, ahead.speed - car.speed))
    measured = [row for row in car.gaps if row[0] <= now - car.sensor_delay]
    if measured:
        at, gap, rate = measured[-1]
        seen.measured_gap, seen.measured_gap_rate = gap + rate * (now - at), rate
    situation = Situation(lead, predecessor, state="follow", ahead=seen)
    pose = Pose(car.place, 0.0, 0.0, car.speed, 0.0)
    instant = round((now + SETTLING_S) * SECOND)
    if car.guard is None:
        return car.law.command(instant, pose, seen).acceleration
    return car.guard.command(instant, pose, seen, situation).acceleration


def _received(car: _Car, sender: _Car, now: float) -> SourceState:
    """State of a source by its newest sample that has arrived, or its first one."""
    delay = car.delays.get(sender.name, 0.0)
    sample = next((one for one in reversed(sender.sent) if one.at + delay <= now), sender.sent[0])
    return SourceState(
        "fresh" if sender.name in car.delays else "unused",
        age=now - sample.at,
        silence=max(now - sample.at - delay, 0.0),
        period=sender.period,
        share=1.0,
        acceleration=sample.command,
        achieved=sample.achieved,
        speed=sample.speed,
        measured_at=round((sample.at + SETTLING_S) * SECOND),
        spacing=sample.place - car.place,
        lag=sender.lag,
    )
