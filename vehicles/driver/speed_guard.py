"""Speed of a follower that misses messages: what overrides its longitudinal law, and why; SI units.

The law always acts on the predicted motion of the vehicles ahead: a missing message is no event.
What overrides it needs evidence: received or measured braking, a contact that was received or
measured, an announced stop, the end of the known path, or the silence of a source that its usual
losses do not explain (see `source.Reception`).
"""

from dataclasses import dataclass, replace
from math import inf, isfinite, isnan, nan, sqrt
from typing import Final

from vehicles.driver.controller import LongitudinalSetup, VehiclesAhead
from vehicles.driver.longitudinal_laws import (
    STABLE_HEADWAY,
    Fallback,
    headway_acceleration,
)
from vehicles.driver.own_state import Pose
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import (
    CREEP_SPEED,
    GUARD_MARGIN,
    LASTING,
    LOST,
    RELIED_ON,
    STANDSTILL,
    STOP_MARGIN,
    Situation,
    friction_left,
    needed_deceleration,
    predicted_motion,
    stopping_distance,
)
from vehicles.driver.speed import GapKeeping, SpeedCommand, SpeedLaw
from vehicles.messages import Override, State
from vehicles.schedule import SECOND

TYRES_USED: Final = 0.9  # Share of the friction that contact braking uses
ANNOUNCED_MARGIN: Final = 1.5  # Gap (m) that remains behind a predecessor that stops as announced
RELEASE_JERK: Final = 5.0  # Jerk (m/s³) at which an override lets the acceleration grow again
LIMIT_TIME: Final = 0.5  # Time constant (s) with which a car slows to a speed limit
LEAD_ONLY_SHARE: Final = 0.92
LEAD_ONLY_HEADWAY: Final = 1.5
LEAD_ONLY_ACCELERATION: Final = 0.5
"""A car that receives the lead, but not its predecessor, drives at this share of the lead's speed
up to this headway (s), with at most this acceleration (m/s²) beyond the lead's."""
SENSOR_FILTER: Final = 0.3  # Time constant (s) of the predecessor's acceleration by the gap sensor
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
LEAST_ROOM: Final = 0.3
LEAST_LEFT: Final = 0.05
"""Distances (m) that bound the braking of a car that has none left."""
BARRIER_TIME: Final = 0.3  # Time constant (s) with which a law that creeps closer is limited
OFF_PLACE: Final = 0.5
IN_PLACE: Final = 0.2
IN_PACE: Final = 0.3
"""Spacing errors (m) at which a car leaves the common speed and resumes it, and the difference of
speed (m/s) at which it resumes it."""


@dataclass(slots=True)
class _View:
    """The vehicle ahead as received, measured or assumed at a control instant.

    `gap` (m) between the bumpers, `speed` (m/s), commanded or measured `acceleration` (m/s²).
    """

    gap: float
    speed: float
    acceleration: float
    by_sensor: bool = False


SMOOTH: tuple[Override, ...] = (
    "contact",
    "announced stop",
    "known path",
    "return",
    "position",
)
"""Overrides that limit the jerk while the car follows; contact braking begins at once."""
BY_STATE: dict[State, Override] = {
    "start": "return",
    "follow": "contact",
    "alone": "alone",
    "return": "return",
    "stop": "known path",
}
"""Override of an acceleration whose change is limited, by the state of the follower."""


class SpeedGuard:
    """Overrides the speed law of a follower where messages or the gap sensor give a reason.

    Beyond the paper, whose followers drive the profile whatever they receive. The largest
    acceleration of all reasons is taken, and the one that decided is reported.
    """

    def __init__(
        self, law: SpeedLaw, settings: DegradationSettings, setup: LongitudinalSetup
    ) -> None:
        self._law = law
        self._keeps_gap = isinstance(law, GapKeeping)
        self._keeping = law if self._keeps_gap else GapKeeping(setup)
        self._settings, self._setup = settings, setup
        self._lag, self._friction = setup.parameters.drive_lag, setup.parameters.friction
        self._comfort = settings.comfortable_deceleration
        self._at: int | None = None
        self._last = 0.0
        self._assumed = _View(setup.initial_spacing - setup.least_spacing, nan, 0.0)
        self._headway = 0.0
        self._sensed, self._sensed_speed = 0.0, nan
        self._reference = nan
        self._outrun = 0.0
        self._following = False

    def command(
        self, now: int, pose: Pose, ahead: VehiclesAhead, situation: Situation
    ) -> SpeedCommand:
        span = 0.0 if self._at is None else (now - self._at) / SECOND
        self._at = now
        speed, state = pose.speed, situation.state
        hardest = TYRES_USED * friction_left(self._friction, speed * pose.yaw_rate)
        view = self._view(now, ahead, situation, speed, span)
        seen = self._seen(ahead, situation, view, speed, span)
        usual = self._usual(now, pose, seen, situation, view)
        law = wanted = usual.acceleration
        policy, least = self._setup.policy, self._setup.least_spacing
        override: Override = ""
        if state == "alone":
            mildest = -self._evidence(situation, view, speed, span)
            wanted = min(max(self._alone(seen, view, speed), mildest), usual.bend)
            override = "alone"
        elif state == "return" and law > 0.0:
            wanted, override = 0.0, "return"
        elif (self._keeps_gap or self._following) and not isnan(view.gap):
            mildest = -self._evidence(situation, view, speed, span)
            if usual.unbent < mildest:
                wanted = min(mildest, usual.bend)
                override = "unproven" if wanted > law else ""
        needed = self._contact(view, speed, span)
        reasons: tuple[tuple[float, Override], ...] = (
            (max(min(self._barrier(view, speed), -1.1 * needed or inf), -hardest), "contact"),
            (self._announced_stop(now, ahead, situation, view, speed, hardest), "announced stop"),
            (self._path_end(situation, speed, span), "known path"),
            (self._towards(situation.speed_limit, speed), "return"),
            (self._towards(situation.position_limit, speed), "position"),
        )
        for acceleration, reason in reasons:
            if acceleration < wanted:
                wanted, override = acceleration, reason
        cap = self._catch_up(seen, situation, speed, span)
        if cap < wanted:
            mildest = -self._comfort if view.gap + least > policy.desired(speed) + FAR else 0.0
            limited = max(cap, min(wanted, mildest))
            wanted, override = limited, "catch-up" if limited < wanted else override
        if state != "follow" or override in SMOOTH:
            fall = inf if override == "contact" else self._settings.emergency_jerk * span
            wanted = min(max(wanted, self._last - fall), self._last + RELEASE_JERK * span)
        self._last = wanted
        usual.law, usual.acceleration = law, wanted
        if wanted != law:
            usual.override = override or BY_STATE[state]
            usual.evidence = self._words(usual.override, view, situation, needed)
            usual.target_speed = min(usual.target_speed, speed)
        return usual

    # ---- The vehicle ahead, and what the law sees

    def _view(
        self, now: int, ahead: VehiclesAhead, situation: Situation, speed: float, span: float
    ) -> _View:
        """The vehicle ahead by the gap sensor while its poses are old, else as received.

        Without the predecessor it is assumed to move as the lead, from its last or initial place,
        until it stops as it announced, if the lead repeats that.
        """
        predecessor, lead_speed = situation.predecessor, ahead.lead_speed
        rate = ahead.measured_gap_rate
        if not isnan(rate):
            its_speed = max(speed + rate, 0.0)
            if span > 0.0 and not isnan(self._sensed_speed):
                share = min(span / SENSOR_FILTER, 1.0)
                change = (its_speed - self._sensed_speed) / span
                self._sensed += share * (min(max(change, -12.0), 12.0) - self._sensed)
            self._sensed_speed = its_speed
        assumed, emergency = self._assumed, self._settings.emergency_deceleration
        alone = situation.state == "alone" and not isnan(lead_speed)
        stops = alone and 0 < predecessor.stops_at <= now
        if stops:
            assumed.speed = max(assumed.speed - emergency * span, 0.0)
        elif alone or isnan(assumed.speed):
            assumed.speed = speed if isnan(lead_speed) else lead_speed
        if alone or isnan(ahead.spacing):
            assumed.gap += (assumed.speed - speed) * span
        else:
            assumed.gap = ahead.spacing - self._setup.least_spacing
        is_old = not predecessor.silence <= OLD_AFTER * predecessor.period  # also NaN
        if is_old and isfinite(ahead.measured_gap):
            return _View(ahead.measured_gap, self._sensed_speed, self._sensed, by_sensor=True)
        self._sensed = min(self._sensed, 0.0) if isnan(rate) else self._sensed
        if alone:
            braking = -emergency if stops and assumed.speed > 0.0 else ahead.lead_acceleration
            return _View(assumed.gap, assumed.speed, 0.0 if isnan(braking) else braking)
        gap = ahead.spacing - self._setup.least_spacing
        view = _View(gap, ahead.predecessor_speed, ahead.predecessor_acceleration)
        self._join(view, ahead, situation)
        return view

    def _join(self, view: _View, ahead: VehiclesAhead, situation: Situation) -> None:
        """Let a predecessor whose message is missing brake with the lead, if that brakes hard."""
        lead, predecessor, braking = situation.lead, situation.predecessor, ahead.lead_acceleration
        if lead is predecessor or not braking < min(LASTING, predecessor.acceleration):
            return
        if predecessor.is_overdue and lead.age < predecessor.age + JOINT_AGE:
            speed, achieved, age = predecessor.speed, predecessor.achieved, predecessor.age
            motion = predicted_motion(speed, achieved, braking, age, predecessor.lag)
            view.gap += motion.driven - predecessor.predicted().driven
            view.speed, view.acceleration = motion.speed, motion.acceleration

    def _seen(
        self,
        ahead: VehiclesAhead,
        situation: Situation,
        view: _View,
        speed: float,
        span: float,
    ) -> VehiclesAhead:
        """What the law acts on: the vehicle in view, and without a lost lead a wider gap.

        At a stable headway the lead's speed is not needed (Swaroop and Hedrick, 1996).
        """
        lost = situation.lead.status in LOST and self._keeps_gap
        missing = max(STABLE_HEADWAY - self._setup.policy.headway, 0.0) if lost else 0.0
        if self._headway != missing:
            step = HEADWAY_RATE / max(speed, 1.0) * span
            self._headway = min(max(missing, self._headway - step), self._headway + step)
        lead_speed = nan if lost else ahead.lead_speed
        spacing = view.gap + self._setup.least_spacing - self._headway * speed
        if (
            spacing == ahead.spacing
            and view.speed == ahead.predecessor_speed
            and view.acceleration == ahead.predecessor_acceleration
            and not lost
        ):
            return ahead
        return replace(
            ahead,
            spacing=spacing,
            predecessor_speed=view.speed,
            predecessor_acceleration=view.acceleration,
            lead_speed=lead_speed,
            lead_acceleration=nan if lost else ahead.lead_acceleration,
        )

    def _usual(
        self, now: int, pose: Pose, seen: VehiclesAhead, situation: Situation, view: _View
    ) -> SpeedCommand:
        """Command of the law; of gap keeping where the convoy does not drive its common speed."""
        usual = self._law.command(now, pose, seen)
        if self._keeps_gap or isnan(view.gap):
            return usual
        error = view.gap + self._setup.least_spacing - self._setup.initial_spacing
        other = view.speed - usual.target_speed
        planned = min(usual.acceleration, 0.0) - PLAN_BRAKING
        brakes = view.acceleration < planned or seen.lead_acceleration < planned
        brakes = brakes or situation.position_limit < inf
        off = abs(error) > OFF_PLACE or abs(other) > OTHER_SPEED or brakes
        if off or situation.state != "follow":
            self._following = True
        elif abs(error) < IN_PLACE and abs(other) < IN_PACE:
            self._following = False
        if not self._following:
            return usual
        keeping = self._keeping.command(now, pose, seen)
        if usual.bend < keeping.acceleration:
            keeping = SpeedCommand(usual.bend, keeping.target_speed, usual.bend, keeping.unbent)
        return keeping

    def _alone(self, seen: VehiclesAhead, view: _View, speed: float) -> float:
        """Acceleration (m/s²) of a car that receives the lead, but not its predecessor.

        By the gap sensor it is that of ACC, as in the fallback of the laws, else that of the lead,
        a little slower until the headway would be safe behind a car that it does not receive.
        """
        if view.by_sensor:
            policy = self._setup.policy
            headway = max(policy.headway, Fallback.fallback_headway)
            standstill = policy.standstill - self._setup.least_spacing
            return headway_acceleration(view.gap, view.speed - speed, speed, standstill, headway)
        lead_speed, lead_acceleration = seen.lead_speed, seen.lead_acceleration
        if isnan(lead_speed):
            lead_speed, lead_acceleration = speed, 0.0
        share = 1.0 if view.gap > LEAD_ONLY_HEADWAY * speed else LEAD_ONLY_SHARE
        step = share * lead_speed - speed
        return lead_acceleration + min(max(step, -self._comfort), LEAD_ONLY_ACCELERATION)

    # ---- Evidence for braking

    def _evidence(self, situation: Situation, view: _View, speed: float, span: float) -> float:
        """Hardest braking (m/s²) of the law for which something was received or measured.

        Comfortable braking needs no evidence. Braking that has begun may go on while closing.
        """
        lead = situation.ahead.lead_acceleration if situation.ahead else nan
        braking = max(-view.acceleration, 0.0 if isnan(lead) else -lead, 0.0)
        closing = max(speed - view.speed, 0.0)
        relative = closing * closing / (2.0 * self._room(view, closing, span))
        begun = -self._last if closing > 0.0 else 0.0
        return max(self._comfort, 1.2 * braking + 0.5, 1.5 * relative, begun)

    def _room(self, view: _View, closing: float, span: float) -> float:
        """Distance (m) left for braking, behind the margin and after the car's own delay."""
        room = view.gap - GUARD_MARGIN - closing * (self._lag + span)
        return room if room > LEAST_ROOM else LEAST_ROOM

    def _contact(self, view: _View, speed: float, span: float) -> float:
        """Braking (m/s²) that avoids a contact, 0 unless more than firm braking is needed.

        Behind a vehicle that brakes at b, c m/s slower and r m ahead, it is b + c²/2r if the speeds
        are equal before that stands, else v²/2(r + v_p²/2b) (kinematics).
        """
        closing = speed - view.speed
        if not closing > LEAST_CLOSING:  # also NaN
            return 0.0
        room, braking = self._room(view, closing, span), max(-view.acceleration, 0.0)
        if 2.0 * room * braking < closing * view.speed:
            needed = braking + closing * closing / (2.0 * room)
        else:
            its_stop = view.speed * view.speed / (2.0 * max(braking, 0.1))
            needed = speed * speed / (2.0 * (room + its_stop))
        return needed if needed > self._settings.firm_deceleration else 0.0

    def _barrier(self, view: _View, speed: float) -> float:
        """Acceleration (m/s²) towards the speed from which firm braking ends at the margin."""
        if isnan(view.gap):
            return inf
        left = max(view.gap - GUARD_MARGIN, 0.0)
        closing = sqrt(2.0 * self._settings.firm_deceleration * left)
        return (view.speed + closing - speed) / BARRIER_TIME

    def _announced_stop(  # noqa: PLR0917 - parts of an instant
        self,
        now: int,
        ahead: VehiclesAhead,
        situation: Situation,
        view: _View,
        speed: float,
        hardest: float,
    ) -> float:
        """Acceleration (m/s²) that stops behind a silent predecessor that stops as announced.

        It drives on as predicted until the announced instant, and stops with emergency braking from
        then on; braking that it announced before is assumed to last. Both brakes build up alike.
        """
        predecessor = situation.predecessor
        free = (predecessor.stops_at - predecessor.measured_at) / SECOND
        if view.by_sensor or not 0 < predecessor.stops_at <= now:
            return inf
        if free <= 0.0 and not predecessor.is_overdue:
            return inf  # its braking is received
        until = predicted_motion(
            predecessor.speed,
            predecessor.achieved,
            predecessor.acceleration,
            max(free, 0.0),
            predecessor.lag,
            lasting=-self._comfort / 3.0,
        )
        sample = ahead.spacing - predecessor.predicted().driven - self._setup.least_spacing
        emergency = self._settings.emergency
        its_stop = until.driven + stopping_distance(until.speed, until.acceleration, emergency)
        left = sample + its_stop - ANNOUNCED_MARGIN - speed * (self._lag + 0.04)
        if isnan(left):
            return inf
        return -min(needed_deceleration(speed, max(left, LEAST_LEFT)), hardest)

    def _path_end(self, situation: Situation, speed: float, span: float) -> float:
        """Acceleration (m/s²) that stops within the known path where that is required.

        In the state stop, before a hole of the path, and while a car has outrun what it received,
        as behind messages that take longer than its gap.
        """
        known, emergency = situation.known, self._settings.emergency_deceleration
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
            self._outrun += span
        return -self._comfort if self._outrun > OUTRUN_FOR else inf

    def _towards(self, limit: float, speed: float) -> float:
        """Acceleration (m/s²) that brakes comfortably to a `limit` (m/s) of the speed."""
        return max((limit - speed) / LIMIT_TIME, -self._comfort)

    def _catch_up(
        self, ahead: VehiclesAhead, situation: Situation, speed: float, span: float
    ) -> float:
        """Acceleration (m/s²) towards the largest speed, a ratio of the lead's.

        That of a lead that slows down falls gradually, so that a swinging lead does not limit it.
        Without the lead it is the predecessor's.
        """
        known = ahead.lead_speed
        if situation.lead.status not in RELIED_ON or isnan(known):
            known = nan if isfinite(self._reference) else ahead.predecessor_speed
        if isnan(self._reference):
            self._reference = known
        elif not isnan(known):
            fall = self._reference * (1.0 - REFERENCE_FALL * span)
            self._reference = known if known > fall else fall
        if isnan(self._reference):
            return inf
        return (self._setup.catch_up_ratio * max(self._reference, 0.5) - speed) / LIMIT_TIME

    def _words(self, override: Override, view: _View, situation: Situation, needed: float) -> str:
        """The evidence for an override, with its figures."""
        predecessor = situation.predecessor
        if override == "contact":
            how = "measured" if view.by_sensor else f"received {predecessor.age:.2f} s ago"
            text = f"vehicle ahead in {view.gap:.1f} m at {view.speed:.1f} m/s, {how}"
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
