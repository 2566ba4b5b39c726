"""Messages of a decision: errors and sources, commands, and the composite trajectory."""

from vehicles.driver.decision import Decision
from vehicles.messages import Command, CompositeTrajectory, Tracking
from vehicles.preview.trajectory import Fit


def tracking_message(decision: Decision, vehicle: str, seq: int, now: int) -> Tracking:
    """Message of the errors and the state of the sources (Sections III-A and III-B)."""
    situation = decision.situation
    lead, ahead = situation.lead, situation.predecessor
    rest = situation.others.values()
    others = ", ".join([f"{name} {one.status}" for name, one in situation.others.items()])
    return Tracking(
        vehicle=vehicle,
        seq=seq,
        decided_at_ns=now,
        mode=decision.mode,
        reason=decision.reason,
        lateral_error_m=decision.errors.lateral,
        heading_error_rad=decision.errors.heading,
        yaw_rate_error_radps=decision.errors.yaw_rate,
        curvature_per_m=decision.errors.curvature,
        estimated_gap_m=decision.estimated_gap,
        lateral_deviation_m=decision.lateral_deviation,
        measured_gap_m=decision.measured_gap,
        measured_gap_rate_mps=decision.measured_gap_rate,
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
        other_weight_ratio=tuple([situation.weights.get(name, 0.0) for name in situation.others]),
        state=situation.state,
    )


def command_message(decision: Decision, vehicle: str, seq: int, now: int) -> Command:
    """Message of the commands (Section III-C)."""
    return Command(
        vehicle=vehicle,
        seq=seq,
        decided_at_ns=now,
        steering_rad=decision.steering.steering,
        feedforward_rad=decision.steering.feedforward,
        feedback_rad=decision.steering.feedback,
        acceleration_mps2=decision.actuation.acceleration,
        target_speed_mps=decision.target_speed,
        law_acceleration_mps2=decision.law_acceleration,
        override=decision.override,
    )


def trajectory_message(
    decision: Decision, fit: Fit, vehicle: str, seq: int, now: int
) -> CompositeTrajectory:
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
        mode=decision.mode,
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
