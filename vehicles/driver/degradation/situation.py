"""Freshness of a follower's data, in seconds and metres; SI units, NaN where unknown."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, nan
from typing import Final

from vehicles.driver.longitudinal.controller import VehiclesAhead
from vehicles.messages import Mode, SourceStatus

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
