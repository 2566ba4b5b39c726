"""The decision at a control instant, and the interface of a driver."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import Protocol

from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import Motion
from vehicles.driver.steering import SteeringCommand
from vehicles.driver.tracking import TrackingErrors
from vehicles.messages import Command, CompositeTrajectory, GpsPose, Message, Mode, Tracking
from vehicles.preview.trajectory import Fit


@dataclass(slots=True, kw_only=True)
class Decision:
    """Commands for steering and drive, and what they follow from (Fig. 1, Sections III-A to III-C).

    Units: gap m, ages s, target_speed m/s. `fresh` is False at instants between two control
    instants, where the last decision is held. `fit` is the trajectory if it was made anew.
    """

    actuation: Actuation
    steering: SteeringCommand
    errors: TrackingErrors
    mode: Mode
    reason: str = ""
    fit: Fit | None = None
    target_speed: float = 0.0
    gap: float = nan
    lead_age: float = nan
    predecessor_age: float = nan
    fresh: bool = True

    def messages(self, vehicle: str, seq: int, now: int) -> tuple[Message, ...]:
        """The decision as messages for the log: tracking, command, and the trajectory if any."""
        tracking = Tracking(
            vehicle=vehicle,
            seq=seq,
            decided_at_ns=now,
            mode=self.mode,
            reason=self.reason,
            lateral_error_m=self.errors.lateral,
            heading_error_rad=self.errors.heading,
            yaw_rate_error_radps=self.errors.yaw_rate,
            curvature_per_m=self.errors.curvature,
            gap_m=self.gap,
            lead_age_s=self.lead_age,
            predecessor_age_s=self.predecessor_age,
        )
        command = Command(
            vehicle=vehicle,
            seq=seq,
            decided_at_ns=now,
            steering_rad=self.steering.steering,
            feedforward_rad=self.steering.feedforward,
            feedback_rad=self.steering.feedback,
            acceleration_mps2=self.actuation.acceleration,
            target_speed_mps=self.target_speed,
        )
        if self.fit is None:
            return tracking, command
        return tracking, command, self._trajectory(self.fit, vehicle, seq, now)

    def _trajectory(self, fit: Fit, vehicle: str, seq: int, now: int) -> CompositeTrajectory:
        pieces = fit.spline.pieces
        return CompositeTrajectory(
            vehicle=vehicle,
            seq=seq,
            decided_at_ns=now,
            mode=self.mode,
            piece_east_m=tuple(piece.east for piece in pieces),
            piece_north_m=tuple(piece.north for piece in pieces),
            piece_yaw_rad=tuple(piece.yaw for piece in pieces),
            piece_curvature_per_m=tuple(piece.curvature for piece in pieces),
            piece_length_m=tuple(piece.length for piece in pieces),
            sample_east_m=tuple(fit.east.tolist()),
            sample_north_m=tuple(fit.north.tolist()),
            sample_source=tuple(fit.source.tolist()),
            residual_m_rms=fit.residual_rms,
            residual_m_max=fit.residual_max,
        )


class Driver(Protocol):
    """Driver of a car: of the lead along its path, of a follower along what it received.

    The controller of Fig. 1, together with the drive.
    """

    def step(
        self, now: int, fix: Fix | None, motion: Motion | Body | None, received: Sequence[GpsPose]
    ) -> Decision:
        """Decide (Fig. 1) at `now` (ns) from what the own sensors measured and the received poses.

        `fix` and `motion` are None where there is none at this instant; an exact sensor gives the
        true state of the car.
        """
        ...
