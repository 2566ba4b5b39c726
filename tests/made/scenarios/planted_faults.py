"""What breaks the limits of the shipped drills: other behaviour, or a fault in one function.

Every limit of every drill is broken by one of these at least: none is so loose that all passes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from typing import Any

from vehicles.driver.ego.sensors import Fix

from vehicles.driver.degradation.trust.gate import Belief, InnovationGate
from vehicles.driver.steering import SteeringCommand


@dataclass(frozen=True)
class Fault:
    """Another function in the place of one of `vehicles/`, named with dots."""

    place: str
    by: Callable[..., Any]


def _wheels_straight(
    _reaction: str, mode: str, asked: SteeringCommand, _last: SteeringCommand
) -> SteeringCommand:
    if mode not in {"coast", "stop"}:
        return asked
    return replace(asked, steering=0.0, feedforward=0.0, feedback=0.0)


def _believe(_gate: InnovationGate, _now: int, fix: Fix) -> Belief:
    return Belief(True, "", fix.accuracy)


WHEELS_STRAIGHT = Fault("vehicles.driver.follower.without_hearing", _wheels_straight)
"""Who hears nobody lets go of the wheel."""
BELIEVES_ALL = Fault("vehicles.driver.degradation.trust.gate.InnovationGate.judge", _believe)
"""Whatever is heard is believed."""
KEEPS_NO_DISTANCE = Fault(
    "vehicles.driver.degradation.slowing.longitudinal.DegradedSpeed._guarded",
    lambda *_: inf,
)
"""No safe distance is kept."""
ALL_EXACT = Fault("vehicles.driver.ego.pose_estimator._Model.position", lambda *_: 0.01)
"""The car takes each of its fixes for exact to the centimetre."""
NEEDS_MANY = Fault(
    "vehicles.driver.degradation.sources.reaches_ahead",
    lambda window: len(window.station) >= 60,
)
"""A trajectory is made of three seconds of messages, or not at all."""

EXTRAPOLATE = "control.degradation.reaction=extrapolate"
LATE = "control.degradation.lost_s=1.0"
SLOW = "control.degradation.probation_s=4.0"


@dataclass(frozen=True)
class Plant:
    """What is planted into a drill, and the limits that it has to break."""

    drill: str
    breaks: tuple[str, ...]
    overrides: tuple[str, ...] = ()
    fault: Fault | None = None

    def __str__(self) -> str:
        planted = self.overrides or (self.fault.place.rpartition(".")[2] if self.fault else "",)
        return f"{self.drill}: {', '.join(self.breaks)} by {' '.join(planted)}"
