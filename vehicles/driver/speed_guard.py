"""Speed of a follower that misses messages: what overrides its longitudinal law, and why; SI units.

The law always acts on the predicted motion of the vehicles ahead: a missing message is no event.
What overrides it needs evidence: received or measured braking, a contact that was received or
measured, an announced stop, the end of the known path, or the silence of a source that its usual
losses do not explain (see `source.Reception`).
"""

from dataclasses import dataclass
from math import inf, isfinite, isnan, nan, sqrt
from typing import Final

from vehicles.car.tyres import GRAVITY
from vehicles.driver.controller import (
    LASTING,
    LongitudinalSetup,
    VehiclesAhead,
    predicted_motion,
)
from vehicles.driver.longitudinal_laws import STABLE_HEADWAY, acc_acceleration
from vehicles.driver.own_state import Pose
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import (
    CREEP_SPEED,
    GUARD_MARGIN,
    LOST,
    STANDSTILL,
    STOP_MARGIN,
    Situation,
    needed_deceleration,
    stopping_distance,
)
from vehicles.driver.speed import GapKeeping, SpeedCommand, SpeedLaw
from vehicles.messages import Override, State
from vehicles.schedule import SECOND

TYRES_USED: Final = 0.9  # Share of the friction that contact braking uses
ANNOUNCED_MARGIN: Final = 1.5  # Gap (m) that remains behind a predecessor that stops as announced
ANNOUNCED_DELAY: Final = 0.04  # Delay (s) of that stop beyond the drive lag: two control periods
RELEASE_JERK: Final = 5.0  # Jerk (m/s³) at which an override lets the acceleration grow again
LIMIT_TIME: Final = 0.5  # Time constant (s) with which a car slows to a speed limit
LEAD_ONLY_SHARE, LEAD_ONLY_HEADWAY, LEAD_ONLY_ACCELERATION = 0.92, 1.5, 0.5
"""A car that receives the lead, but not its predecessor, drives at this share of the lead's speed
up to this headway (s), with at most this acceleration (m/s²) beyond the lead's."""
SENSOR_FILTER: Final = 0.3  # Time constant (s) of the predecessor's acceleration by the gap sensor
HARDEST_SENSED: Final = 12.0  # Largest acceleration (m/s²) that the gap sensor can show
REFERENCE_FALL: Final = 0.1  # Relative rate (1/s) at which the speed limit of catching up may fall
HEADWAY_RATE: Final = 0.5
"""Speed (m/s) at which gaps open to a stable headway without the lead, and close again. All
followers do so at once, so the last of eight vehicles falls back at seven times that speed."""
OUTRUN_FOR: Final = 1.0  # Time (s) for which the known path may end behind a car
FALLEN_BACK: Final = 5.0  # Known path (m) with which it follows again after falling back
BEFORE_HOLE: Final = 0.5  # Share of comfortable braking from which a car slows before a hole
OTHER_SPEED: Final = 1.0  # Difference (m/s) of a predecessor that does not drive the common speed
PLAN_BRAKING: Final = 1.0  # Braking (m/s²) announced beyond the common plan
OLD_AFTER: Final = 2.5  # Periods after which the gap sensor replaces the predecessor's pose
JOINT_AGE: Final = 0.1  # The lead's pose may be this (s) older than the predecessor's
FAR: Final = 5.0  # Gap error (m) from which a car is catching up
LEAST_CLOSING: Final = 0.2  # Closing speed (m/s) from which a contact is expected
LEAST_ROOM, LEAST_LEFT = 0.3, 0.05
"""Distances (m) that bound the braking of a car that has none left."""
BARRIER_TIME: Final = 0.3  # Time constant (s) with which a law that creeps closer is limited
OFF_PLACE, IN_PLACE, IN_PACE = 0.5, 0.2, 0.3
"""Spacing errors (m) at which a car leaves the common speed and resumes it, and the difference of
speed (m/s) at which it resumes it."""

SMOOTH: Final = ("contact", "announced stop", "known path", "return", "position")
"""Overrides that limit the jerk while the car follows; contact braking begins at once."""
BY_STATE: dict[State, Override] = {"alone": "alone", "stop": "known path"}
"""Override by the state where only the jerk is limited; in other states it is "return"."""


@dataclass(slots=True)
class _Instant:
    """A control instant, and the vehicle ahead as received, measured or assumed.

    `speed` (m/s) is the car's own, `span` (s) the time since the last instant, `hardest` (m/s²) the
    braking that the tyres permit, `received` (m) the gap by the predecessor's poses. The vehicle
    ahead is `gap` (m) away, between bumpers, and has `its_speed` (m/s) and a commanded or measured
    `acceleration` (m/s²); it is `closing` (m/s) slower.
    """

    now: int
    speed: float
    span: float
    hardest: float
    received: float
    ahead: VehiclesAhead
    situation: Situation
    gap: float = nan
    its_speed: float = nan
    acceleration: float = 0.0
    by_sensor: bool = False
    closing: float = nan


class SpeedGuard:
    """Overrides the speed law of a follower where messages or the gap sensor give a reason.

    Beyond the paper, whose followers drive the profile whatever they receive. The least
    acceleration of all reasons is taken, and the one that decided is reported.
    """

    def __init__(
        self, law: SpeedLaw, settings: DegradationSettings, setup: LongitudinalSetup
    ) -> None:
        self._law = law
        self._keeping = law if isinstance(law, GapKeeping) else GapKeeping(setup)
        self._keeps_gap = law is self._keeping
        self._settings, self._setup = settings, setup
        self._lag, self._least = setup.parameters.drive_lag, setup.least_spacing
        self._comfort = settings.comfortable_deceleration
        self._at: int | None = None
        self._last = 0.0
        self._gap, self._its_speed = setup.initial_spacing - self._least, nan  # assumed
        self._headway = 0.0
        self._sensed, self._sensed_speed = 0.0, nan
        self._reference = nan
        self._outrun = 0.0
        self._following = False

    def command(
        self, now: int, pose: Pose, ahead: VehiclesAhead, situation: Situation
    ) -> SpeedCommand:
        """Command of the law, or what overrides it; the law sees `ahead` as changed here."""
        span = 0.0 if self._at is None else (now - self._at) / SECOND
        speed, self._at = pose.speed, now
        most, lateral = self._setup.parameters.friction * GRAVITY, speed * pose.yaw_rate
        hardest = TYRES_USED * sqrt(max(most * most - lateral * lateral, 0.0))  # friction circle
        received = ahead.spacing - self._least
        at = _Instant(now, speed, span, hardest, received, ahead, situation)
        lead_acceleration = ahead.lead_acceleration
        self._locate(at)
        self._prepare(at)
        usual = self._usual(at, pose)
        law = min(usual.acceleration, ahead.bend)
        wanted, override = self._proven(at, usual.acceleration, law, lead_acceleration)
        needed = self._contact(at)
        contact = min(self._barrier(at), -1.1 * needed if needed else inf)
        reasons: tuple[tuple[float, Override], ...] = (
            (max(contact, -hardest), "contact"),
            (self._announced_stop(at), "announced stop"),
            (self._path_end(at), "known path"),
            (self._towards(situation.speed_limit, speed), "return"),
            (self._towards(situation.position_limit, speed), "position"),
        )
        for acceleration, reason in reasons:
            if acceleration < wanted:
                wanted, override = acceleration, reason
        cap = self._catch_up(at)
        if cap < wanted:
            far = at.gap + self._least > self._setup.policy.desired(speed) + FAR
            limited = max(cap, min(wanted, -self._comfort if far else 0.0))
            wanted, override = limited, "catch-up" if limited < wanted else override
        if situation.state != "follow" or override in SMOOTH:
            fall = inf if override == "contact" else self._settings.emergency_jerk * span
            wanted = min(max(wanted, self._last - fall), self._last + RELEASE_JERK * span)
        self._last = wanted
        usual.law, usual.acceleration = law, wanted
        if wanted != law:
            usual.override = override or BY_STATE.get(situation.state, "return")
            usual.evidence = self._words(usual.override, at, needed)
            usual.target_speed = min(usual.target_speed, speed)
        return usual

    # ---- The vehicle ahead, and what the law sees

    def _locate(self, at: _Instant) -> None:
        """Set the vehicle ahead: by the gap sensor while its poses are old, else as received.

        A predecessor that is lost is assumed to move as the lead, from its last or initial place,
        and to stop by emergency braking from the instant on that it announced (`stops_at`).
        """
        ahead, predecessor, span = at.ahead, at.situation.predecessor, at.span
        self._sense(at)
        emergency = self._settings.emergency_deceleration
        alone = at.situation.state == "alone" and not isnan(ahead.lead_speed)
        stops = alone and 0 < predecessor.stops_at <= at.now
        if stops:
            self._its_speed = max(self._its_speed - emergency * span, 0.0)
        elif alone or isnan(self._its_speed):
            self._its_speed = at.speed if isnan(ahead.lead_speed) else ahead.lead_speed
        assumed = alone or isnan(at.received)
        self._gap = self._gap + (self._its_speed - at.speed) * span if assumed else at.received
        is_old = not predecessor.silence <= OLD_AFTER * predecessor.period  # also NaN
        if is_old and isfinite(ahead.measured_gap):
            at.gap, at.its_speed, at.by_sensor = ahead.measured_gap, self._sensed_speed, True
            at.acceleration = self._sensed
        elif alone:
            at.gap, at.its_speed = self._gap, self._its_speed
            command = -emergency if stops and at.its_speed > 0.0 else ahead.lead_acceleration
            at.acceleration = 0.0 if isnan(command) else command
        else:
            at.gap, at.its_speed = at.received, ahead.predecessor_speed
            at.acceleration = ahead.predecessor_acceleration
            self._join(at)
        at.closing = at.speed - at.its_speed

    def _sense(self, at: _Instant) -> None:
        """Speed and acceleration of the vehicle ahead by the gap sensor."""
        rate = at.ahead.measured_gap_rate
        if isnan(rate):
            self._sensed, self._sensed_speed = min(self._sensed, 0.0), nan
            return
        its_speed = max(at.speed + rate, 0.0)
        if at.span > 0.0 and not isnan(self._sensed_speed):
            change = (its_speed - self._sensed_speed) / at.span
            change = min(max(change, -HARDEST_SENSED), HARDEST_SENSED)
            self._sensed += min(at.span / SENSOR_FILTER, 1.0) * (change - self._sensed)
        self._sensed_speed = its_speed

    def _join(self, at: _Instant) -> None:
        """Let a predecessor whose message is missing brake with the lead, if that brakes hard."""
        lead, predecessor = at.situation.lead, at.situation.predecessor
        command = at.ahead.lead_acceleration
        if lead is predecessor or not command < min(LASTING, predecessor.acceleration):
            return
        if predecessor.is_overdue and lead.age < predecessor.age + JOINT_AGE:
            speed, achieved, age = predecessor.speed, predecessor.achieved, predecessor.age
            motion = predicted_motion(speed, achieved, command, age, predecessor.lag)
            at.gap += motion.driven - predecessor.predicted().driven
            at.its_speed, at.acceleration = motion.speed, motion.acceleration

    def _prepare(self, at: _Instant) -> None:
        """Set what the law sees: the vehicle ahead, seemingly closer while the lead is lost.

        At a stable headway the lead's speed is not needed (Swaroop and Hedrick, 1996).
        """
        ahead, lost = at.ahead, at.situation.lead.status in LOST and self._keeps_gap
        missing = max(STABLE_HEADWAY - self._setup.policy.headway, 0.0) if lost else 0.0
        step = HEADWAY_RATE / max(at.speed, 1.0) * at.span
        self._headway = min(max(missing, self._headway - step), self._headway + step)
        ahead.spacing = at.gap + self._least - self._headway * at.speed
        ahead.predecessor_speed, ahead.predecessor_acceleration = at.its_speed, at.acceleration
        if lost:
            ahead.lead_speed = ahead.lead_acceleration = nan

    def _usual(self, at: _Instant, pose: Pose) -> SpeedCommand:
        """Command of the law; of gap keeping where the convoy does not drive its common speed."""
        usual = self._law.command(at.now, pose, at.ahead)
        if self._keeps_gap or isnan(at.gap):
            return usual
        error = abs(at.gap + self._least - self._setup.initial_spacing)
        other = abs(at.its_speed - usual.target_speed)
        planned = min(usual.acceleration, 0.0) - PLAN_BRAKING
        brakes = at.acceleration < planned or at.ahead.lead_acceleration < planned
        off = error > OFF_PLACE or other > OTHER_SPEED or at.situation.position_limit < inf
        if brakes or off or at.situation.state != "follow":
            self._following = True
        elif error < IN_PLACE and other < IN_PACE:
            self._following = False
        return self._keeping.command(at.now, pose, at.ahead) if self._following else usual

    # ---- Evidence for braking

    def _proven(
        self, at: _Instant, usual: float, law: float, lead_acceleration: float
    ) -> tuple[float, Override]:
        """Acceleration (m/s²) with no more braking than the evidence justifies, and its override.

        `usual` is that of the law and `law` the same limited in bends; `lead_acceleration` is NaN
        if unknown. Comfortable braking needs no evidence. Braking that has begun may go on while
        closing.
        """
        state, bend = at.situation.state, at.ahead.bend
        if state == "return" and law > 0.0:
            return 0.0, "return"
        if state != "alone" and (isnan(at.gap) or not (self._keeps_gap or self._following)):
            return law, ""
        of_lead = 0.0 if isnan(lead_acceleration) else -lead_acceleration
        received = max(-at.acceleration, of_lead, 0.0)
        closing = max(at.closing, 0.0)
        relative = closing * closing / (2.0 * self._room(at, closing))
        begun = -self._last if closing > 0.0 else 0.0
        mildest = -max(self._comfort, 1.2 * received + 0.5, 1.5 * relative, begun)
        if state == "alone":
            return min(max(self._alone(at), mildest), bend), "alone"
        if usual >= mildest:
            return law, ""
        wanted = min(mildest, bend)
        return wanted, "unproven" if wanted > law else ""

    def _alone(self, at: _Instant) -> float:
        """Acceleration (m/s²) of a car that receives the lead, but not its predecessor.

        By the gap sensor it is that of ACC, as in the fallback of the laws, else that of the lead,
        a little slower until the headway would be safe behind a car that it does not receive.
        """
        if at.by_sensor:
            headway = self._keeping.fallback_headway
            return acc_acceleration(self._setup, at.speed, at.ahead, headway)
        lead_speed, lead_acceleration = at.ahead.lead_speed, at.ahead.lead_acceleration
        if isnan(lead_speed):
            lead_speed, lead_acceleration = at.speed, 0.0
        share = 1.0 if at.gap > LEAD_ONLY_HEADWAY * at.speed else LEAD_ONLY_SHARE
        step = share * lead_speed - at.speed
        return lead_acceleration + min(max(step, -self._comfort), LEAD_ONLY_ACCELERATION)

    def _room(self, at: _Instant, closing: float) -> float:
        """Distance (m) left for braking, behind the margin and after the car's own delay."""
        return max(LEAST_ROOM, at.gap - GUARD_MARGIN - closing * (self._lag + at.span))

    def _contact(self, at: _Instant) -> float:
        """Braking (m/s²) that avoids a contact, 0 unless more than firm braking is needed.

        Behind a vehicle that brakes at b, c m/s slower and r m ahead, it is b + c²/2r if the speeds
        are equal before that stands, else v²/2(r + v_p²/2b) (kinematics).
        """
        closing, its_speed = at.closing, at.its_speed
        if not closing > LEAST_CLOSING:  # also NaN
            return 0.0
        room, braking = self._room(at, closing), max(-at.acceleration, 0.0)
        if 2.0 * room * braking < closing * its_speed:
            needed = braking + closing * closing / (2.0 * room)
        else:
            its_stop = its_speed * its_speed / (2.0 * max(braking, 0.1))
            needed = at.speed * at.speed / (2.0 * (room + its_stop))
        return needed if needed > self._settings.firm_deceleration else 0.0

    def _barrier(self, at: _Instant) -> float:
        """Acceleration (m/s²) towards the speed from which firm braking ends at the margin."""
        if isnan(at.gap):
            return inf
        left = max(at.gap - GUARD_MARGIN, 0.0)
        closing = sqrt(2.0 * self._settings.firm_deceleration * left)
        return (closing - at.closing) / BARRIER_TIME

    def _announced_stop(self, at: _Instant) -> float:
        """Acceleration (m/s²) that stops behind a silent predecessor that stops as announced.

        It drives on as predicted until the announced instant, and stops with emergency braking from
        then on. Braking that it announced before, if harder than a third of comfortable braking, is
        assumed to last. Both brakes build up alike.
        """
        one = at.situation.predecessor
        free = (one.stops_at - one.measured_at) / SECOND
        if at.by_sensor or not 0 < one.stops_at <= at.now or isnan(at.received):
            return inf
        if not one.is_silent and not 0.0 < free <= one.period:
            return inf  # its braking would be received
        lasting, span = -self._comfort / 3.0, max(free, 0.0)
        until = predicted_motion(one.speed, one.achieved, one.acceleration, span, one.lag, lasting)
        emergency = self._settings.emergency
        its_stop = until.driven + stopping_distance(until.speed, until.acceleration, emergency)
        left = at.received - one.predicted().driven + its_stop - ANNOUNCED_MARGIN
        left -= at.speed * (self._lag + ANNOUNCED_DELAY)
        return -min(needed_deceleration(at.speed, max(left, LEAST_LEFT)), at.hardest)

    def _path_end(self, at: _Instant) -> float:
        """Acceleration (m/s²) that stops within the known path where that is required.

        In the state stop, before a hole of the path, and while a car has outrun what it received,
        as behind messages that take longer than its gap.
        """
        situation, speed, known = at.situation, at.speed, at.situation.known
        emergency = self._settings.emergency_deceleration
        left = (0.0 if isnan(known) else known) - STOP_MARGIN - self._lag * speed
        if situation.state == "stop":
            if speed < STANDSTILL:
                return -self._comfort
            return -min(max(needed_deceleration(speed, max(left, LEAST_LEFT)), 1.0), emergency)
        if situation.hole > 0.0:
            final = CREEP_SPEED if situation.crossable else 0.0
            mild = BEFORE_HOLE * self._comfort if left > 0.0 else 0.0
            allowed = sqrt(final * final + 2.0 * mild * left)
            if speed <= allowed:
                return (allowed - speed) / LIMIT_TIME
            needed = (speed * speed - final * final) / (2.0 * max(left, LEAST_LEFT))
            return -min(needed, (speed - allowed) / LIMIT_TIME + mild, emergency)
        if known > (FALLEN_BACK if self._outrun > OUTRUN_FOR else 0.0) or isnan(known):
            self._outrun = 0.0
        elif situation.state != "start":
            self._outrun += at.span
        return -self._comfort if self._outrun > OUTRUN_FOR else inf

    def _towards(self, limit: float, speed: float) -> float:
        """Acceleration (m/s²) that brakes comfortably to a `limit` (m/s) of the speed."""
        return max((limit - speed) / LIMIT_TIME, -self._comfort)

    def _catch_up(self, at: _Instant) -> float:
        """Acceleration (m/s²) towards the largest speed, a multiple of the reference speed.

        The reference is the lead's speed, or the predecessor's without a lead; it stays while the
        lead is lost. It falls gradually, so that a swinging lead does not limit the car. A car may
        always drive as fast as the one ahead, as while the lead is slow in the next bend.
        """
        known = at.ahead.lead_speed
        if isnan(known) and (isnan(self._reference) or at.situation.lead.status not in LOST):
            known = at.its_speed
        if isnan(self._reference):
            self._reference = known
        elif not isnan(known):
            self._reference = max(known, self._reference * (1.0 - REFERENCE_FALL * at.span))
        if isnan(self._reference):
            return inf
        fastest = max(self._setup.catch_up_ratio * max(self._reference, 0.5), at.its_speed)
        return (fastest - at.speed) / LIMIT_TIME

    def _words(self, override: Override, at: _Instant, needed: float) -> str:
        """The evidence for an override, with its figures."""
        situation, predecessor = at.situation, at.situation.predecessor
        if override == "contact":
            how = "measured" if at.by_sensor else f"received {predecessor.age:.2f} s ago"
            text = f"vehicle ahead in {at.gap:.1f} m at {at.its_speed:.1f} m/s, {how}"
            return f"{text}: needs {needed:.1f} m/s²" if needed else text
        if override == "announced stop":
            return f"announced a stop, last pose {predecessor.silence:.2f} s ago"
        if override == "known path":
            known = f"{max(situation.known, 0.0):.1f} m of known path"
            return f"{known} before a hole of {situation.hole:.1f} m" if situation.hole else known
        if override == "alone":
            silence = predecessor.silence
            how = "not received yet" if isnan(silence) else f"silent for {silence:.1f} s"
            return f"predecessor {how}"
        if override == "catch-up":
            return f"at most {self._setup.catch_up_ratio * self._reference:.1f} m/s"
        return ""
