"""Hardest braking of the lead that followers hold without a contact, by their own speed law.

The convoy is simulated along the road only: exact positions and speeds, poses and measurements of
a gap sensor at their rate and delay, the longitudinal controller at the rate of control, and the
lag of the drive. The lead begins to brake just after it has sent a pose, and stops.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import accumulate
from math import ceil, floor, inf, log

from scenarios.definition.channel.build import usual_delay_ms, vehicles_between
from scenarios.definition.channel.expected import expected_channel
from scenarios.definition.check.preview import spacing_to
from scenarios.definition.scenario import Scenario
from vehicles.car.dynamics import achieved_acceleration
from vehicles.car.sensors.gap_sensor import GapSensorSettings
from vehicles.car.tyres import GRAVITY
from vehicles.driver.degradation.situation import SourceFreshness
from vehicles.driver.longitudinal.controller import (
    LongitudinalController,
    OwnMotion,
    SourceMotion,
    VehiclesAhead,
)
from vehicles.driver.longitudinal.spacing import GapLimits, SpacingPolicy
from vehicles.schedule import MILLISECOND, SECOND

HARD_BRAKING = 6.0
"""Hard braking (m/s²) on a dry road; a warning is due if followers do not hold it."""

RARE = 0.01
"""Probability that some follower loses more poses in a row than assumed, when the lead brakes."""

FOLLOWERS_MAX = 12
"""Simulated followers; the first ones come closest."""

LOST_MAX = 0.99
"""Largest share of lost poses that is simulated."""

HALVINGS = 8
RESOLUTION = 0.04
"""Resolution (m/s²) of the bisection, from the grip of a dry road."""

STANDSTILL = 0.1
"""Below this speed (m/s) of all vehicles the simulation ends."""

LONGEST = 60.0
"""Longest simulated time (s)."""

ROUNDING = 1e-6
"""Share of an interval that covers rounding errors of instants."""


@dataclass(frozen=True, slots=True)
class HeldBraking:
    """Hardest braking of the lead (m/s²) without a contact, from a speed (m/s).

    At harder braking `follower` hits its predecessor first: it keeps a gap of `gap` (m), brakes at
    up to `limit` (m/s²) and receives poses that are up to `age` (s) old. It is empty if nobody is
    hit up to the limit of the lead's tyres.
    """

    braking: float
    speed: float
    follower: str
    gap: float
    limit: float
    age: float


@dataclass(frozen=True, slots=True)
class _PoseSource:
    """Name and place of a source, interval of its received poses (s) and their delay (s)."""

    name: str
    place: int
    interval: float
    delay: float


@dataclass(frozen=True, slots=True)
class _GapFollower:
    """A follower with its longitudinal sources; `predecessor` is None if it is not received."""

    lead: str
    predecessor: _PoseSource | None
    sources: Sequence[_PoseSource]
    policy: SpacingPolicy
    limits: GapLimits
    controller: LongitudinalController
    least_spacing: float
    sensor: GapSensorSettings | None

    @property
    def nearest(self) -> Sequence[_PoseSource]:
        """The predecessor, or all sources without it."""
        return self.sources if self.predecessor is None else (self.predecessor,)


@dataclass(slots=True)
class _SimulatedMotion:
    """Position (m), speed (m/s) and command (m/s²) of a vehicle, whose drive has a `lag` (s).

    Those `earlier` are the ones before the braking, and then at each instant of control. `achieved`
    (m/s²) is the acceleration that the drive has reached.
    """

    position: float
    speed: float
    lag: float
    acceleration: float = 0.0
    achieved: float = 0.0
    earlier: list[tuple[float, float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.earlier.append((self.position, self.speed, 0.0))

    def advance(self, period: float) -> None:
        """Drive for `period` (s) with a constant command; a standing car forgets its braking."""
        self.earlier.append((self.position, self.speed, self.acceleration))
        before = self.achieved if self.speed > 0.0 else 0.0
        self.achieved = achieved_acceleration(before, self.acceleration, period, self.lag)
        change = self.acceleration * period + (before - self.achieved) * self.lag
        after = max(self.speed + change, 0.0)
        self.position += 0.5 * (self.speed + after) * period
        self.speed = after


def held_braking(scenario: Scenario, speed: float) -> HeldBraking | None:
    """Bisect the braking of the lead from `speed` (m/s); None unless all followers keep a gap."""
    names, period = scenario.vehicle_names, 1.0 / scenario.control_rate_hz
    if scenario.tables.speed.followers != "gap" or len(names) == 1 or scenario.tables.replayed:
        return None
    simulated = names[: FOLLOWERS_MAX + 1]
    lags = [scenario.vehicle(name).parameters.drive_lag for name in simulated]
    followers = [_follower(scenario, name, speed, simulated) for name in simulated[1:]]
    braking, held, too_hard, place = _grip(scenario, names[0]), 0.0, inf, 1
    for _ in range(1 + HALVINGS):
        hit = _first_hit(followers, lags, speed, braking, period)
        if hit is None:
            held = braking
        else:
            too_hard, place = braking, hit
        if too_hard == inf:
            break
        braking = 0.5 * (held + too_hard)
    one = followers[place - 1]
    return HeldBraking(
        braking=held,
        speed=speed,
        follower=names[place] if too_hard < inf else "",
        gap=one.policy.desired(speed) - one.least_spacing,
        limit=one.limits.deceleration,
        age=max(source.delay + source.interval for source in one.nearest),
    )


def braking_warnings(held: HeldBraking | None, planned: float) -> Iterator[str]:
    """Warn if followers hold neither hard nor the lead's `planned` braking (m/s²)."""
    if held is None or not held.follower:
        return
    if held.braking + RESOLUTION >= max(planned, HARD_BRAKING):
        return
    if planned > held.braking:
        plan = f"the lead brakes at up to {planned:.1f} m/s²: a collision is expected"
    else:
        plan = "harder braking of the lead ends in a collision"
    yield (
        f"{held.follower}: from {held.speed:.1f} m/s a gap of {held.gap:.1f} m holds braking of "
        f"the lead up to {held.braking:.1f} m/s², with poses up to {held.age:.2f} s old and own "
        f"braking of up to {held.limit:.1f} m/s²; {plan}. Raise speed.gap.standstill_m, "
        "speed.gap.headway_s or speed.gap.braking_mps2_max."
    )


def _grip(scenario: Scenario, name: str) -> float:
    return scenario.vehicle(name).parameters.friction * GRAVITY


def _follower(
    scenario: Scenario, name: str, speed: float, simulated: Sequence[str]
) -> _GapFollower:
    setup, limits = scenario.vehicle(name), scenario.gap_limits
    braking = min(limits.deceleration, _grip(scenario, name))
    limits = GapLimits(limits.acceleration, braking)
    received = {
        sender: _source(scenario, name, sender, speed)
        for sender in setup.senders
        if sender in simulated
    }
    return _GapFollower(
        lead=setup.lead,
        predecessor=received.get(setup.predecessor or ""),
        sources=[one for sender, one in received.items() if sender in setup.flow.longitudinal],
        policy=scenario.spacing_policy(setup.place),
        limits=limits,
        controller=scenario.longitudinal_controller(name, limits),
        least_spacing=scenario.least_spacings[setup.place],
        sensor=setup.gap_sensor,
    )


def _source(scenario: Scenario, name: str, source: str, speed: float) -> _PoseSource:
    """Interval and delay of poses; the interval covers several losses in a row."""
    sender, setup = scenario.vehicle(source), scenario.vehicle(name)
    link = scenario.links[source, name]
    distance = spacing_to(scenario, setup.place, source, speed)
    between = partial(vehicles_between, scenario.route, sender.place, setup.place)
    loss = expected_channel(link, sender.highest_rate_hz, distance, between).loss_ratio
    lost = min(link.loss_ratio if loss is None else loss, LOST_MAX)
    sent = sender.usual_rate_hz(speed)
    rate = min(sent, link.rate_hz or sent)
    rare = RARE / (len(scenario.vehicle_names) - 1)
    in_a_row = ceil(log(rare) / log(lost)) if lost > rare else 1
    delay = (sender.gnss.latency / MILLISECOND + usual_delay_ms(link)) / 1000.0
    return _PoseSource(source, sender.place, in_a_row / rate, delay)


def _first_hit(
    followers: Sequence[_GapFollower],
    lags: Sequence[float],
    speed: float,
    braking: float,
    period: float,
) -> int | None:
    """Place of the follower that first touches its predecessor; None without a contact."""
    spacings = [one.policy.desired(speed) for one in followers]
    places = [-place for place in accumulate(spacings, initial=0.0)]
    convoy = [_SimulatedMotion(place, speed, lag) for place, lag in zip(places, lags, strict=True)]
    convoy[0].acceleration = -braking
    tick = 0
    while max(one.speed for one in convoy) > STANDSTILL and tick * period < LONGEST:
        for place, follower in enumerate(followers, 1):
            convoy[place].acceleration = _command(follower, place, convoy, tick * period, period)
        for one in convoy:
            one.advance(period)
        for place, follower in enumerate(followers, 1):
            spacing = convoy[place - 1].position - convoy[place].position
            if spacing <= follower.least_spacing:
                return place
        tick += 1
    return None


def _command(
    follower: _GapFollower,
    place: int,
    convoy: Sequence[_SimulatedMotion],
    now: float,
    period: float,
) -> float:
    own = convoy[place]
    ahead = VehiclesAhead(own=OwnMotion(period, own.acceleration, own.position, own.achieved))
    sources = {}
    for source in follower.sources:
        position, motion = _newest(source, convoy, now, period)
        sources[source.name] = SourceMotion(
            position - own.position, motion.speed, motion.acceleration, motion.age
        )
        if source.name == follower.lead:
            _, ahead.lead_speed, ahead.lead_acceleration = motion.predicted_motion()
    ahead.sources = sources
    if follower.predecessor is not None:
        position, motion = _newest(follower.predecessor, convoy, now, period)
        driven, ahead.predecessor_speed, ahead.predecessor_acceleration = motion.predicted_motion()
        ahead.spacing = position + driven - own.position
    if follower.sensor is not None:
        _measure(follower, follower.sensor, ahead, convoy[place - 1 : place + 1], period)
    limits = follower.limits
    wanted = follower.controller.acceleration(own.speed, ahead)
    return min(max(wanted, -limits.deceleration), limits.acceleration)


def _measure(
    follower: _GapFollower,
    sensor: GapSensorSettings,
    ahead: VehiclesAhead,
    pair: Sequence[_SimulatedMotion],
    period: float,
) -> None:
    """Add the oldest measurement that the sensor makes between a predecessor and a follower."""
    ticks = ceil((sensor.latency / SECOND + 1.0 / sensor.rate) / period - ROUNDING)
    age = ticks * period
    (place, speed, _), (own_place, own_speed, _) = (
        one.earlier[max(len(one.earlier) - ticks, 0)] for one in pair
    )
    gap, rate = place - own_place - follower.least_spacing, speed - own_speed
    if gap <= sensor.reach:
        ahead.measured_gap, ahead.measured_gap_rate = gap + rate * age, rate
        ahead.measured_gap_age = age


def _newest(
    source: _PoseSource, convoy: Sequence[_SimulatedMotion], now: float, period: float
) -> tuple[float, SourceFreshness]:
    """Position (m) and motion of a source in its newest pose received at `now` (s).

    Pose 0 was sent at time 0, just before the lead began to brake.
    """
    index = floor((now - source.delay) / source.interval + ROUNDING)
    tick = floor(index * source.interval / period + ROUNDING) if index > 0 else -1
    position, speed, acceleration = convoy[source.place].earlier[tick + 1]
    age = now - max(tick, 0) * period
    return position, SourceFreshness(age=age, speed=speed, acceleration=acceleration)
