"""A convoy on a straight, of point masses with the follower's own decisions, and lossy links.

Positions are exact along the straight but for the noise of a receiver; nothing is steered. Cars
decide at 50 Hz, send at the same instants, and receive `LATENCY` later. Losses are drawn for each
link, independently or in bursts (Gilbert).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import exp
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tests.made.message import pose
from vehicles.car.dynamics import Body
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.car.sensors import GapMeasurement
from vehicles.driver.controller import (
    GapLimits,
    LongitudinalController,
    LongitudinalSetup,
    SpacingPolicy,
)
from vehicles.driver.follower import Follower
from vehicles.driver.longitudinal_laws import (
    Acc,
    AccSettings,
    Cacc,
    CaccSettings,
    Flatbed,
    FlatbedSettings,
    Ploeg,
    PloegSettings,
)
from vehicles.driver.own_state import ExactState
from vehicles.driver.reactions import Degrade, Extrapolate
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.source import Source
from vehicles.driver.sources import Sources
from vehicles.driver.speed import GapKeeping, ProfileSpeed, SpeedLaw, SpeedProfile
from vehicles.driver.speed_guard import SpeedGuard
from vehicles.driver.steering import SteeringCommand
from vehicles.driver.tracking import TrackingErrors
from vehicles.geometry.sampled_path import Place
from vehicles.messages import Announcement, GpsPose
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.fusion import Trajectories
from vehicles.preview.trajectory import SourceWindow
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import MILLISECOND, SECOND, Cadence

Floats = NDArray[np.float64]
TICK, LATENCY = 20 * MILLISECOND, 20 * MILLISECOND
STEP = TICK / SECOND
LENGTH = LINCOLN_MKZ.length
EXTRAPOLATES = DegradationSettings(reaction="extrapolate")
HISTORY_STEPS = 20  # Positions of a path history, half a second apart
Lead = Callable[[float, float], float]
"""Commanded acceleration (m/s²) of the lead at a time (s) and its speed (m/s)."""


class Unsteered:
    """Neither fits a trajectory nor steers."""

    separate: ClassVar[bool] = False

    def fuse(self, _sources: Sequence[SourceWindow], _settings: FitSettings) -> Trajectories:
        return []

    def steer(self, _errors: TrackingErrors, _speed: float) -> SteeringCommand:
        return SteeringCommand(0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Cut:
    """No message of the links in `links` (sender, receiver; places from 0) within a time (s)."""

    begin: float
    end: float
    links: Callable[[int, int], bool] = lambda _sender, _receiver: True


@dataclass(kw_only=True)
class StraightConvoy:
    """`count` cars at `speed` (m/s), the lead driven by `lead`; SI units.

    `law` is "same" (a common speed), "gap" or one of Plexe's, with a `standstill` gap and a
    `headway`; a `controller` replaces it. Of each link `loss` of the messages are lost, in bursts
    of mean length `burst`; delays up to `jitter` (s) keep the order. After `run`, arrays of
    (instants, cars): `places`, `speeds`, `accelerations` (commanded), and lists of `overrides` and
    `states` for each car.
    """

    count: int = 8
    seed: int = 1
    speed: float = 30.0
    law: str = "gap"
    standstill: float = 10.0
    headway: float = 0.0
    rate_hz: float = 20.0
    loss: float = 0.0
    burst: float = 0.0
    jitter: float = 0.0
    lag: float = 0.0
    lead: Lead = lambda _time, _speed: 0.0
    cuts: Sequence[Cut] = ()
    sensor: bool = False
    degrades: bool = True
    limits: GapLimits = field(default_factory=GapLimits)
    degradation: DegradationSettings = field(default_factory=DegradationSettings)
    controller: LongitudinalController | None = None
    overrides: list[list[str]] = field(default_factory=list)
    states: list[list[str]] = field(default_factory=list)

    def run(self, seconds: float) -> "StraightConvoy":  # noqa: C901 - one loop over time
        count, ticks = self.count, round(seconds / STEP)
        random = np.random.default_rng(self.seed)
        policy = SpacingPolicy(self.standstill + LENGTH, self.headway)
        spacing = policy.desired(self.speed)
        drivers = [self._driver(place, policy, spacing) for place in range(1, count)]
        x = [-place * spacing for place in range(count)]
        v, a, u = [self.speed] * count, [0.0] * count, [0.0] * count
        shape = ticks, count
        self.places, self.speeds, self.accelerations = (
            np.zeros(shape),
            np.zeros(shape),
            np.zeros(shape),
        )
        self.overrides = [[] for _ in range(count)]
        self.states = [[] for _ in range(count)]
        pairs = [(s, r) for r in range(1, count) for s in dict.fromkeys((0, r - 1))]
        pairs += [(s, 0) for s in range(1, count - 1)]
        lost_before = dict.fromkeys(pairs, False)
        arrived: dict[tuple[int, int], int] = dict.fromkeys(pairs, 0)
        queues: list[list[tuple[int, GpsPose, tuple[float, float, list[Place]]]]] = [
            [] for _ in range(count)
        ]
        stops: list[tuple[int, int]] = [(-1, 0)] * count
        period, seq = round(SECOND / self.rate_hz), 0
        announced = [Announcement()] * count
        for tick in range(ticks):
            now = SECOND + tick * TICK
            for place in range(count):
                due = [entry for entry in queues[place] if entry[0] <= now]
                queues[place] = [entry for entry in queues[place] if entry[0] > now]
                if place == 0:
                    for _, message, _ in due:
                        sender = int(message.vehicle[1:]) - 1
                        if message.measured_at_ns > stops[sender][0]:
                            stops[sender] = message.measured_at_ns, message.stops_at_ns
                    u[0] = self.lead(tick * STEP, v[0])
                    relayed = tuple(at for _, at in stops[1:-1]) if self.degrades else ()
                    announced[0] = Announcement(
                        acceleration_mps2=u[0],
                        achieved_acceleration_mps2=a[0],
                        relayed_stops_at_ns=relayed,
                    )
                    continue
                received = [_pose(message, now, *at) for _, message, at in due]
                body = Body(east=x[place], north=0.0, yaw=0.0, speed=v[place])
                gap = None
                if self.sensor:
                    rate = v[place - 1] - v[place]
                    measured = x[place - 1] - x[place] - LENGTH
                    gap = GapMeasurement(now, now + SECOND, measured, rate)
                decision = drivers[place - 1].step(now, None, body, received, gap)
                u[place] = decision.actuation.acceleration
                announced[place] = decision.announcement
                self.overrides[place].append(decision.override)
                self.states[place].append(decision.situation.state)
            self.places[tick], self.speeds[tick], self.accelerations[tick] = x, v, u
            if now - SECOND >= seq * period:
                noise = random.normal(0.0, (0.02, 0.03), (count, 2)).tolist()
                for pair in pairs:
                    lost = lost_before[pair] = self._is_lost(random, lost_before[pair])
                    delay = LATENCY + round(self.jitter * random.random() * SECOND)
                    sender, receiver = pair
                    if lost or self._is_cut(tick * STEP, sender, receiver):
                        continue
                    arrived[pair] = max(arrived[pair], now + delay)
                    message = _message(sender, seq, now, v[sender] + noise[sender][1], announced)
                    driven = self._history(sender, tick)
                    at = (x[sender] + noise[sender][0], message.speed_mps, driven)
                    queues[receiver].append((arrived[pair], message, at))
                seq += 1
            for place in range(count):
                left = exp(-STEP / self.lag) if self.lag else 0.0
                before = a[place] if v[place] > 0.0 else 0.0
                a[place] = u[place] + (before - u[place]) * left
                mean = u[place] + (before - a[place]) * self.lag / STEP
                after = max(v[place] + mean * STEP, 0.0)
                x[place] += 0.5 * (v[place] + after) * STEP
                v[place] = after
        return self

    def _history(self, sender: int, tick: int) -> list[Place]:
        """Positions that a car has driven through until `tick`, every half second."""
        steps = [tick - 25 * step for step in range(HISTORY_STEPS, 0, -1)]
        begin = self.places[0, sender]
        return [
            (SECOND + step * TICK, self.places[step, sender].item(), 0.0)
            if step >= 0
            else (SECOND + step * TICK, begin.item() + step * STEP * self.speed, 0.0)
            for step in steps
        ]

    def _is_lost(self, random: np.random.Generator, before: bool) -> bool:
        if not self.burst:
            return bool(random.random() < self.loss)
        ends = 1.0 / self.burst
        begins = self.loss * ends / (1.0 - self.loss)
        return bool(random.random() >= ends if before else random.random() < begins)

    def _is_cut(self, time: float, sender: int, receiver: int) -> bool:
        return any(c.begin <= time < c.end and c.links(sender, receiver) for c in self.cuts)

    def _driver(self, place: int, policy: SpacingPolicy, spacing: float) -> Follower:
        names = tuple(dict.fromkeys(("v1", f"v{place}")))
        setup = LongitudinalSetup(
            policy,
            self.limits,
            LENGTH,
            STEP,
            parameters=replace(LINCOLN_MKZ, drive_lag=self.lag),
            lead="v1",
            predecessor=names[-1],
            initial_spacing=spacing,
        )
        law, nothing = self._law(setup), Unsteered()
        degradation = self.degradation if self.degrades else EXTRAPOLATES
        sources = [
            Source(name, 1.0 / self.rate_hz, degradation, place=int(name != "v1"), lag=self.lag)
            for name in names
        ]
        return Follower(
            own_state=ExactState(),
            controller=nothing,
            speed_law=law,
            guard=SpeedGuard(law, degradation, setup) if self.degrades else None,
            control=Cadence(SECOND, 50.0),
            sources=Sources(
                sources,
                degradation,
                lead="v1",
                predecessor=names[-1],
                lateral=names,
                longitudinal=names,
                relay=place - 2,
            ),
            least_spacing=LENGTH,
            alpha=0.5,
            fusion=nothing,
            settings=FitSettings(),
            degradation=degradation,
            reaction=Degrade() if self.degrades else Extrapolate(),
            drive_lag=self.lag,
        )

    def _law(self, setup: LongitudinalSetup) -> SpeedLaw:
        if self.law == "same":
            return ProfileSpeed(SpeedProfile((0.0,), (self.speed,)), SECOND, STEP)
        if self.controller is not None or self.law == "gap":
            return GapKeeping(setup, self.controller)
        controllers: dict[str, Callable[[], LongitudinalController]] = {
            "acc": lambda: Acc(setup, AccSettings()),
            "cacc": lambda: Cacc(setup, CaccSettings()),
            "ploeg": lambda: Ploeg(setup, PloegSettings()),
            "flatbed": lambda: Flatbed(setup, FlatbedSettings()),
        }
        return GapKeeping(setup, controllers[self.law]())

    @property
    def gaps(self) -> Floats:
        """True gaps (m) between the bumpers, by instant and follower."""
        found: Floats = self.places[:, :-1] - self.places[:, 1:] - LENGTH
        return found

    @property
    def contacts(self) -> bool:
        return bool(self.gaps.min() < 0.0)

    def hardest(self, since: float = 0.0) -> Floats:
        """Hardest commanded braking (m/s²) of each follower."""
        found: Floats = -self.accelerations[round(since / STEP) :, 1:].min(axis=0)
        return found


def _message(
    sender: int, seq: int, now: int, speed: float, announced: Sequence[Announcement]
) -> GpsPose:
    one = announced[sender]
    return pose(
        f"v{sender + 1}",
        seq,
        now,
        heading_deg=90.0,
        speed_mps=max(speed, 0.0),
        mode="path" if sender == 0 else one.mode,
        hazard=one.hazard,
        acceleration_mps2=one.acceleration_mps2,
        stops_at_ns=one.stops_at_ns,
        relayed_stops_at_ns=one.relayed_stops_at_ns,
        achieved_acceleration_mps2=one.achieved_acceleration_mps2,
    )


class _StraightPose(ReceivedPose):
    """A pose with the path history of a car on the straight, oldest first."""

    history: list[Place]

    def path_history(self) -> list[Place]:
        return self.history


def _pose(
    message: GpsPose, now: int, east: float, speed: float, driven: list[Place]
) -> ReceivedPose:
    at = message.measured_at_ns
    received = _StraightPose(message, now, at, east, 0.0, 0.0, speed, 0.0, 0.02)
    received.history = driven
    return received
