"""The decision at a control instant, and the interface of a driver."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import nan
from typing import Final, Protocol

from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import Motion
from vehicles.car.sensors import GapMeasurement
from vehicles.driver.own_state import Pose
from vehicles.driver.situation import OFF_PATH, Situation
from vehicles.driver.steering import SteeringCommand
from vehicles.driver.tracking import TrackingErrors
from vehicles.messages import Announcement, Command, CompositeTrajectory, Mode, Override, Tracking
from vehicles.preview.trajectory import Fit
from vehicles.received_pose import ReceivedPose

DEAD_RECKONED_DEVIATION: Final = 0.35
"""Standard deviation (m) of the own lateral position up to which it is certain enough for others
to follow: a fifth of a lane at three standard deviations."""


@dataclass(slots=True, kw_only=True)
class Decision:
    """Commands for steering and drive, and their inputs (Fig. 1, Sections III-A to III-C).

    Units: target_speed m/s; estimated_gap m, between bumpers; measured_gap m and its rate m/s, by
    the gap sensor, predicted to the control instant; lateral_deviation m, of the own position;
    own_pose is its estimate at the control instant. `path_offset` (m, left positive) is the offset
    of the last own fix from the lead's path, NaN if unknown. `law_acceleration` (m/s²) is that of
    the longitudinal law, NaN without one, `override` why the command differs from it; `achieved`
    (m/s²) is what the drive has reached. `leaving`: the car leaves the convoy. `fresh` is False between two control instants, where the
    last decision is held. `fit` is the trajectory if it was refitted. `remarks`
    are lines for the log.
    """

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

    def tracking(self, vehicle: str, seq: int, now: int) -> Tracking:
        """Message of the errors and the state of the sources (Sections III-A and III-B)."""
        situation, lead, ahead = self.situation, self.situation.lead, self.situation.predecessor
        rest = situation.others.values()
        others = ", ".join([f"{name} {one.status}" for name, one in situation.others.items()])
        return Tracking(
            vehicle=vehicle,
            seq=seq,
            decided_at_ns=now,
            mode=self.mode,
            reason=self.reason,
            lateral_error_m=self.errors.lateral,
            heading_error_rad=self.errors.heading,
            yaw_rate_error_radps=self.errors.yaw_rate,
            curvature_per_m=self.errors.curvature,
            estimated_gap_m=self.estimated_gap,
            lateral_deviation_m=self.lateral_deviation,
            measured_gap_m=self.measured_gap,
            measured_gap_rate_mps=self.measured_gap_rate,
            lead_age_s=lead.age,
            predecessor_age_s=ahead.age,
            lead_period_s=lead.period,
            predecessor_period_s=ahead.period,
            lead_received_ratio=lead.share,
            predecessor_received_ratio=ahead.share,
            lead_known_m=lead.known,
            predecessor_known_m=ahead.known,
            lead_status=lead.status,
            predecessor_status=ahead.status,
            known_m=situation.known,
            blind_m=situation.blind,
            predecessor_weight_ratio=situation.predecessor_weight,
            hazard=situation.hazard,
            other_sources=others,
            other_age_s=tuple([one.age for one in rest]),
            other_received_ratio=tuple([one.share for one in rest]),
            other_known_m=tuple([one.known for one in rest]),
            other_weight_ratio=tuple(
                [situation.weights.get(name, 0.0) for name in situation.others]
            ),
            state=situation.state,
        )

    def command(self, vehicle: str, seq: int, now: int) -> Command:
        """Message of the commands (Section III-C)."""
        return Command(
            vehicle=vehicle,
            seq=seq,
            decided_at_ns=now,
            steering_rad=self.steering.steering,
            feedforward_rad=self.steering.feedforward,
            feedback_rad=self.steering.feedback,
            acceleration_mps2=self.actuation.acceleration,
            target_speed_mps=self.target_speed,
            law_acceleration_mps2=self.law_acceleration,
            override=self.override,
        )

    def held(self) -> "Decision":
        """Copy of this decision for an instant between two control instants."""
        return replace(self, fresh=False)

    @property
    def keeps_to_path(self) -> bool:
        """Whether it follows a path, without a hazard: such positions are others' path, too."""
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

    def trajectory(self, fit: Fit, vehicle: str, seq: int, now: int) -> CompositeTrajectory:
        """Message of the composite trajectory of Section III-A."""
        pieces = [
            (piece.east, piece.north, piece.yaw, piece.curvature, piece.length, piece.rate)
            for piece in fit.spline.pieces
        ]
        east, north, yaw, curvature, length, rate = zip(*pieces, strict=True)
        return CompositeTrajectory(
            vehicle=vehicle,
            seq=seq,
            decided_at_ns=now,
            mode=self.mode,
            piece_east_m=east,
            piece_north_m=north,
            piece_yaw_rad=yaw,
            piece_curvature_per_m=curvature,
            piece_length_m=length,
            sample_east_m=tuple(fit.east.tolist()),
            sample_north_m=tuple(fit.north.tolist()),
            sample_source=tuple(fit.source.tolist()),
            residual_m_rms=fit.residual_rms,
            residual_m_max=fit.residual_max,
            piece_curvature_rate_per_m2=rate,
        )


class Driver(Protocol):
    """Driver of a car: the controller of Fig. 1, together with the drive."""

    def step(
        self,
        now: int,
        fix: Fix | None,
        motion: Motion | Body | None,
        received: Sequence[ReceivedPose],
        gap: GapMeasurement | None = None,
    ) -> Decision:
        """Decide at `now` (ns) from the own measurements and the received poses.

        `fix`, `motion` and `gap` are None if no measurement has become available at this instant;
        an exact sensor returns the true state of the car.
        """
        ...
