import numpy as np

from tests.made.vehicles.decision_messages import log_messages
from vehicles.car.dynamics import Actuation
from vehicles.driver.controller import SourceState
from vehicles.driver.decision import Decision
from vehicles.driver.situation import Situation
from vehicles.driver.steering import SteeringCommand
from vehicles.driver.tracking import TrackingErrors
from vehicles.geometry.arc_spline import ArcSpline, Piece
from vehicles.messages import Announcement, Command, Tracking
from vehicles.preview.trajectory import Fit

NOW = 1_790_000_000_123_456_789
FIT = Fit(
    spline=ArcSpline((Piece(1.0, 2.0, 0.5, 0.0, 10.0), Piece(9.8, 6.8, 0.5, -0.01, 12.0))),
    east=np.array([1.0, 5.0, 9.0]),
    north=np.array([2.0, 4.5, 6.5]),
    station=np.array([0.0, 4.7, 9.2]),
    source=np.array([0, 1, 0], dtype=np.int8),
    residual_rms=0.011,
    residual_max=0.023,
    outliers=1,
)
DECISION = Decision(
    at=NOW,
    actuation=Actuation(steering=0.03, acceleration=-1.5),
    steering=SteeringCommand(steering=0.03, feedforward=0.05, feedback=-0.01),
    errors=TrackingErrors(lateral=0.21, heading=-0.02, yaw_rate=0.003, curvature=0.004),
    mode="composite",
    reason="example",
    fit=FIT,
    target_speed=29.5,
    law_acceleration=-1.0,
    override="contact",
    achieved=-1.2,
    estimated_gap=14.8,
    lateral_deviation=0.04,
    measured_gap=14.6,
    measured_gap_rate=0.3,
    path_offset=-0.12,
    situation=Situation(
        lead=SourceState(status="late", age=0.07, silence=0.05, period=0.05, share=0.9, known=28.0),
        predecessor=SourceState(
            status="fresh", age=0.02, silence=0.01, period=0.1, share=1.0, known=13.0
        ),
        known=28.0,
        blind=4.0,
        predecessor_weight=0.6,
        hazard=True,
    ),
)


def test_a_decision_logs_tracking_and_command() -> None:
    tracking, command, _ = log_messages(DECISION, "v3", 17, NOW)
    assert tracking == Tracking(
        vehicle="v3",
        seq=17,
        decided_at_ns=NOW,
        mode="composite",
        reason="example",
        lateral_error_m=0.21,
        heading_error_rad=-0.02,
        yaw_rate_error_radps=0.003,
        curvature_per_m=0.004,
        estimated_gap_m=14.8,
        lateral_deviation_m=0.04,
        measured_gap_m=14.6,
        measured_gap_rate_mps=0.3,
        lead_age_s=0.07,
        predecessor_age_s=0.02,
        lead_period_s=0.05,
        predecessor_period_s=0.1,
        lead_received_ratio=0.9,
        predecessor_received_ratio=1.0,
        lead_known_m=28.0,
        predecessor_known_m=13.0,
        lead_status="late",
        predecessor_status="fresh",
        known_m=28.0,
        blind_m=4.0,
        predecessor_weight_ratio=0.6,
        hazard=True,
    )
    assert DECISION.announcement == Announcement(
        "composite", True, -1.5, -0.12, achieved_acceleration_mps2=-1.2
    )
    assert command == Command(
        vehicle="v3",
        seq=17,
        decided_at_ns=NOW,
        steering_rad=0.03,
        feedforward_rad=0.05,
        feedback_rad=-0.01,
        acceleration_mps2=-1.5,
        target_speed_mps=29.5,
        law_acceleration_mps2=-1.0,
        override="contact",
    )
