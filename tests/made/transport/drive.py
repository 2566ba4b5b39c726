"""Messages of a short drive in closed form: all vehicles on one circle, turning left."""

import math
from collections.abc import Iterator

from tests.made.message import message, pose
from vehicles.messages import (
    Change,
    Command,
    CompositeTrajectory,
    GpsPose,
    Health,
    LinkVerdict,
    LogText,
    Message,
    RunEnd,
    RunStart,
    Tracking,
    TruePose,
)

START = 1_700_000_000_000_000_000
RADIUS = 50.0
SPEED = 10.0
SPACING = 12.0
VEHICLES = ("v1", "v2", "v3")
TICK = 20_000_000


def angle(place: int, seconds: float) -> float:
    return (SPEED * seconds - SPACING * place) / RADIUS


def offset_of(place: int) -> float:
    """Offset (m): each follower drives 0.1 m left of its predecessor."""
    return 0.1 * place


def truth(vehicle: str, tick: int) -> TruePose:
    place = VEHICLES.index(vehicle)
    at = angle(place, tick * TICK * 1e-9)
    radius = RADIUS - offset_of(place)
    return message(
        TruePose,
        vehicle,
        tick,
        true_at_ns=START + tick * TICK,
        east_m=radius * math.cos(at),
        north_m=radius * math.sin(at),
        yaw_rad=at + math.pi / 2,
        speed_mps=SPEED,
        yaw_rate_radps=SPEED / RADIUS,
        steering_rad=0.06,
        distance_m=SPEED * tick * TICK * 1e-9,
        lateral_acceleration_mps2=SPEED**2 / RADIUS,
        front_slip_rad=-0.005,
        rear_slip_rad=-0.004,
        friction_ratio=SPEED**2 / RADIUS / 8.8,
    )


def gps(vehicle: str, seq: int, at: int) -> GpsPose:
    place = {"latitude_deg": 48.0, "longitude_deg": 11.0, "altitude_m": 500.0}
    motion = {"heading_deg": 270.0, "speed_mps": SPEED, "yaw_rate_radps": 0.2}
    return pose(vehicle, seq, at, **place, **motion)


def trajectory(vehicle: str, tick: int) -> CompositeTrajectory:
    start = truth(vehicle, tick)
    ahead = start.yaw_rad + 4.0 / RADIUS
    return message(
        CompositeTrajectory,
        vehicle,
        tick,
        decided_at_ns=start.true_at_ns,
        mode="composite",
        piece_east_m=(start.east_m, RADIUS * math.sin(ahead)),
        piece_north_m=(start.north_m, -RADIUS * math.cos(ahead)),
        piece_yaw_rad=(start.yaw_rad, ahead),
        piece_curvature_per_m=(1 / RADIUS, 1 / RADIUS),
        piece_length_m=(4.0, 4.0),
        sample_east_m=(start.east_m, start.east_m + 1.0),
        sample_north_m=(start.north_m, start.north_m + 1.0),
        sample_source=(0, 1),
        residual_m_rms=0.01,
        residual_m_max=0.02,
        piece_curvature_rate_per_m2=(0.0, 0.0),
    )


def tracking(vehicle: str, tick: int) -> Tracking:
    return message(
        Tracking,
        vehicle,
        tick,
        decided_at_ns=START + tick * TICK,
        mode="path" if vehicle == VEHICLES[0] else "composite",
        lateral_error_m=0.01 * tick,
        curvature_per_m=1 / RADIUS,
        estimated_gap_m=SPACING,
        measured_gap_m=SPACING,
        measured_gap_rate_mps=0.0,
        lateral_deviation_m=0.02,
        lead_age_s=0.03,
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
        predecessor_weight_ratio=0.5,
    )


def command(vehicle: str, tick: int) -> Command:
    return message(
        Command,
        vehicle,
        tick,
        decided_at_ns=START + tick * TICK,
        steering_rad=math.radians(3.0),
        feedforward_rad=0.05,
        feedback_rad=0.002,
        target_speed_mps=SPEED,
        law_acceleration_mps2=0.0,
    )


def verdict(vehicle: str, sender: str, seq: int, at: int, outcome: str = "ok") -> LinkVerdict:
    is_dropped = outcome in {"loss", "rate"}
    return message(
        LinkVerdict,
        vehicle,
        seq,
        sender=sender,
        pose_seq=seq,
        measured_at_ns=at - TICK,
        outcome="dropped" if is_dropped else "delivered",
        reason=outcome if is_dropped else "",
        visible_at_ns=at,
        received_at_ns=at,
        late=outcome == "late",
        sent_at_ns=at - TICK,
    )


def health(vehicle: str, seq: int, at: int) -> Health:
    counts = {"ticks": 50, "received": 40, "published": 20, "memory_bytes": 50_000_000}
    usage = {"lateness_ms_max": 0.5, "cpu_ratio": 0.05}
    return message(Health, vehicle, seq, reported_at_ns=at, **counts, **usage)


def drive(ticks: int) -> Iterator[tuple[int, Message]]:
    """Every message of a drive of `ticks` control ticks, as (recorded at, message), in order."""
    yield START, RunStart(vehicle="run", seq=0, start_at_ns=START, run_id="circle")
    yield START, LogText(vehicle="run", seq=0, logged_at_ns=START, level="warning", text="off")
    yield (
        START,
        Change(
            vehicle="run",
            seq=0,
            effective_at_ns=START,
            kind="heal",
            by_hand=True,
            table='{"at_s": 0.0, "kind": "heal"}',
        ),
    )
    for tick in range(ticks):
        now = START + tick * TICK
        for vehicle in VEHICLES:
            yield now, truth(vehicle, tick)
            yield now, tracking(vehicle, tick)
            yield now, command(vehicle, tick)
            if vehicle != VEHICLES[0]:
                yield now, trajectory(vehicle, tick)
                yield now, verdict(vehicle, VEHICLES[0], tick, now)
            if tick % 5 == 0:
                yield now, gps(vehicle, tick // 5, now)
            if tick % 50 == 0:
                yield now, health(vehicle, tick // 50, now)
    end = START + ticks * TICK
    yield end, RunEnd(vehicle="run", seq=0, end_at_ns=end, reason="")
