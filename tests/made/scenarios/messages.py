"""Messages with default values for all fields that a test does not set."""

from dataclasses import replace

from vehicles.messages import (
    Command,
    GpsPose,
    Health,
    LinkVerdict,
    LogText,
    Outcome,
    RunStart,
    Tracking,
    TruePose,
)
from vehicles.schedule import SECOND

START = 1_790_000_000 * SECOND
MS = SECOND // 1000

STRAIGHT = """
name = "straight"
duration_s = 20.0
[path]
kind = "segments"
segments = [{ length_m = 1000.0 }]
"""
"""A scenario of four vehicles on a straight road."""


def at(seconds: float) -> int:
    return START + round(seconds * SECOND)


def gps(vehicle: str, seq: int, **more: float) -> GpsPose:
    pose = GpsPose(
        vehicle=vehicle,
        seq=seq,
        measured_at_ns=at(seq / 20),
        latitude_deg=30.638,
        longitude_deg=-96.481,
        altitude_m=80.0,
        heading_deg=90.0,
        speed_mps=20.0,
        yaw_rate_radps=0.0,
        sent_at_ns=at(seq / 20),
        fix="fixed",
        position_accuracy_m=0.02,
        mode="path",
        hazard=False,
        acceleration_mps2=0.0,
        path_offset_m=0.0,
        stops_at_ns=0,
        true_east_m=0.0,
        true_north_m=0.0,
        true_distance_m=0.0,
    )
    return replace(pose, **more)  # type: ignore[arg-type]


def sent(pose: GpsPose, at_ns: int) -> GpsPose:
    return replace(pose, measured_at_ns=at_ns, sent_at_ns=at_ns)


def truth(
    vehicle: str, seq: int, east: float, north: float, *, yaw: float = 0.0, distance: float = 0.0
) -> TruePose:
    return TruePose(
        vehicle=vehicle,
        seq=seq,
        true_at_ns=at(seq / 50),
        east_m=east,
        north_m=north,
        yaw_rad=yaw,
        speed_mps=20.0,
        lateral_speed_mps=0.0,
        yaw_rate_radps=0.0,
        steering_rad=0.0,
        distance_m=distance,
        lateral_acceleration_mps2=0.0,
        front_slip_rad=0.0,
        rear_slip_rad=0.0,
        friction_ratio=0.0,
    )


def tracking(vehicle: str, seq: int, **more: object) -> Tracking:
    message = Tracking(
        vehicle=vehicle,
        seq=seq,
        decided_at_ns=at(seq / 50),
        mode="composite",
        reason="",
        lateral_error_m=0.0,
        heading_error_rad=0.0,
        yaw_rate_error_radps=0.0,
        curvature_per_m=0.0,
        estimated_gap_m=15.0,
        measured_gap_m=15.1,
        measured_gap_rate_mps=0.0,
        lead_age_s=0.02,
        predecessor_age_s=0.02,
        lead_period_s=0.05,
        predecessor_period_s=0.05,
        lead_received_ratio=1.0,
        predecessor_received_ratio=1.0,
        lead_known_m=30.0,
        predecessor_known_m=15.0,
        lead_status="fresh",
        predecessor_status="fresh",
        known_m=30.0,
        blind_m=0.0,
        predecessor_weight_ratio=0.5,
        hazard=False,
    )
    return replace(message, **more)  # type: ignore[arg-type]


def command(vehicle: str, seq: int) -> Command:
    return Command(
        vehicle=vehicle,
        seq=seq,
        decided_at_ns=at(seq / 50),
        steering_rad=0.01,
        feedforward_rad=0.01,
        feedback_rad=0.0,
        acceleration_mps2=0.0,
        target_speed_mps=20.0,
        law_acceleration_mps2=0.0,
    )


def verdict(
    sender: str,
    receiver: str,
    seq: int,
    *,
    latency_ms: float = 20.0,
    dropped: str = "",
    received_after_ms: float | None = None,
    number: int | None = None,
) -> LinkVerdict:
    """The verdict on pose `seq`; a pose is late if `received_after_ms` is given.

    The `number` of the message is that of the pose by default.
    """
    outcome: Outcome = "dropped" if dropped else "delivered"
    measured_at = at(seq / 20)
    late = received_after_ms is not None
    received_after = latency_ms if received_after_ms is None else received_after_ms
    return LinkVerdict(
        vehicle=receiver,
        seq=seq if number is None else number,
        sender=sender,
        pose_seq=seq,
        measured_at_ns=measured_at,
        outcome=outcome,
        reason=dropped,
        visible_at_ns=measured_at + round(latency_ms * MS),
        received_at_ns=measured_at + round(received_after * MS),
        late=late,
        sent_at_ns=measured_at,
        copies=0,
        content="",
    )


def health(
    vehicle: str, seq: int = 0, *, seconds: float = 1.0, final: bool = False, **more: float
) -> Health:
    message = Health(
        vehicle=vehicle,
        seq=seq,
        reported_at_ns=at(seconds),
        ticks=100,
        late_ticks=0,
        lateness_ms_max=0.0,
        received=0,
        dropped=0,
        late_messages=0,
        rejected_messages=0,
        published=0,
        memory_bytes=0,
        cpu_ratio=0.0,
        final=final,
    )
    return replace(message, **more)  # type: ignore[arg-type]


def text(vehicle: str, seq: int, words: str, level: str = "info") -> LogText:
    return LogText(vehicle=vehicle, seq=seq, logged_at_ns=START, level=level, text=words)  # type: ignore[arg-type]


def start() -> RunStart:
    return RunStart(vehicle="run", seq=0, start_at_ns=START, run_id="trial")
