"""Messages with default values for all fields that a test does not set."""

from dataclasses import replace
from typing import Any

from tests.made.message import message, pose
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


def gps(vehicle: str, seq: int, **more: Any) -> GpsPose:
    place = {"latitude_deg": 30.638, "longitude_deg": -96.481, "altitude_m": 80.0}
    usual = {"heading_deg": 90.0, "speed_mps": 20.0}
    return pose(vehicle, seq, at(seq / 20), **{**place, **usual, **more})


def sent(one: GpsPose, at_ns: int) -> GpsPose:
    return replace(one, measured_at_ns=at_ns, sent_at_ns=at_ns)


def truth(
    vehicle: str, seq: int, east: float, north: float, *, yaw: float = 0.0, distance: float = 0.0
) -> TruePose:
    return message(
        TruePose,
        vehicle,
        seq,
        true_at_ns=at(seq / 50),
        east_m=east,
        north_m=north,
        yaw_rad=yaw,
        speed_mps=20.0,
        distance_m=distance,
    )


def tracking(vehicle: str, seq: int, **more: Any) -> Tracking:
    usual: dict[str, Any] = {
        "decided_at_ns": at(seq / 50),
        "mode": "composite",
        "estimated_gap_m": 15.0,
        "measured_gap_m": 15.1,
        "measured_gap_rate_mps": 0.0,
        "lateral_deviation_m": 0.0,
        "lead_age_s": 0.02,
        "predecessor_age_s": 0.02,
        "lead_period_s": 0.05,
        "predecessor_period_s": 0.05,
        "lead_received_ratio": 1.0,
        "predecessor_received_ratio": 1.0,
        "lead_known_m": 30.0,
        "predecessor_known_m": 15.0,
        "lead_status": "fresh",
        "predecessor_status": "fresh",
        "known_m": 30.0,
        "predecessor_weight_ratio": 0.5,
    }
    return message(Tracking, vehicle, seq, **{**usual, **more})


def command(vehicle: str, seq: int) -> Command:
    return message(
        Command,
        vehicle,
        seq,
        decided_at_ns=at(seq / 50),
        steering_rad=0.01,
        feedforward_rad=0.01,
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
    return message(
        LinkVerdict,
        receiver,
        seq if number is None else number,
        sender=sender,
        pose_seq=seq,
        measured_at_ns=measured_at,
        outcome=outcome,
        reason=dropped,
        visible_at_ns=measured_at + round(latency_ms * MS),
        received_at_ns=measured_at + round(received_after * MS),
        late=late,
        sent_at_ns=measured_at,
    )


def health(
    vehicle: str, seq: int = 0, *, seconds: float = 1.0, final: bool = False, **more: Any
) -> Health:
    usual = {"reported_at_ns": at(seconds), "ticks": 100, "final": final}
    return message(Health, vehicle, seq, **{**usual, **more})


def text(vehicle: str, seq: int, words: str, level: str = "info") -> LogText:
    return LogText(vehicle=vehicle, seq=seq, logged_at_ns=START, level=level, text=words)  # type: ignore[arg-type]


def start() -> RunStart:
    return RunStart(vehicle="run", seq=0, start_at_ns=START, run_id="trial")
