"""Speed of a follower while messages fail; SI units."""

from dataclasses import dataclass, replace
from math import inf, isfinite, isnan, nan, sqrt
from typing import Final, Protocol

from vehicles.car.tyres import GRAVITY
from vehicles.driver.controller import GapLimits, SpacingPolicy, VehiclesAhead
from vehicles.driver.longitudinal_laws import STABLE_HEADWAY
from vehicles.driver.own_state import Pose
from vehicles.driver.settings import Braking, DegradationSettings
from vehicles.driver.situation import (
    CREEP_SPEED,
    GUARD_MARGIN,
    LOST,
    OFF_PATH,
    SLOWING,
    STANDSTILL,
    STOP_MARGIN,
    AnnouncedStop,
    Situation,
    SourceFreshness,
    braking_share,
    friction_left,
    needed_deceleration,
    safe_reserve,
    stopping_distance,
)
from vehicles.driver.source import AgeWatch
from vehicles.driver.speed import GapKeeping, SpeedCommand, SpeedLaw
from vehicles.messages import Mode
from vehicles.schedule import SECOND

HEADWAY_RATE: Final = 0.5
"""Speed (m/s) at which gaps open to a stable headway and close again. All followers do so at once,
so the last of eight vehicles falls back at seven times that speed."""

LEAD_FADE_TIME: Final = 1.0  # Time constant (s) of replacing a lost lead's speed
FALLEN_BEHIND: Final = 1.0  # A slower predecessor (m/s) does not drive the common speed
CAUGHT_UP: Final = 0.5  # Errors (m, m/s) below which the common speed is resumed
CLOSER: Final = 0.5  # Loss of spacing (m) from which gap keeping replaces it
LIMIT_TIME: Final = 0.5  # Time constant (s) with which a car slows to a speed limit


class SpeedOverride(Protocol):
    """Overrides the speed law of a follower; the attributes are those of `SpeedGuard`."""

    is_slowed: bool
    stops_behind: bool
    brakes_at: int

    def command(
        self, now: int, pose: Pose, ahead: VehiclesAhead, situation: Situation, mode: Mode
    ) -> SpeedCommand:
        """Command at `now` (ns) while the car steers along `mode`, once per control instant."""
        ...


class NoOverride:
    """Leaves the speed law of a follower as it is, whatever is received."""

    def __init__(self, law: SpeedLaw) -> None:
        self._law = law
        self.is_slowed = self.stops_behind = False
        self.brakes_at = 0

    def command(
        self, now: int, pose: Pose, ahead: VehiclesAhead, situation: Situation, mode: Mode
    ) -> SpeedCommand:
        return self._law.command(now, pose, ahead)


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardedCar:
    """Constants of a guarded car and of its position in the convoy.

    `least_spacing` (m) to the predecessor, at which the bumpers touch; `friction` of the road;
    `policy` and `limits` of gap keeping (at a common speed: the spacing at the start);
    `initial_spacing` (m) at the start; expected `period` (s) between the predecessor's messages;
    `drive_lag` (s) of the car, which lengthens a stop by at most its product with the speed.
    """

    least_spacing: float
    friction: float
    policy: SpacingPolicy
    limits: GapLimits
    initial_spacing: float
    period: float
    drive_lag: float = 0.0


@dataclass(slots=True)
class _Instant:
    """Inputs at a control instant `now` (ns), `span` (s) after the last one.

    `spacing` (m, arc length), `speed` (m/s) and `age` (s) are of the predecessor's newest sample.
    """

    now: int
    span: float
    pose: Pose
    ahead: VehiclesAhead
    situation: Situation
    wanted: SpeedCommand
    emergency: Braking
    spacing: float
    speed: float
    age: float


class SpeedGuard:
    """Overrides the speed law of a follower while messages fail.

    Beyond the paper, whose followers drive the profile whatever they receive. The guard stops
    within the known path while no source is received, opens the gap while the predecessor is late
    or the lead is lost, keeps the safe distance of Shalev-Shwartz, Shammah and Shashua, 2017 (RSS),
    and catches up afterwards. It protects the gap to the predecessor, which must be received,
    whatever other vehicles are received: their poses do not show whether it brakes.

    `stops_behind` is True while the predecessor is assumed to stop as announced and this takes more
    than comfortable braking. While `is_slowed` is set, the car falls back for another reason, and
    has to catch up. At `brakes_at` (ns, 0 for never) the car will brake hard unless the predecessor
    is received.
    """

    def __init__(self, law: SpeedLaw, settings: DegradationSettings, car: GuardedCar) -> None:
        self._law = law
        self._keeps_gap = isinstance(law, GapKeeping)
        self._keeping = law if self._keeps_gap else GapKeeping(car.policy, car.limits)
        self._settings = settings
        self._comfortable, self._emergency = settings.comfortable, settings.emergency
        self._car = car
        self._friction = car.friction * GRAVITY
        self._ages = AgeWatch(settings, car.period)
        self._first_at: int | None = None
        self._driven = 0.0
        self._first_speed = 0.0
        self._at = 0
        self._last = 0.0
        self._held = False
        self._following = False
        self._settled_at = 0
        self._was_safe = False
        self._announced = AnnouncedStop(self._emergency)
        self.is_slowed = False
        self.stops_behind = False
        self.brakes_at = 0
        self._headway = 0.0
        self._lead_speed = nan

    def command(
        self, now: int, pose: Pose, ahead: VehiclesAhead, situation: Situation, mode: Mode
    ) -> SpeedCommand:
        usual = self._law.command(now, pose, ahead)
        span = self._advance(now, pose.speed)
        self.stops_behind = False
        predecessor, emergency = situation.predecessor, self._available_braking(pose)
        sample = self._sample(now, pose, ahead, predecessor)
        tick = _Instant(now, span, pose, ahead, situation, usual, emergency, *sample)
        self._ages.observe(now, tick.age, predecessor)
        warned = _warns(predecessor, now)
        blind = mode in SLOWING
        expects_stop = self._announced.is_expected(now, predecessor)
        limit = self._speed_limit(situation, mode)
        alert = blind or warned or limit < inf or self._ages.is_recently_late(now)
        self._update_following(tick, alert=alert or self.is_slowed)
        reserve, opening = self._reserve(tick), self._opening(tick)
        alone = self._headway > 0.0 or situation.lead.status in LOST
        if not (alert or self._following or self._held or opening or alone):
            self._lead_speed = ahead.lead_speed
            self._was_safe = reserve >= 0.0
            self.brakes_at = 0
            self._last = usual.acceleration
            return usual
        self._was_safe = self._was_safe or reserve >= 0.0
        self.brakes_at = self._brakes_at(tick, reserve)
        # Without any source it stops within the known path, whatever the gap.
        free = wanted = self._keep_gap(tick, 0.0 if blind else opening)
        if (
            warned
            and ahead.spacing < self._car.policy.desired(pose.speed) + self._car.least_spacing
        ):
            wanted = min(wanted, predecessor.acceleration)
        if alert:
            safe = self._safe_acceleration(tick, reserve)
            wanted = min(wanted, safe, self._within_limit(tick, limit))
        if expects_stop:
            wanted = min(wanted, self._stop_behind(tick))
        self.stops_behind = expects_stop and wanted < -self._comfortable.deceleration
        if blind:
            wanted = min(wanted, self._stop_within_known(tick, firmly=mode == "stop"))
        return self._release_brake(tick, wanted, free)

    def _advance(self, now: int, speed: float) -> float:
        """Add the distance driven at `speed` (m/s); returns the time (s) since the last instant."""
        if self._first_at is None:
            self._first_at, self._first_speed, self._at = now, speed, now
        span = (now - self._at) / SECOND
        self._at = now
        self._driven += speed * span
        return span

    def _sample(
        self, now: int, pose: Pose, ahead: VehiclesAhead, predecessor: SourceFreshness
    ) -> tuple[float, float, float]:
        """Spacing (m), speed (m/s) and age (s) of the predecessor's newest sample.

        While its messages are not fresh, the gap sensor's measurement is that sample, if there is
        one. Before the first message the predecessor is assumed at its initial position, as fast as
        the car itself.
        """
        age, speed = predecessor.age, predecessor.speed
        if predecessor.status != "fresh" and isfinite(ahead.measured_gap):
            speed, age = max(pose.speed + ahead.measured_gap_rate, 0.0), ahead.measured_gap_age
            return ahead.measured_gap + self._car.least_spacing - speed * age, speed, age
        if isnan(ahead.spacing) or isnan(age):
            age = (now - (self._first_at or 0)) / SECOND
            return self._car.initial_spacing - self._driven, self._first_speed, age
        driven, _, _ = predecessor.predicted_motion()
        return ahead.spacing - driven, 0.0 if speed < 0.0 else speed, age

    def _available_braking(self, pose: Pose) -> Braking:
        """Emergency braking that the lateral acceleration leaves, by the friction circle."""
        emergency = self._emergency
        left = friction_left(self._car.friction, pose.speed * pose.yaw_rate)
        if 0.1 <= emergency.deceleration <= left:
            return emergency
        return replace(emergency, deceleration=max(min(emergency.deceleration, left), 0.1))

    def _reserve(self, tick: _Instant) -> float:
        """Distance (m) left (RSS) if both brake hard, the predecessor from its newest sample."""
        harder = self._emergency.deceleration
        announced = -tick.situation.predecessor.acceleration
        if announced > harder:
            harder = announced
        if harder > self._friction:
            harder = self._friction
        own = stopping_distance(tick.pose.speed, self._last, tick.emergency)
        own += self._car.drive_lag * tick.pose.speed
        return safe_reserve(tick.spacing - self._car.least_spacing, tick.speed, harder, own)

    def _safe_acceleration(self, tick: _Instant, reserve: float) -> float:
        """Largest acceleration (m/s²) that keeps the safe distance of RSS.

        Braking increases to the hardest while the reserve (m) is used up, so that the last instant
        to brake is never missed. A convoy that is already closer opens gently, so that followers
        can react, unless the predecessor was never received.
        """
        share = braking_share(reserve, tick.pose.speed)
        if share == 0.0:
            return inf
        most, jerk = tick.emergency.deceleration, tick.emergency.jerk
        if tick.pose.speed < STANDSTILL:
            most = self._comfortable.deceleration
        elif not self._was_safe:
            predecessor = tick.situation.predecessor
            lost_at_start = predecessor.status == "unheard" and 0 < predecessor.lost_at <= tick.now
            if not lost_at_start:
                most = min(most, self._comfortable.deceleration)
                jerk = self._comfortable.jerk
        return max(-share * most, self._last - jerk * tick.span)

    def _brakes_at(self, tick: _Instant, reserve: float) -> int:
        """Instant (ns) at which the guard will brake hard unless the predecessor is received, or 0.

        Announced only for a silence longer than any recent one: for shorter ones the gap was
        opened. Without a safe distance in the first place it brakes comfortably.
        """
        if tick.now - round(tick.age * SECOND) < self.brakes_at <= tick.now:
            return self.brakes_at  # braking, and no newer sample received
        predecessor = tick.situation.predecessor
        waits = predecessor.status == "unheard"
        if not ((self._was_safe or waits) and self._ages.is_new_peak(tick.now)):
            return 0
        if self._last < -self._settings.firm.deceleration:
            return tick.now
        needed = tick.now + round(max(reserve, 0.0) / max(tick.pose.speed, 0.1) * SECOND)
        return max(needed, predecessor.lost_at) if waits else needed

    def _speed_limit(self, situation: Situation, mode: Mode) -> float:
        """Speed (m/s) that a return to the path or a hole ahead permits, infinite without them."""
        if mode != "creep":
            return situation.speed_limit
        left = max(situation.known - STOP_MARGIN, 0.0)
        creep = sqrt(CREEP_SPEED**2 + 2.0 * self._comfortable.deceleration * left)
        return min(creep, situation.speed_limit)

    def _within_limit(self, tick: _Instant, limit: float) -> float:
        """Mildest acceleration (m/s²) that keeps to a speed `limit` (m/s), if it is finite."""
        if tick.pose.speed < STANDSTILL and limit < STANDSTILL:
            return -self._comfortable.deceleration
        wanted = (limit - tick.pose.speed) / LIMIT_TIME
        if wanted == inf:
            return inf
        firm = self._settings.firm if tick.situation.known > 0.0 else tick.emergency
        return max(wanted, -firm.deceleration, self._last - firm.jerk * tick.span)

    def _stop_within_known(self, tick: _Instant, *, firmly: bool) -> float:
        """Mildest acceleration (m/s²) that stops within the known path."""
        braking, emergency = self._comfortable, tick.emergency
        if tick.pose.speed < STANDSTILL:
            return -braking.deceleration
        if firmly:
            braking = emergency
        known = 0.0 if isnan(tick.situation.known) else tick.situation.known
        left = known - STOP_MARGIN - self._car.drive_lag * tick.pose.speed
        needed = needed_deceleration(tick.pose.speed, left, self._last, braking.jerk)
        most = min(needed, braking.deceleration, emergency.deceleration)
        return max(-most, self._last - braking.jerk * tick.span)

    def _stop_behind(self, tick: _Instant) -> float:
        """Mildest acceleration (m/s²) that stops behind a predecessor that stops as announced."""
        predecessor = tick.situation.predecessor
        distance = self._announced.distance(tick.now, tick.speed, tick.age, predecessor)
        left = tick.spacing + distance - self._car.least_spacing - GUARD_MARGIN
        left -= self._car.drive_lag * tick.pose.speed
        emergency = tick.emergency
        needed = needed_deceleration(tick.pose.speed, left, self._last, emergency.jerk)
        return max(-min(needed, emergency.deceleration), self._last - emergency.jerk * tick.span)

    def _opening(self, tick: _Instant) -> float:
        """Widening of the gap (m): speed times growth of age, at least to the RSS distance."""
        growth = self._ages.growth(tick.now)
        if growth <= 0.0:
            return 0.0
        speed, policy = tick.pose.speed, self._car.policy
        worst = self._emergency.deceleration
        own = stopping_distance(speed, 0.0, tick.emergency) - speed * speed / (2.0 * worst)
        late = self._ages.usual + growth + self._car.drive_lag
        needed = self._car.least_spacing + GUARD_MARGIN + own + speed * late
        return max(speed * growth, needed - policy.desired(speed), 0.0)

    def _without_lead(self, tick: _Instant) -> VehiclesAhead:
        """Fade out a lost lead's speed while the headway grows to a stable one.

        At that headway the lead's speed is not needed (Swaroop and Hedrick, 1996).
        """
        ahead, speed = tick.ahead, tick.pose.speed
        lost = tick.situation.lead.status in LOST and (self._keeps_gap or self._following)
        missing = max(STABLE_HEADWAY - self._car.policy.headway, 0.0) if lost else 0.0
        step = HEADWAY_RATE / max(speed, 1.0) * tick.span
        self._headway = min(max(missing, self._headway - step), self._headway + step)
        if lost:
            known = self._lead_speed if isfinite(self._lead_speed) else ahead.predecessor_speed
            share = min(tick.span / LEAD_FADE_TIME, 1.0)
            self._lead_speed = known + share * (ahead.predecessor_speed - known)
            ahead = ahead.replaced(ahead.spacing, self._lead_speed, nan)
        else:
            self._lead_speed = ahead.lead_speed
        if not self._headway:
            return ahead
        left = 1.0 - self._headway / STABLE_HEADWAY
        lead = ahead.predecessor_speed + left * (ahead.lead_speed - ahead.predecessor_speed)
        return ahead.replaced(ahead.spacing - self._headway * speed, lead, ahead.lead_acceleration)

    def _keep_gap(self, tick: _Instant, opening: float) -> float:
        """Acceleration (m/s²) that keeps the gap, or widens it comfortably by `opening` (m)."""
        ahead = self._without_lead(tick)
        if isnan(ahead.spacing) or not (self._keeps_gap or self._following):
            return tick.wanted.acceleration
        if opening or self._following:
            # A lead that continues while the predecessor falls back must not pull the car closer.
            slower = min(ahead.lead_speed, ahead.predecessor_speed)
            braking = min(ahead.lead_acceleration, ahead.predecessor_acceleration)
            ahead = ahead.replaced(ahead.spacing, slower, braking)
        usual = self._keeping.command(tick.now, tick.pose, ahead).acceleration
        if not opening:
            return usual
        wider = ahead.replaced(ahead.spacing - opening, ahead.lead_speed, ahead.lead_acceleration)
        opened = self._keeping.command(tick.now, tick.pose, wider).acceleration
        comfortable = self._comfortable
        eased = min(self._last, 0.0) - comfortable.jerk * tick.span
        return max(opened, min(usual, max(-comfortable.deceleration, eased)))

    def _update_following(self, tick: _Instant, *, alert: bool) -> None:
        """Switch a car of a convoy with a common speed to gap keeping until it has caught up."""
        spacing = tick.ahead.spacing
        if self._keeps_gap or isnan(spacing):
            return
        common = tick.wanted.target_speed
        initial = self._car.initial_spacing
        slower = tick.ahead.predecessor_speed < common - FALLEN_BEHIND
        apart = slower or spacing < initial - CLOSER
        if not self._following:
            if not (alert or apart):
                return
            self._following = True
        settled = (
            not (alert or apart or self._ages.growth(tick.now))
            and abs(spacing - initial) < CAUGHT_UP
            and abs(tick.pose.speed - common) < CAUGHT_UP
        )
        if not settled:
            self._settled_at = tick.now
        elif tick.now - self._settled_at >= self._settings.probation * SECOND:
            self._following = False

    def _release_brake(self, tick: _Instant, wanted: float, free: float) -> SpeedCommand:
        settings, usual = self._settings, tick.wanted
        jerk = settings.emergency.jerk if self._last < 0.0 else settings.firm.jerk
        upper = self._last + jerk * tick.span
        held = wanted < free or free != usual.acceleration
        if (held or self._held) and wanted > upper:
            wanted, held = upper, True
        # Friction takes precedence over jerk, but the law may brake as it would without loss.
        wanted = max(wanted, min(-tick.emergency.deceleration, usual.acceleration))
        self._held, self._last = held, wanted
        if wanted == usual.acceleration:
            return usual
        return SpeedCommand(wanted, min(usual.target_speed, tick.pose.speed))


def _warns(predecessor: SourceFreshness, now: int) -> bool:
    """Whether the predecessor announced trouble, or a stop that has begun at `now` (ns)."""
    announced = predecessor.hazard or predecessor.mode in OFF_PATH
    return announced or 0 < predecessor.stops_at <= now
