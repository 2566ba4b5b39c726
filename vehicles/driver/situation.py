"""What a follower knows at a control instant: its sources, its path, its brakes.

SI units, NaN where unknown; accelerations are signed, decelerations positive, instants in ns.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, nan
from typing import Final

from vehicles.driver.controller import SourceState, VehiclesAhead
from vehicles.driver.settings import Braking
from vehicles.messages import Mode, SourceStatus, State

LOST: tuple[SourceStatus, ...] = ("lost", "distrusted")  # Silent for too long, or refused
OFF_PATH: tuple[Mode, ...] = ("coast", "stop")  # Modes in which no other vehicle follows its poses

UNUSED = SourceState("unused")  # State of a vehicle that is not received


@dataclass(slots=True)
class Situation:
    """State of the sources and the road of a follower at a control instant.

    `lead` and `predecessor` are one source for the first follower, and have the status "unused" if
    they are not received; `others` are all other sources by name, from front to back. `known` (m)
    is the known path ahead of the car from all sources, `blind` (m) the distance driven beyond it
    in an emergency stop. `weights` in the trajectory are by name, `predecessor_weight` is the
    predecessor's; `hazard` warns the followers behind. `stops_at` (ns, 0 for never) is the
    announced instant at which the car begins to stop without new data; `relayed_stops` are those
    that a lead received from its followers, from front to back. If the known path ends at a hole,
    `hole` (m) is its approximate length, else 0; the car can cross it if it is `crossable`. During
    a return to the path the speed is at most `speed_limit` (m/s), at an uncertain position at most
    `position_limit` (m/s). `ahead` is the motion of the vehicles ahead, once it is computed.
    """

    lead: SourceState = field(default_factory=SourceState)
    predecessor: SourceState = field(default_factory=SourceState)
    known: float = nan
    blind: float = nan
    predecessor_weight: float = nan
    hazard: bool = False
    stops_at: int = 0
    relayed_stops: tuple[int, ...] = ()
    hole: float = 0.0
    crossable: bool = False
    speed_limit: float = inf
    position_limit: float = inf
    state: State = ""
    others: Mapping[str, SourceState] = field(default_factory=dict)
    weights: Mapping[str, float] = field(default_factory=dict)
    ahead: VehiclesAhead | None = None


# ---- Braking distances and required decelerations


STOP_MARGIN: Final = 0.5  # Distance (m) before the end of the known path at which a stop ends
STANDSTILL: Final = 0.2  # Below this speed (m/s) a car is held by its brake
CREEP_SPEED: Final = 2.0  # Largest speed (m/s) across a hole in the known path
GUARD_MARGIN: Final = 1.0  # Gap (m) that remains for errors of position and speed


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
    if square >= 0.0:
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


def needed_deceleration(speed: float, distance: float) -> float:
    """Deceleration (m/s²) v²/(2 s) that stops a car at `speed` (m/s) within `distance` (m)."""
    if speed <= 0.0:
        return 0.0
    return speed * speed / (2.0 * distance) if distance > 0.0 else inf
