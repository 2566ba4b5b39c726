"""The decision at a control instant."""

from dataclasses import dataclass, field, replace
from math import nan
from typing import Final

from vehicles.car.dynamics import Actuation, achieved_acceleration
from vehicles.car.gnss import Fix
from vehicles.driver.own_state import Pose
from vehicles.driver.situation import OFF_PATH, Situation
from vehicles.driver.steering import SteeringCommand
from vehicles.driver.tracking import TrackingErrors
from vehicles.messages import Announcement, Mode, Override
from vehicles.preview.trajectory import Fit
from vehicles.schedule import SECOND

DEAD_RECKONED_DEVIATION: Final = 0.35
"""Standard deviation (m) of the own lateral position up to which it is certain enough for others
to follow: a fifth of a lane at three standard deviations."""


@dataclass(slots=True, kw_only=True)
class Decision:
    """Commands for steering and drive, and their inputs (Fig. 1, Sections III-A to III-C).

    Units: target_speed m/s; estimated_gap m, between bumpers; measured_gap m and its rate m/s, by
    the gap sensor, predicted to the control instant; lateral_deviation m, of the own position;
    own_pose is its estimate at the control instant. `path_offset` (m, left positive) is that of a
    fix at this instant from the lead's path, NaN if unknown. `law_acceleration` (m/s²) is that of
    the longitudinal law, NaN without one, `override` why the command differs from it; `achieved`
    (m/s²) is what the drive has reached at the instant `at` (ns). `leaving`: the car leaves the
    convoy. `fresh` is False between two control instants, where the last decision is held. `fit` is
    the trajectory if it was refitted. `remarks` are lines for the log.
    """

    at: int
    actuation: Actuation
    steering: SteeringCommand
    errors: TrackingErrors
    mode: Mode
    reason: str = ""
    fit: Fit | None = None
    target_speed: float = 0.0
    law_acceleration: float = nan
    override: Override = ""
    achieved: float = 0.0
    leaving: bool = False
    estimated_gap: float = nan
    lateral_deviation: float = nan
    measured_gap: float = nan
    measured_gap_rate: float = nan
    own_pose: Pose | None = None
    path_offset: float = nan
    situation: Situation = field(default_factory=Situation)
    remarks: tuple[str, ...] = ()
    fresh: bool = True

    def dead_reckoned(self, now: int) -> Fix | None:
        """The own position at `now` (ns) as a fix, estimated without one; None if uncertain."""
        own = self.own_pose
        if own is None or not self.fresh or not self.lateral_deviation <= DEAD_RECKONED_DEVIATION:
            return None
        return Fix(0, now, own.east, own.north, own.yaw, own.speed, own.yaw_rate)

    def achieved_at(self, now: int, lag: float) -> float:
        """Acceleration (m/s²) that a drive with this `lag` (s) has reached at `now` (ns)."""
        span, command = (now - self.at) / SECOND, self.actuation.acceleration
        return achieved_acceleration(self.achieved, command, span, lag)

    def held(self, now: int, lag: float) -> "Decision":
        """Copy of this decision for an instant (ns) between two control instants."""
        return replace(self, at=now, fresh=False, achieved=self.achieved_at(now, lag))

    @property
    def keeps_to_path(self) -> bool:
        """Whether it follows a path without a hazard, so that others may follow its positions."""
        return not self.situation.hazard and self.mode not in OFF_PATH

    @property
    def announcement(self) -> Announcement:
        """Part of the pose message that followers react to, as in a CAM."""
        return Announcement(
            mode=self.mode,
            hazard=self.situation.hazard,
            acceleration_mps2=self.actuation.acceleration,
            path_offset_m=self.path_offset,
            stops_at_ns=self.situation.stops_at,
            leaving=self.leaving,
            relayed_stops_at_ns=self.situation.relayed_stops,
            achieved_acceleration_mps2=self.achieved,
        )
