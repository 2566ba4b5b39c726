"""Messages of a convoy on a straight road, of any duration."""

from collections.abc import Iterator

from tests.made.scenarios.messages import at, command, gps, health, tracking, truth, verdict
from vehicles.messages import CompositeTrajectory, Message

SPEED, GAP = 20.0, 15.0
CONTROL_HZ, GNSS_HZ = 50, 20
TENTH_S = 0.1
SAMPLES = 40
"""Received poses per fitted trajectory, a typical number."""


def convoy(vehicles: int) -> list[str]:
    return [f"v{place + 1}" for place in range(vehicles)]


def sent_in(tenth: int, vehicles: int = 4) -> Iterator[Message]:
    names = convoy(vehicles)
    for tick in _numbers(tenth, CONTROL_HZ):
        for place, name in enumerate(names):
            driven = SPEED * tick / CONTROL_HZ
            yield truth(name, tick, driven - GAP * place, 0.01 * place, distance=driven)
            yield tracking(name, tick)
            yield command(name, tick)
    for pose in _numbers(tenth, GNSS_HZ):
        for place, name in enumerate(names):
            yield gps(name, pose)
            senders = sorted({names[0], names[max(place - 1, 0)]} - {name})
            for turn, sender in enumerate(senders):
                yield verdict(sender, name, pose, number=pose * len(senders) + turn)
            if place:
                yield trajectory(name, pose)
    if tenth % 10 == 9:
        for name in names:
            yield health(name, tenth // 10, seconds=tenth * TENTH_S, cpu_ratio=0.03)


def _numbers(tenth: int, rate_hz: int) -> range:
    each = rate_hz // 10
    return range(tenth * each, (tenth + 1) * each)


def trajectory(vehicle: str, seq: int) -> CompositeTrajectory:
    here = SPEED * seq / GNSS_HZ
    return CompositeTrajectory(
        vehicle=vehicle,
        seq=seq,
        decided_at_ns=at(seq / GNSS_HZ),
        mode="composite",
        piece_east_m=(here,),
        piece_north_m=(0.0,),
        piece_yaw_rad=(0.0,),
        piece_curvature_per_m=(0.0,),
        piece_length_m=(30.0,),
        sample_east_m=tuple(here + k for k in range(SAMPLES)),
        sample_north_m=tuple(0.001 * k for k in range(SAMPLES)),
        sample_source=tuple(k % 2 for k in range(SAMPLES)),
        residual_m_rms=0.01,
        residual_m_max=0.02,
        piece_curvature_rate_per_m2=(0.0,),
    )
