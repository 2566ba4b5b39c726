"""Freshness of a follower's data, in seconds and metres; SI units, NaN where unknown."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, nan
from typing import Final

from vehicles.car.tyres import GRAVITY
from vehicles.driver.controller import VehiclesAhead
from vehicles.driver.settings import Braking
from vehicles.messages import Mode, SourceStatus
from vehicles.schedule import SECOND

LOST: tuple[SourceStatus, ...] = ("lost", "distrusted")  # Silent for too long, or refused
SLOWING: tuple[Mode, ...] = ("coast", "stop")  # Without a source to follow
OFF_PATH: tuple[Mode, ...] = (*SLOWING, "creep")  # No other vehicle follows its poses
PREDICTED_FOR: Final = 0.5  # Age (s) of a sample up to which its acceleration is assumed to last


@dataclass(slots=True)
class SourceFreshness:
    """State of one source at a control instant.

    `age` (s) is the time since the newest sample was measured, `silence` (s) since it was received,
    `period` (s) the expected time between messages, `share` the received ratio over the last
    second. Its path is known up to `known` (m) ahead of the car, negative if it ends behind. It is
    lost at `lost_at` (ns) unless it is received again. `mode`, `hazard`, `acceleration` (m/s²) and
    `stops_at` (ns) are those announced last; without an announced stop, `stops_at` of a silent
    source is the instant at which it may begin one. `speed` (m/s) is that of the newest sample.
    """

    status: SourceStatus = "unheard"
    age: float = nan
    silence: float = nan
    period: float = nan
    share: float = nan
    known: float = nan
    mode: Mode = "path"
    hazard: bool = False
    acceleration: float = 0.0
    lost_at: int = 0
    stops_at: int = 0
    speed: float = nan

    def predicted_motion(self) -> tuple[float, float, float]:
        """Distance driven (m) since the newest sample, present speed (m/s), acceleration (m/s²).

        The announced acceleration lasts for `PREDICTED_FOR`, or until the vehicle stands.
        """
        speed, acceleration, age = self.speed, self.acceleration, self.age
        lasts = PREDICTED_FOR if age > PREDICTED_FOR else age
        after = speed + acceleration * lasts
        if after < 0.0:
            return speed * speed / (-2.0 * acceleration), 0.0, 0.0
        driven = 0.5 * (speed + after) * lasts + after * (age - lasts)
        return driven, after, acceleration if age <= PREDICTED_FOR else 0.0


UNUSED = SourceFreshness("unused")  # State of a vehicle that is not received


@dataclass(slots=True)
class Situation:
    """State of the sources, the road and the brakes of a follower at a control instant.

    `lead` and `predecessor` are one source for the first follower, and have the status "unused" if
    they are not received; `others` are all other sources by name, from front to back. `known` (m)
    is the known path ahead of the car from all sources; `comfortable_stop` and `firm_stop` are
    braking distances (m), `blind` (m) the distance driven beyond the known path in an emergency
    stop. `weights` in the trajectory are by name, `predecessor_weight` is the predecessor's;
    `hazard` warns the followers behind. `stops_at` (ns, 0
    for never) is the announced instant at which the car begins to stop without new data. The known
    path ends at a hole of about `hole` (m), 0 without one, which the car can cross if it is
    `crossable`. A return to the path, or sources that are rarely received, require at most
    `speed_limit` (m/s). `ahead` is the motion of the vehicles ahead, once it is computed.
    """

    lead: SourceFreshness = field(default_factory=SourceFreshness)
    predecessor: SourceFreshness = field(default_factory=SourceFreshness)
    known: float = nan
    comfortable_stop: float = nan
    firm_stop: float = nan
    blind: float = nan
    predecessor_weight: float = nan
    hazard: bool = False
    stops_at: int = 0
    hole: float = 0.0
    crossable: bool = False
    speed_limit: float = inf
    others: Mapping[str, SourceFreshness] = field(default_factory=dict)
    weights: Mapping[str, float] = field(default_factory=dict)
    ahead: VehiclesAhead | None = None
    relayed_stops: tuple[int, ...] = ()  # `stops_at` (ns) of the followers, as the lead received it


# ---- Braking distances, required decelerations, and announced stops; SI units
#
# Accelerations are signed, decelerations positive; instants in ns.


STOP_MARGIN: Final = 0.5  # Distance (m) before the end of the known path at which a stop ends
STANDSTILL: Final = 0.2  # Below this speed (m/s) a car is held by its brake
CREEP_SPEED: Final = 2.0  # Largest speed (m/s) across a hole in the known path
GUARD_MARGIN: Final = 1.0  # Gap (m) that the guard keeps for errors of position and speed
GUARD_TIME: Final = 0.3  # The guard begins to brake this time (s) before the last instant to do so
HARDEST: Final = 100.0  # Upper end (m/s²) of the bisection, ten times the limit of tyres
HALVINGS: Final = 40  # Number of bisection steps, to 1e-10 m/s²


def stopping_distance(speed: float, acceleration: float, braking: Braking) -> float:
    """Distance (m) to a standstill from `speed` (m/s) and the present acceleration (m/s²).

    The acceleration changes at the jerk of `braking` until its deceleration is reached, which is
    then held: s = v t + a t²/2 ∓ j t³/6 during the ramp, then v²/(2 b) (kinematics; the stop
    profile of Autoware's planners).
    """
    if speed <= 0.0:
        return 0.0
    deceleration, jerk = braking.deceleration, braking.jerk
    short = -deceleration - acceleration
    span = abs(short) / jerk
    jerk = math.copysign(jerk, short)
    square = acceleration * acceleration - 2.0 * jerk * speed
    if jerk != 0.0 and square >= 0.0:
        # The root of v + a t + j t²/2 that is reached first, without cancellation where a < 0.
        slower = -acceleration + math.sqrt(square)
        if slower > 0.0:
            stands = 2.0 * speed / slower
            span = span if span < stands else stands
    left = speed + acceleration * span + 0.5 * jerk * span * span
    driven = speed * span + 0.5 * acceleration * span**2 + jerk * span**3 / 6.0
    if left <= 0.0:
        return driven
    return driven + left**2 / (2.0 * deceleration)


def needed_deceleration(
    speed: float, distance: float, acceleration: float = 0.0, jerk: float = math.inf
) -> float:
    """Smallest deceleration (m/s²) that stops a car at `speed` (m/s) within `distance` (m).

    Without a jerk limit (m/s³) it is v²/(2 s). With one it is found by bisection of
    `stopping_distance` from the present acceleration (m/s²). Infinite if none suffices.
    """
    if speed <= 0.0:
        return 0.0
    if distance <= 0.0:
        return math.inf
    if jerk == math.inf:
        return speed * speed / (2.0 * distance)
    if stopping_distance(speed, acceleration, Braking(HARDEST, jerk)) > distance:
        return math.inf
    mild, hard = 0.0, HARDEST
    for _ in range(HALVINGS):
        middle = 0.5 * (mild + hard)
        if stopping_distance(speed, acceleration, Braking(middle, jerk)) > distance:
            mild = middle
        else:
            hard = middle
    return hard


def safe_reserve(gap: float, its_speed: float, its_deceleration: float, own_stop: float) -> float:
    """Distance (m) left if the car ahead, a `gap` (m) away, and the own car brake hard now.

    The safe distance of Shalev-Shwartz, Shammah and Shashua, 2017 (RSS): the car ahead stops from
    `its_speed` (m/s) at `its_deceleration` (m/s²), the own car within `own_stop` (m).
    """
    return gap + its_speed * its_speed / (2.0 * its_deceleration) - GUARD_MARGIN - own_stop


def braking_share(reserve: float, speed: float) -> float:
    """Share of the hardest braking when the distance left (m, RSS) lasts for less than GUARD_TIME.

    It increases from 0 to 1 while the reserve is used up at `speed` (m/s).
    """
    time = reserve / max(speed, 0.1)
    return 0.0 if time >= GUARD_TIME else 1.0 - max(time, 0.0) / GUARD_TIME


def friction_left(friction: float, lateral: float) -> float:
    """Deceleration (m/s²) that `friction` leaves at the lateral acceleration `lateral` (m/s²).

    Friction circle of Pacejka's Tire and Vehicle Dynamics: a_x² + a_y² <= (μ g)².
    """
    limit = friction * GRAVITY
    left = limit * limit - lateral * lateral
    return 0.0 if left < 0.0 else math.sqrt(left)


class AnnouncedStop:
    """Assumes that the predecessor stops as announced, or when it may while silent, at full force.

    Without this assumption cars that lose all data at the same position would brake there one after
    the other, and collide; so would a car behind one that is cut off alone.
    """

    def __init__(self, emergency: Braking) -> None:
        self._emergency = emergency
        self._received_at = 0

    def is_expected(self, now: int, predecessor: SourceFreshness) -> bool:
        """Whether an announced stop is assumed at `now`, until received poses contradict it.

        While the predecessor is received the assumption ends when its brakes must have built up.
        """
        stops_at = predecessor.stops_at
        if not stops_at or now < stops_at:
            self._received_at = 0
            return False
        since = (now - stops_at) / SECOND
        status = predecessor.status
        if predecessor.age >= since or status in LOST or status == "late":
            return True
        self._received_at = self._received_at or now
        emergency = self._emergency
        return now - self._received_at <= emergency.deceleration / emergency.jerk * SECOND

    def distance(self, now: int, speed: float, age: float, predecessor: SourceFreshness) -> float:
        """Stopping distance (m) from a sample of the predecessor, `age` (s) old, at `speed` (m/s).

        It keeps that speed until the announced instant, or is already braking.
        """
        free = (predecessor.stops_at - now) / SECOND + age
        if free > 0.0:
            return speed * free + stopping_distance(speed, 0.0, self._emergency)
        braked = min(max(predecessor.acceleration, -self._emergency.deceleration), 0.0)
        return stopping_distance(speed, braked, self._emergency)
